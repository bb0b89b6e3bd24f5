"""Corner tetrahedra of hexahedra and wedges: determinants, scaled Jacobians, rectangular shapes.

The tetrahedron of a corner has its node and the three nodes along the edges that meet there. Its volume
is det J at the corner over six; tissue made of these tetrahedra therefore keeps every corner of every
element from inverting, where J at the quadrature points of the elements does not.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from emgface.face.quality import is_wedge
from emgface.fit.triangulated import Floats, Integers

_HEXAHEDRON: Final = np.array(
    [[0, 1, 3, 4], [1, 2, 0, 5], [2, 3, 1, 6], [3, 0, 2, 7],
     [4, 7, 5, 0], [5, 4, 6, 1], [6, 5, 7, 2], [7, 6, 4, 3]]
)  # fmt: skip
_WEDGE: Final = np.array(
    [[0, 1, 2, 3], [1, 2, 0, 4], [2, 0, 1, 5], [3, 5, 4, 0], [4, 3, 5, 1], [5, 4, 3, 2]]
)
_EQUILATERAL: Final = np.array([[1.0, 0.5, 0.0], [0.0, np.sqrt(0.75), 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class Corners:
    """Corner tetrahedra (n, 4) of a mesh, and the element of each (n,)."""

    nodes: Integers
    element: Integers
    of_wedge: np.ndarray

    @classmethod
    def from_elements(cls, connectivity: Integers) -> "Corners":
        """Return those of elements (m, 8) in VTK order, wedges with -1 in the last columns."""
        wedge = is_wedge(connectivity)
        hexahedra = connectivity[~wedge][:, _HEXAHEDRON].reshape(-1, 4)
        wedges = connectivity[wedge][:, _WEDGE].reshape(-1, 4)
        element = [np.repeat(np.flatnonzero(~wedge), 8), np.repeat(np.flatnonzero(wedge), 6)]
        of_wedge = np.repeat([False, True], [len(hexahedra), len(wedges)])
        nodes = np.concatenate([hexahedra, wedges]).astype(np.int64)
        return cls(nodes, np.concatenate(element), of_wedge)

    def edges(self, q: Floats) -> Floats:
        """Matrices (n, 3, 3) whose columns are the edges at each corner [m]."""
        return (q[self.nodes[:, 1:]] - q[self.nodes[:, :1]]).transpose(0, 2, 1)

    def scaled_jacobians(self, q: Floats) -> Floats:
        """Return det of the edges over the product of their lengths (n,), 1 for ideal corners."""
        A = self.edges(q)
        scaled = np.linalg.det(A) / np.prod(np.linalg.norm(A, axis=1), axis=1)
        return np.where(self.of_wedge, 2.0 / np.sqrt(3.0), 1.0) * scaled

    def rectangular(self, q: Floats) -> Floats:
        """Nearest corners with right angles (60 degrees in wedges), equal edge ratios and volumes.

        The rotation is the one nearest to the unit edges, by singular values.
        """
        A = self.edges(q)
        lengths = np.linalg.norm(A, axis=1)
        ideal = np.where(self.of_wedge[:, None, None], _EQUILATERAL, np.eye(3))
        U, _, Vt = np.linalg.svd(np.einsum("eij,ekj->eik", A / lengths[:, None, :], ideal))
        U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
        W = (U @ Vt) @ ideal * lengths[:, None, :]
        ratio = np.linalg.det(A) / np.linalg.det(W)
        return W * np.clip(ratio, 1e-3, None)[:, None, None] ** (1.0 / 3.0)
