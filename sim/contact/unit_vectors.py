"""Directions of contact rows: the normal and, with friction, two unit vectors across it."""

import numpy as np
from scipy.sparse import csr_array

from sim.contact.compliance import directions
from sim.contact.rows import Rows
from sim.pattern import Flags, SymmetricPattern
from sim.scene import Index
from sim.state import Array


class UnitVectors:
    """Directions of all rows; the normal of each row is followed by two vectors across it.

    Attributes
    ----------
    friction : (k,) coefficient; rows with zero have the normal alone.
    first : (k,) index of the normal of each row.
    contact : (m,) row of each direction.
    """

    def __init__(self, rows: Rows) -> None:
        self._rows, self.friction = rows, rows.friction
        self._size = np.where(rows.friction > 0.0, 3, 1)
        self.first: Index = np.cumsum(self._size) - self._size
        self.contact: Index = np.repeat(np.arange(len(rows)), self._size)
        self._rubs = np.flatnonzero(rows.friction > 0.0)
        self._across = self.first[self._rubs, None] + np.array([1, 2])
        n = rows.normal[self._rubs]
        one = np.cross(n, np.eye(3)[np.abs(n).argmin(axis=1)])
        one /= np.linalg.norm(one, axis=1, keepdims=True)
        self._vectors = np.stack([one, np.cross(n, one)], axis=1)  # (rubbing rows, 2, 3)

    def directions(self, pattern: SymmetricPattern) -> csr_array:
        """D (m, n_free), motion along all directions by the free unknowns."""
        along = self._rows.normal[self.contact]
        along[self._across] = self._vectors
        return directions(pattern, self._rows.take(self.contact), along)

    def of(self, contacts: Index) -> Index:
        """Directions of some rows, in ascending order."""
        return np.flatnonzero(np.isin(self.contact, contacts))

    def is_of(self, contacts: Flags, sticking: Flags) -> Flags:
        """Directions (m,): normals of some rows (k,), and vectors across others."""
        out = sticking[self.contact]
        out[self.first] = contacts
        return out

    def components(self, normal: Array, across: Array) -> Array:
        """Components (m,) of vectors with normal components (k,) and parts (k, 3) across."""
        out = normal[self.contact]
        out[self._across] = np.einsum("kij,kj->ki", self._vectors, across[self._rubs])
        return out

    def vectors(self, components: Array) -> tuple[Array, Array]:
        """Normal components (k,), and parts (k, 3) across, of components (m,)."""
        across = np.zeros((len(self.first), 3))
        across[self._rubs] = np.einsum("kij,ki->kj", self._vectors, components[self._across])
        return components[self.first], across
