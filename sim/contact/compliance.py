"""Contact in the space of its rows: how surfaces give way, by a factor of the tissue alone.

What touches changes in every iteration, the tissue does not. With A of the tissue and rows of directions
D with stiffnesses b, Woodbury's identity solves (A + D' diag(b) D) x = r by two solutions with A and a
small dense matrix,

    x = A^-1 (r - D' y),   (D A^-1 D' + diag(1/b)) y = D A^-1 r,

however stiff the rows are.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import LinAlgError, solve
from scipy.sparse import csr_array

from sim.contact.rows import Rows
from sim.pattern import SymmetricPattern
from sim.scene import Index
from sim.state import Array

AT_ONCE = 128
"""Right-hand sides that are solved together."""

Solve = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Directions:
    """Directions in which rows are stiff.

    Attributes
    ----------
    D : (m, n_free) sparse, motion along each by the free unknowns.
    stiffness : (m,) > 0 [N/m].
    """

    D: csr_array
    stiffness: Array

    @classmethod
    def of(cls, pattern: SymmetricPattern, rows: Rows, stiffness: Array) -> "Directions":
        """Normals of those rows (k,) of which the stiffness is not zero [N/m]."""
        stiff = np.flatnonzero(stiffness)
        place = np.full(3 * pattern.n_nodes, -1)
        place[pattern.free] = np.arange(len(pattern.free))
        nodes, k = rows.nodes[stiff], len(stiff)
        column = place[(3 * nodes[:, :, None] + np.arange(3)).reshape(k, 12)]
        entry = rows.weight[stiff][:, :, None] * rows.normal[stiff][:, None, :]
        entry = entry.reshape(k, 12)
        used = (column >= 0) & (entry != 0.0)
        ends = np.r_[0, np.cumsum(used.sum(axis=1))]
        D = csr_array((entry[used], column[used], ends), shape=(k, len(pattern.free)))
        return cls(D, stiffness[stiff])


class Compliance:
    """Motion of unknowns of a surface by unit forces on them, C = E' A^-1 E, found as it is asked for.

    Parameters
    ----------
    n : int
        Number of free unknowns.
    solve_many : callable
        Solutions (k, n) with A for right-hand sides (k, n).
    """

    def __init__(self, n: int, solve_many: Solve) -> None:
        self._solve_many = solve_many
        self._known = np.empty(0, dtype=np.int64)
        self._place = np.full(n, -1)
        self._of_known = np.empty((0, 0))

    def between(self, D: csr_array) -> Array:
        """D A^-1 D' (m, m)."""
        self._extend(np.unique(D.indices).astype(np.int64))
        n = len(self._known)
        near: Any = csr_array((D.data, self._place[D.indices], D.indptr), shape=(D.shape[0], n))
        W: Array = near @ (near @ self._of_known).T
        return 0.5 * (W + W.T)

    def _extend(self, unknowns: Index) -> None:
        """Know these unknowns too."""
        new = unknowns[self._place[unknowns] < 0]
        if not len(new):
            return
        before, n = len(self._known), len(self._known) + len(new)
        self._place[new] = np.arange(before, n)
        self._known = np.r_[self._known, new]
        C = np.empty((n, n))
        C[:before, :before] = self._of_known
        for first in range(0, len(new), AT_ONCE):
            some = new[first : first + AT_ONCE]
            unit = np.zeros((len(some), len(self._place)))
            unit[np.arange(len(some)), some] = 1.0
            at = before + first + np.arange(len(some))
            C[at] = self._solve_many(unit)[:, self._known]
        C[:before, before:] = C[before:, :before].T
        self._of_known = C


def solved_with_rows(
    rhs: Array, directions: Directions, scale: float, compliance: Compliance, solve_one: Solve
) -> Array:
    """Solution (n,) of (A + scale D' diag(stiffness) D) x = rhs.

    Parameters
    ----------
    rhs : (n,)
    directions : Directions
    scale : float
        Of the matrix, by the stiffness.
    compliance : Compliance
        Of A.
    solve_one : callable
        Solution (n,) with A.
    """
    x, D = solve_one(rhs), directions.D
    if D.shape[0] == 0:
        return x
    W = compliance.between(D)
    W[np.diag_indices_from(W)] += 1.0 / (scale * directions.stiffness)
    try:
        y = solve(W, D @ x, assume_a="pos", check_finite=False)
    except LinAlgError:
        # rows that repeat each other, in single precision
        y = np.linalg.lstsq(W, D @ x)[0]
    return x - solve_one(D.T @ y)
