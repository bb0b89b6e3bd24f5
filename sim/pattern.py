"""Fixed sparsity: free unknowns, and positions of the 3 x 3 block of a node pair."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Sparsity:
    """Upper triangle, by rows, of a symmetric matrix."""

    #: rows of the upper triangle, columns ascending, the diagonal always present and first
    indptr: NDArray[np.int32]
    indices: NDArray[np.int32]
    diagonal: Index  #: (n,) positions of the diagonal in the values

    @property
    def n(self) -> int:
        """Number of rows."""
        return len(self.diagonal)

    @property
    def nnz(self) -> int:
        """Number of stored entries (upper triangle)."""
        return len(self.indices)


@dataclass(frozen=True)
class SymmetricPattern(Sparsity):
    """Sparsity over the free unknowns, and positions of the blocks of node pairs."""

    free: Index  #: (n_free,) indices of the free unknowns among 3 n_nodes
    pairs: Index  #: (n_pairs,) keys ``a * n_nodes + b`` of the node pairs a <= b, ascending
    #: (n_pairs, 9) position of each block entry in the values, -1 where it is not stored
    target: NDArray[np.int32]
    n_nodes: int

    def pair_index(self, keys: Index) -> Index:
        """Rows of `target` for node-pair keys that are part of the pattern."""
        return np.searchsorted(self.pairs, keys).astype(np.int64)


def distinct(keys: Index) -> Index:
    """Unique keys (m,), ascending; 40 times faster than NumPy's `unique` for millions."""
    keys = np.sort(keys)
    new = np.ones(len(keys), dtype=bool)
    np.not_equal(keys[1:], keys[:-1], out=new[1:])
    return keys[new]


def symmetric_pattern(n_nodes: int, keys: Index, fixed: Index) -> SymmetricPattern:
    """Pattern over all free unknowns, from the node pairs of all terms.

    `keys` (m,) are ``a * n_nodes + b`` with a <= b, in any order and with repetitions; `fixed` are the
    fixed ones of 3 n_nodes unknowns.
    """
    number = np.zeros(3 * n_nodes, dtype=np.int64)
    number[fixed] = -1
    free = np.flatnonzero(number == 0)
    number[free] = np.arange(len(free))

    own = np.arange(n_nodes, dtype=np.int64) * (n_nodes + 1)
    pairs = distinct(np.concatenate([keys, own]))
    a, b = np.divmod(pairs, n_nodes)
    i, j = np.divmod(np.arange(9), 3)
    row = number[3 * a[:, None] + i]
    column = number[3 * b[:, None] + j]
    # Free unknowns are in the order of the nodes: only blocks (a, a) have entries below the diagonal.
    stored = (row >= 0) & (column >= row)
    order = np.argsort(row[stored] * (len(free) + 1) + column[stored], kind="stable")
    position = np.empty(len(order), dtype=np.int32)
    position[order] = np.arange(len(order), dtype=np.int32)
    target = np.full(stored.shape, -1, dtype=np.int32)
    target[stored] = position
    indices = column[stored][order].astype(np.int32)
    counts = np.bincount(row[stored], minlength=len(free))
    indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return SymmetricPattern(
        indptr, indices, indptr[:-1].astype(np.int64), free, pairs, target, n_nodes
    )
