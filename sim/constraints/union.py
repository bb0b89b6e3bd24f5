"""Constraints of a scene on its free unknowns, and the saddle matrix [[A, G'], [G, 0]]."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sim.pattern import Index, Sparsity, SymmetricPattern
from sim.scene import CompiledConstraint
from sim.state import Array


@dataclass(frozen=True, eq=False)
class Constraints:
    """Union of the constraints of a scene."""

    saddle: Sparsity  #: of [[A, G'], [G, 0]] over the free unknowns and the multipliers
    _parts: tuple[CompiledConstraint, ...]
    _rows: tuple[Index, ...]  # constraints of each part that depend on a free unknown
    _entries: tuple[Index, ...]  # entries of G of each part for free unknowns
    _G: csr_array  # with the position of each value in the order of _entries
    _A_place: Index
    _G_place: Index

    @property
    def n(self) -> int:
        """Number of constraints."""
        return self._G.shape[0]

    def evaluate(self, q: Array) -> tuple[Array, Array]:
        """Values c (n,) at positions q (n_nodes, 3), and the entries of G = dc/dw."""
        found = [part.evaluate(q) for part in self._parts]
        c = [value[rows] for (value, _), rows in zip(found, self._rows, strict=True)]
        G = [entry[own] for (_, entry), own in zip(found, self._entries, strict=True)]
        return np.concatenate(c), np.concatenate(G)

    def add_curvature(self, q: Array, multiplier: Array, K: Array) -> None:
        """K += sum_i multiplier_i d2c_i/dq2; follows `evaluate(q)`."""
        first = 0
        for part, rows in zip(self._parts, self._rows, strict=True):
            full = np.zeros(len(part.start) - 1)
            full[rows] = multiplier[first : first + len(rows)]
            part.add_curvature(q, full, K)
            first += len(rows)

    def matrix(self, G: Array) -> csr_array:
        """G (n, n_free) as a sparse array."""
        return csr_array((G, self._G.indices, self._G.indptr), shape=self._G.shape)

    @property
    def rows_of_entries(self) -> tuple[Index, Index]:
        """First entry of every row of G (n + 1,), and the unknowns (k,) of all entries."""
        return self._G.indptr.astype(np.int64), self._G.indices.astype(np.int64)

    def parts_of(self, values: Array) -> tuple[Array, Array]:
        """Values of A and G from those of `saddle_values`."""
        return values[self._A_place], values[self._G_place]

    def saddle_values(self, A: Array, G: Array) -> Array:
        """Values of [[A, G'], [G, 0]] from those of A and G."""
        values = np.zeros(self.saddle.nnz)
        values[self._A_place] = A
        values[self._G_place] = G
        return values


def unite(parts: Sequence[CompiledConstraint], pattern: SymmetricPattern) -> Constraints | None:
    """Restrict the constraints to the free unknowns; None if there are none.

    A constraint that depends only on fixed unknowns is omitted.
    """
    n_free = pattern.n
    number = np.full(3 * pattern.n_nodes, -1, dtype=np.int64)
    number[pattern.free] = np.arange(n_free)
    rows: list[Index] = []
    entries: list[Index] = []
    row_of: list[Index] = []
    column_of: list[Index] = []
    n = 0
    for part in parts:
        row = np.repeat(np.arange(len(part.start) - 1), np.diff(part.start))
        own = np.flatnonzero(number[part.unknown] >= 0)
        kept, compact = np.unique(row[own], return_inverse=True)
        rows.append(kept.astype(np.int64))
        entries.append(own)
        row_of.append(n + compact.astype(np.int64))
        column_of.append(number[part.unknown[own]])
        n += len(kept)
    if n == 0:
        return None
    row, column = np.concatenate(row_of), np.concatenate(column_of)
    indptr = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=n))])
    G = csr_array((np.zeros(len(row)), column, indptr), shape=(n, n_free))

    # Upper triangle by rows: entries of A, followed by those of G', then a zero diagonal.
    a_row = np.repeat(np.arange(n_free), np.diff(pattern.indptr))
    all_row = np.concatenate([a_row, column, n_free + np.arange(n)])
    all_column = np.concatenate([pattern.indices, n_free + row, n_free + np.arange(n)])
    order = np.lexsort((all_column, all_row))
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    counts = np.bincount(all_row, minlength=n_free + n)
    pointer = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    saddle = Sparsity(pointer, all_column[order].astype(np.int32), pointer[:-1].astype(np.int64))
    nnz = pattern.nnz
    return Constraints(
        saddle,
        tuple(parts),
        tuple(rows),
        tuple(entries),
        G,
        place[:nnz],
        place[nnz : nnz + len(row)],
    )
