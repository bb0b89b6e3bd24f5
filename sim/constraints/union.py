"""Constraints of a scene on its velocities w, and the saddle matrix [[A, G'], [G, 0]].

With v = R w + gamma the derivatives by w are those by the points times R.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sim.kinematics import Kinematics
from sim.pattern import Index, Sparsity
from sim.scene import CompiledConstraint
from sim.state import Array, Pose


@dataclass(frozen=True, eq=False)
class Constraints:
    """Union of the constraints of a scene."""

    saddle: Sparsity  #: of [[A, G'], [G, 0]] over the velocities and the multipliers
    _parts: tuple[CompiledConstraint, ...]
    _rows: tuple[Index, ...]  # constraints of each part that depend on a velocity
    _kinematics: Kinematics
    # entries of G are sums of products of a derivative by a point and an entry of R
    _slope: Index  # numbers of the derivatives of all parts
    _entry: Index  # places of the entries of R
    _sum: Index  # entries of G
    _G: csr_array  # sparsity of G
    _A_place: Index
    _G_place: Index

    @property
    def n(self) -> int:
        """Number of constraints."""
        return self._G.shape[0]

    def evaluate(self, pose: Pose) -> tuple[Array, Array]:
        """Values c (n,) at a pose, and the entries of G = dc/dw."""
        parts = [part.evaluate(pose.q) for part in self._parts]
        c = [value[rows] for (value, _), rows in zip(parts, self._rows, strict=True)]
        slopes = np.concatenate([entry for _, entry in parts])[self._slope]
        slopes *= self._kinematics.matrix(pose).data[self._entry]
        G = np.bincount(self._sum, slopes, self._G.nnz).astype(np.float64)
        return np.concatenate(c), G

    def drift(self, pose: Pose, t: float) -> Array:
        """Rates (n,) of c at a pose by the motions that are prescribed at a time [s]."""
        gamma = self._kinematics.drift(pose, t)
        if gamma is None:
            return np.zeros(self.n)
        rates = list[Array]()
        for part, rows in zip(self._parts, self._rows, strict=True):
            _, entry = part.evaluate(pose.q)
            own = np.repeat(np.arange(len(part.start) - 1), np.diff(part.start))
            moved = entry * gamma.reshape(-1)[part.unknown]
            rate = np.bincount(own, moved, len(part.start) - 1).astype(np.float64)
            rates.append(rate[rows])
        return np.concatenate(rates)

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


def unite(
    parts: Sequence[CompiledConstraint], kinematics: Kinematics, rest: Pose
) -> Constraints | None:
    """Express the constraints in the velocities; None if there are none.

    A constraint that depends on no free node is omitted: an element of attached and fixed nodes alone
    has the volume that its bodies give it.
    """
    R, pattern = kinematics.matrix(rest), kinematics.pattern
    n_free, bodies = pattern.n, kinematics.body_columns(len(rest.frames))
    first = int(bodies[bodies >= 0].min(initial=n_free))  # the velocities of nodes precede it
    rows: list[Index] = []
    parts_of: list[tuple[Index, Index, Index, Index]] = []  # slope, entry of R, row, column
    n = slopes = 0
    for part in parts:
        row = np.repeat(np.arange(len(part.start) - 1), np.diff(part.start))
        count = np.diff(R.indptr)[part.unknown].astype(np.int64)
        ends = np.cumsum(count)
        slope = np.repeat(np.arange(len(row)), count)
        entry = np.repeat(R.indptr[part.unknown] - ends + count, count) + np.arange(len(slope))
        column = R.indices[entry].astype(np.int64)
        kept = np.unique(row[slope[column < first]])
        own = np.isin(row[slope], kept)
        number = n + np.searchsorted(kept, row[slope[own]])
        parts_of.append((slopes + slope[own], entry[own], number, column[own]))
        rows.append(kept.astype(np.int64))
        n, slopes = n + len(kept), slopes + len(row)
    if n == 0:
        return None
    slope, entry, row, column = map(np.concatenate, zip(*parts_of, strict=True))
    key, place_of_sum = np.unique(row * n_free + column, return_inverse=True)
    row, column = key // n_free, key % n_free
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
        kinematics,
        slope,
        entry,
        place_of_sum.ravel(),
        G,
        place[:nnz],
        place[nnz : nnz + len(row)],
    )
