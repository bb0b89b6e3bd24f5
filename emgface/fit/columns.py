"""Columns of nodes through the tissue, their thickness, and the prior of thickness under the skin."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from scipy.spatial.distance import cdist

from emgface.face.parts import CENTRE, INNER, OUTER
from emgface.face.surface import element_edges
from emgface.face.template.norms import NORMS
from emgface.fit.springs import Rows, at_nodes
from emgface.fit.triangulated import Floats, Integers

SPREAD: Final = float(
    np.sqrt(
        np.mean(
            [
                (sd / mean) ** 2
                for norm in NORMS
                if norm.name.endswith("_thickness") and norm.name != "skin_thickness"
                for mean, sd in (norm.men, norm.women)
            ]
        )
    )
)
"""Standard deviation of the logarithm of the thickness of soft tissue in a group of adults [1].

The root mean square of the coefficients of variation of the thicknesses in
`emgface.face.template.norms` (Stephan and Simpson 2008; Arnett et al. 1999).
"""
REACH: Final = 0.03
"""Distance within which deviations of thickness are alike [m]; regions of the norms are this large."""
COMMON: Final = 0.25  #: share of the variance that the whole face has in common [1]
SOFTNESS: Final = 1e5  #: stiffness of the springs of the prior, per area [Pa/m]
INTERVAL: Final = 1.645  #: half width of an interval of 90 % in standard deviations


@dataclass(frozen=True, eq=False)
class Columns:
    """Node of the skin and of the inner surface at the ends of each column (n,)."""

    skin: Integers
    inner: Integers

    @classmethod
    def of(cls, face: xr.Dataset) -> "Columns":
        """Follow edges from the skin through the layers; columns that end elsewhere are omitted."""
        connectivity, layer = face["connectivity"].values, face["layer"].values
        n = face.sizes["node"]
        touches = np.zeros((3, n), dtype=bool)
        for k in (INNER, CENTRE, OUTER):
            nodes = connectivity[layer == k]
            touches[k, nodes[nodes >= 0]] = True
        depth = np.full(n, -1)
        depth[touches[OUTER] & ~touches[CENTRE]] = 0
        depth[touches[OUTER] & touches[CENTRE]] = 1
        depth[touches[CENTRE] & touches[INNER]] = 2
        depth[touches[INNER] & ~touches[CENTRE]] = 3
        edges = np.unique(element_edges(connectivity)[0], axis=0)
        edges = np.concatenate([edges, edges[:, ::-1]])
        down = edges[depth[edges[:, 1]] == depth[edges[:, 0]] + 1]
        below = np.full(n, -1)
        below[down[:, 0]] = down[:, 1]
        skin = np.flatnonzero(depth == 0)
        end = skin
        for _ in range(3):
            end = np.where(end >= 0, below[end], -1)
        good = end >= 0
        return cls(skin[good], end[good])

    def thickness(self, q: Floats) -> Floats:
        """Length (n,) of every column [m]."""
        return np.linalg.norm(q[self.skin] - q[self.inner], axis=1)


@dataclass(frozen=True, eq=False)
class ThicknessPrior:
    """Log-normal thickness of the columns, with a spatial correlation exp(-(d/`REACH`)^2 / 2)."""

    columns: Columns
    mean: Floats  #: (n,) median thickness [m]
    free: Integers  #: columns whose inner nodes no data determine

    @classmethod
    def scaled(
        cls, columns: Columns, source: Floats, scale: float, known: Integers
    ) -> "ThicknessPrior":
        """Thickness of the source times the scale of the similarity; not of nodes that are `known`."""
        free = np.flatnonzero(~np.isin(columns.inner, known))
        return cls(columns, scale * columns.thickness(source), free)

    def interval(self) -> tuple[Floats, Floats]:
        """Bounds (n,) that contain the thickness with a probability of 90 % [m]."""
        width = np.exp(INTERVAL * SPREAD)
        return self.mean / width, self.mean * width

    def draw(self, source: Floats, seed: int) -> Floats:
        """Draw the thickness (n,) of one person, correlated over the skin [m]."""
        rng = np.random.default_rng(seed)
        place = source[self.columns.skin]
        # a field of Gaussian bumps has a Gaussian correlation of sqrt(2) times their width
        sites = place[rng.choice(len(place), min(400, len(place)), replace=False)]
        bumps = np.exp(-cdist(place, sites, "sqeuclidean") / REACH**2)
        own = bumps @ rng.standard_normal(len(sites)) / np.linalg.norm(bumps, axis=1)
        field = np.sqrt(COMMON) * rng.standard_normal() + np.sqrt(1.0 - COMMON) * own
        return self.mean * np.exp(SPREAD * field)

    def rows(self, q: Floats, thickness: Floats | None = None, area: Floats | None = None) -> Rows:
        """Springs that pull the inner nodes to this thickness along their columns at positions q."""
        wanted = (self.mean if thickness is None else thickness)[self.free]
        skin, inner = self.columns.skin[self.free], self.columns.inner[self.free]
        along = q[inner] - q[skin]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        size = np.full(len(inner), 1e-5) if area is None else area[skin]
        W = (SOFTNESS * size)[:, None, None] * along[:, :, None] * along[:, None, :]
        return at_nodes(inner, q[skin] + wanted[:, None] * along, W)
