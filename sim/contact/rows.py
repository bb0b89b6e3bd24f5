"""Contact rows, each of one vertex and one face, and the assembly of their stiffness.

Of the relative displacement r of vertex and face since the start of the step, a row contains the
gap g = gap0 + n . r at the end of the step.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.errors import ContactFailure
from sim.pattern import SymmetricPattern
from sim.scene import Index
from sim.state import Array

Flags = NDArray[np.bool_]

FIRST = np.array([0, 0, 0, 0, 1, 1, 1, 2, 2, 3])
SECOND = np.array([0, 1, 2, 3, 1, 2, 3, 2, 3, 3])

NEAREST, ENTERED, WALL, GIVEN_UP, NO_RANK = 0, 1, 2, 3, 4
"""Ranks of rows."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Contact constraints of vertices and faces.

    Attributes
    ----------
    slot : (k,) index of the vertex in the contact memory.
    place : (k,) index of the opposite feature: a triangle, an edge, or a vertex.
    rank : (k,) 0 for the nearest faces of a vertex, larger for rows of lower priority.
    nodes, weight : (k, 4) the vertex with weight 1, then the nodes of the face with minus their
        barycentric weights; those of a shell have weight zero and repeat a node of the other.
    normal : (k, 3) outward normal of the opposite face.
    gap : (k,) gap at the end of the step without motion of the mesh [m].
    carried : (k, 3) displacement of a rigid face over the step, or minus that of a rigid vertex [m].
    friction : (k,) coefficient.
    pairing : (k,) index of the pairing.
    """

    slot: Index
    place: Index
    rank: Index
    nodes: Index
    weight: Array
    normal: Array
    gap: Array
    carried: Array
    friction: Array
    pairing: Index

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.slot)

    def displacement(self, u: Array) -> Array:
        """Relative displacement r (k, 3) for nodal displacements u (n_nodes, 3) since the start."""
        return np.einsum("kj,kji->ki", self.weight, u[self.nodes]) - self.carried

    def gaps(self, u: Array) -> Array:
        """Gaps (k,) for nodal displacements u [m]."""
        return self.gap + np.einsum("ki,ki->k", self.normal, self.displacement(u))

    def foremost(self) -> Index:
        """Rows of the lowest rank of every vertex."""
        lowest = np.full(int(self.slot.max(initial=-1)) + 1, NO_RANK)
        np.minimum.at(lowest, self.slot, self.rank)
        return np.flatnonzero(self.rank == lowest[self.slot])

    def spread(self, force: Array, n_nodes: int) -> Array:
        """Nodal forces (n_nodes, 3) of the forces (k, 3) on the vertices."""
        at = self.nodes.ravel()
        parts = (self.weight[:, :, None] * force[:, None, :]).reshape(-1, 3)
        out = np.empty((n_nodes, 3))
        for i in range(3):
            out[:, i] = np.bincount(at, parts[:, i], n_nodes)
        return out

    def take(self, which: Index) -> "Rows":
        """Selection of rows."""
        return Rows(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def joined(self, other: "Rows") -> "Rows":
        """Concatenation of these and other rows."""
        names = self.__dataclass_fields__
        return Rows(*(np.concatenate([getattr(self, n), getattr(other, n)]) for n in names))

    @property
    def keys(self) -> Index:
        """Unique integer (k,) of vertex and feature."""
        return self.slot * (1 << 32) + self.place

    def without(self, others: "Rows") -> "Rows":
        """Rows whose vertex and feature do not occur in other rows."""
        return self.take(np.flatnonzero(~np.isin(self.keys, others.keys)))


class RowPlaces:
    """Positions of the blocks of rows in the values of a pattern.

    Parameters
    ----------
    pattern : SymmetricPattern
    rows : Rows
    names : names of the pairings, for the message.
    reach : float
        Declared reach, for the message [m].
    """

    def __init__(
        self, pattern: SymmetricPattern, rows: Rows, names: tuple[str, ...], reach: float
    ) -> None:
        a, b = rows.nodes[:, FIRST], rows.nodes[:, SECOND]
        self._product = rows.weight[:, FIRST] * rows.weight[:, SECOND]
        used = self._product != 0.0
        keys = np.minimum(a, b) * pattern.n_nodes + np.maximum(a, b)
        place = np.minimum(
            pattern.pair_index(keys.ravel()).reshape(keys.shape), len(pattern.pairs) - 1
        )
        lost = used & (pattern.pairs[place] != keys)
        # A row need not become active.
        self._lost = lost.any(axis=1)
        self._rows, self._names, self._reach = rows, names, reach
        self._row, self._entry = np.nonzero(used & ~lost)
        self._target = pattern.target[place[self._row, self._entry]]
        self._nnz = pattern.nnz

    def add(self, block: Array, scale: float, values: Array) -> None:
        """Values += scale sum over rows of the blocks (k, 3, 3) between all nodes of a row.

        Raises
        ------
        ContactFailure
            The pattern does not contain the nodes of a row with a block.
        """
        lost = np.flatnonzero(self._lost & block.any(axis=(1, 2)))
        if len(lost):
            vertex, *face = self._rows.nodes[lost[0]].tolist()
            name = self._names[int(self._rows.pairing[lost[0]])]
            raise ContactFailure(
                f"node {vertex} and the face of nodes {face} of pairing {name!r} are in "
                f"contact, but their distance at rest exceeds the reach of {self._reach:g} "
                "m: increase the reach of the contact",
                surface=name,
                node=vertex,
            )
        parts = (
            scale * self._product[self._row, self._entry, None] * block.reshape(-1, 9)[self._row]
        )
        # The pattern stores only the upper triangle of a pair of two nodes.
        stored = (self._target >= 0) & (parts != 0.0)
        values += np.bincount(self._target[stored], parts[stored], self._nnz)
