"""R'KR on a fixed pattern: entries that are copied, and products with their targets."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from sim._kernels.triple import congruence
from sim.pattern import Array, Index, Sparsity, SymmetricPattern, distinct

Places = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Congruence:
    """Layout of R'KR for symmetric K on the pattern of points."""

    pattern: Sparsity  #: of the result
    #: as of `sim._kernels.triple.congruence`
    place: Places
    entry: Places
    target: Places
    left: Places
    right: Places

    def add(self, K: Array, R: Array, out: Array) -> None:
        """Add R'KR to values on `pattern`, from values of K and of R."""
        places = self.place, self.entry, self.target, self.left, self.right
        congruence(K, R, *places, out)

    def at(self, keys: Index) -> Index:
        """Places of entries ``row * n + column``, row <= column."""
        p = self.pattern
        row = np.repeat(np.arange(p.n), np.diff(p.indptr))
        return np.searchsorted(row * p.n + p.indices, keys)

    def among(self, columns: Index) -> "Congruence":
        """The same for the upper triangle of a dense matrix over some rows and columns, flat."""
        p, k = self.pattern, len(columns)
        number = np.full(p.n, -1)
        number[columns] = np.arange(k)
        row = np.repeat(number, np.diff(p.indptr))
        column = number[p.indices]
        dense = np.where((row < 0) | (column < 0), -1, k * row + column).astype(np.int32)
        place, target = np.where(self.place < 0, -1, dense[self.place]), dense[self.target]
        used = np.flatnonzero(target >= 0)
        products = (x[used] for x in (self.entry, target, self.left, self.right))
        return Congruence(p, place.astype(np.int32), *products)

    def diagonal_part(self, points: SymmetricPattern) -> "Congruence":
        """The same for a diagonal K."""
        on = np.zeros(points.nnz, dtype=bool)
        on[points.diagonal] = True
        own = np.flatnonzero(on[self.entry])
        number = np.cumsum(on) - 1  # diagonal entries ascend
        return Congruence(
            self.pattern,
            np.ascontiguousarray(self.place[points.diagonal]),
            number[self.entry[own]].astype(np.int32),
            self.target[own],
            self.left[own],
            self.right[own],
        )


def lay_out(points: SymmetricPattern, R: csr_array, constant: Index, more: Index) -> Congruence:
    """Lay out R'KR, with K on the pattern of `points` and the columns of R ascending in every row.

    `constant` (points.n,) is the column of rows that are constant unit vectors, -1 for the others;
    `more` are keys ``row * n + column``, row <= column, of additional entries.
    """
    n = R.shape[1]
    i = np.repeat(np.arange(points.n), np.diff(points.indptr))
    j = points.indices.astype(np.int64)
    simple = (constant[i] >= 0) & (constant[j] >= 0)
    low, high = np.minimum(constant[i], constant[j]), np.maximum(constant[i], constant[j])
    kept = np.flatnonzero(simple)
    keys = low[kept] * n + high[kept]

    other = np.flatnonzero(~simple)
    start, size = R.indptr.astype(np.int64), np.diff(R.indptr).astype(np.int64)
    count = size[i[other]] * size[j[other]]
    entry = np.repeat(other, count)
    within = np.arange(len(entry)) - np.repeat(np.cumsum(count) - count, count)
    left = start[i[entry]] + within // size[j[entry]]
    right = start[j[entry]] + within % size[j[entry]]
    a, b = R.indices[left].astype(np.int64), R.indices[right].astype(np.int64)
    # An off-diagonal entry of K represents two, which are added on the diagonal of the result.
    on_diagonal = i[entry] == j[entry]
    stored = ~on_diagonal | (a <= b)
    twice = np.where(~on_diagonal & (a == b), 2, 1)[stored]
    entry, left, right = (np.repeat(x[stored], twice) for x in (entry, left, right))
    products = np.repeat((np.minimum(a, b) * n + np.maximum(a, b))[stored], twice)

    own = np.arange(n, dtype=np.int64) * (n + 1)
    every = distinct(np.concatenate([keys, products, own, more]))
    indptr = np.searchsorted(every, np.arange(n + 1, dtype=np.int64) * n).astype(np.int32)
    pattern = Sparsity(indptr, (every % n).astype(np.int32), indptr[:-1].astype(np.int64))
    place = np.full(points.nnz, -1, dtype=np.int32)
    place[kept] = np.searchsorted(every, keys)
    target = np.searchsorted(every, products).astype(np.int32)
    return Congruence(pattern, place, *(x.astype(np.int32) for x in (entry, target, left, right)))
