"""Columns of nodes through the tissue, their thickness, and the prior of thickness under the skin."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

from emgface.face.parts import CENTRE, INNER, OUTER
from emgface.face.surface import element_edges
from emgface.face.template.norms import NORMS
from emgface.fit.springs import NO_ROWS, Rows
from emgface.fit.triangulated import Floats, Integers

THICKNESS_SPREAD: Final = float(
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
SOFTNESS: Final = 4e5  #: stiffness of the springs of the prior, per area [Pa/m]
INTERVAL_90: Final = 1.645  #: half width of an interval of 90 % in standard deviations


@dataclass(frozen=True, eq=False)
class Columns:
    """Nodes (n, 4) of each column, from the skin through the layers to the inner surface."""

    nodes: Integers

    @property
    def skin(self) -> Integers:
        """Nodes of the skin (n,)."""
        return self.nodes[:, 0]

    @property
    def inner(self) -> Integers:
        """Nodes of the inner surface (n,)."""
        return self.nodes[:, -1]

    @classmethod
    def from_face(cls, face: xr.Dataset) -> "Columns":
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
        nodes = [np.flatnonzero(depth == 0)]
        for _ in range(3):
            nodes.append(np.where(nodes[-1] >= 0, below[nodes[-1]], -1))
        whole = np.column_stack(nodes)
        return cls(whole[whole[:, -1] >= 0])

    def thickness(self, q: Floats) -> Floats:
        """Length (n,) of every column [m]."""
        return np.linalg.norm(q[self.skin] - q[self.inner], axis=1)

    def shares(self, q: Floats) -> Floats:
        """Shares (n, 3) of the layers in the length of every column [1]."""
        layers = np.linalg.norm(np.diff(q[self.nodes], axis=1), axis=2)
        return layers / layers.sum(axis=1, keepdims=True)


@dataclass(frozen=True, eq=False)
class ThicknessPrior:
    """Log-normal thickness of the columns, with the deviation `THICKNESS_SPREAD` of its logarithm."""

    columns: Columns
    mean: Floats  #: (n,) median thickness [m]
    shares: Floats  #: (n, 3) of the layers in the thickness [1]
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
        mean = scale * columns.thickness(source)
        return cls(columns, mean, columns.shares(source), free, deviation)

    @property
    def wanted(self) -> Floats:
        """Thickness (n,) of this face [m]."""
        return self.mean * np.exp(self.deviation * THICKNESS_SPREAD)

    def interval(self) -> tuple[Floats, Floats]:
        """Bounds (n,) that contain the thickness with a probability of 90 % [m]."""
        width = np.exp(INTERVAL_90 * THICKNESS_SPREAD)
        return self.mean / width, self.mean * width

    def rows(self, q: Floats, area: Floats) -> Rows:
        """Springs between the ends of every layer, of its length along the column at q.

        `area` (n_nodes,) is that of the skin. The springs of a column have no resultant: springs to
        fixed places would push tissue that no scan holds away, by millimetres at a rim.
        """
        nodes, wanted = self.columns.nodes[self.free], self.wanted[self.free]
        along = q[nodes[:, -1]] - q[nodes[:, 0]]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        layers = nodes.shape[1] - 1
        W = (layers * SOFTNESS * area[nodes[:, 0]])[:, None, None]
        W = W * along[:, :, None] * along[:, None, :]
        weights = np.tile([1.0, -1.0, 0.0], (len(nodes), 1))
        return NO_ROWS.joined(
            *(
                Rows(
                    nodes[:, [k + 1, k, k]], weights,
                    (self.shares[self.free, k] * wanted)[:, None] * along, W,
                )
                for k in range(layers)
            )
        )  # fmt: skip
