"""Columns of nodes through the tissue, their thickness, and the prior of thickness under the skin."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

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
    """Log-normal thickness of the columns, with the deviation `SPREAD` of its logarithm."""

    columns: Columns
    mean: Floats  #: (n,) median thickness [m]
    free: Integers  #: columns whose inner nodes no data determine
    #: thickness of this face in standard deviations of the logarithm: a member of the ensemble
    deviation: float = 0.0

    @classmethod
    def scaled(
        cls,
        columns: Columns,
        source: Floats,
        scale: float,
        known: Integers,
        deviation: float = 0.0,
    ) -> "ThicknessPrior":
        """Thickness of the source times the scale of the similarity; not of nodes that are `known`."""
        free = np.flatnonzero(~np.isin(columns.inner, known))
        return cls(columns, scale * columns.thickness(source), free, deviation)

    @property
    def wanted(self) -> Floats:
        """Thickness (n,) of this face [m]."""
        return self.mean * np.exp(self.deviation * SPREAD)

    def interval(self) -> tuple[Floats, Floats]:
        """Bounds (n,) that contain the thickness with a probability of 90 % [m]."""
        width = np.exp(INTERVAL * SPREAD)
        return self.mean / width, self.mean * width

    def rows(self, q: Floats, area: Floats) -> Rows:
        """Springs that pull inner nodes to their thickness at q; `area` (n_nodes,) of the skin."""
        wanted = self.wanted[self.free]
        skin, inner = self.columns.skin[self.free], self.columns.inner[self.free]
        along = q[inner] - q[skin]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        W = (SOFTNESS * area[skin])[:, None, None] * along[:, :, None] * along[:, None, :]
        return at_nodes(inner, q[skin] + wanted[:, None] * along, W)
