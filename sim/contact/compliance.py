"""Contact compliances, and the Delassus matrix of contact forces, (6) of docs/step.md.

The contacts change in every iteration, but the tissue does not. With the compliance C of the
unknowns of a surface and rows of directions D, forces f of the rows open them by W f with W = D C
D', so that the active rows and their forces follow from a small dense matrix (`sim.contact.cone`)
for any size of the tissue.

A compliance is used longer than the factor from which it was computed. As the stiffness of the
tissue changes, each displacement u = C f by a newer factor updates it,

    C <- C - C f f' C / (f' C f) + u u' / (f' u),

the update of Broyden, Fletcher, Goldfarb and Shanno for a matrix that maps f to u (Nocedal and
Wright, Numerical Optimization, equation 6.19 with C as the Hessian), which remains positive
definite.
"""

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array, vstack

from sim.scene import Index
from sim.state import Array

COLUMNS_AT_ONCE = 128  #: number of right-hand sides solved together
KNOWN = 0.1  #: relative error below which updates are skipped
LEARNT = 64  #: number of updates stored with the matrix

Solve = Callable[[Array], Array]


def learnt(f: Array, r: Array, Wf: Array, known: float) -> tuple[float, float, Array | None]:
    """Update (m, m) of a Delassus matrix W such that forces f (m,) move the rows by r (m,).

    Returns the largest error of W f before it, the largest of these motions, and the update, which is
    None if the error is below the share `known`, or W would not remain positive definite.
    """
    fr, fWf = float(f @ r), float(f @ Wf)
    missed, size = (float(np.abs(x).max(initial=0.0)) for x in (r - Wf, r))
    if missed > known * size and fr > 0.0 and fWf > 0.0:
        return missed, size, np.outer(r / fr, r) - np.outer(Wf / fWf, Wf)
    return missed, size, None


class Compliance:
    """Compliance C = E' H E of the unknowns of a surface, computed on demand.

    `solve_many` gives the displacements H f (k, n) [m] of the current tissue by forces f (k, n) [N]; it
    is updated with the tissue.
    """

    def __init__(self, n: int, solve_many: Solve) -> None:
        self.solve_many = solve_many
        self._known = np.empty(0, dtype=np.int64)
        self._place = np.full(n, -1)
        self._found = np.empty((0, 0))
        # Later updates are a sum of dyads, C = found + more' more - less' less.
        self._n_learnt = 0
        self._dyads = np.zeros((2, LEARNT, 0))

    def between(self, D: csr_array, other: csr_array) -> Array:
        """D C other' (m, k)."""
        self.expect(D)
        self.expect(other)
        one, two = self._near(D), self._near(other)
        more, less = self._learnt
        product: Array = one @ (two @ self._found).T
        return product + (one @ more.T) @ (two @ more.T).T - (one @ less.T) @ (two @ less.T).T

    def learn(self, f: Array, u: Array) -> None:
        """BFGS update such that C f = u, on computed unknowns (n,)."""
        f, u = f[self._known], u[self._known]
        more, less = self._learnt
        Cf = self._found @ f + (more @ f) @ more - (less @ f) @ less
        fu, fCf = float(f @ u), float(f @ Cf)
        if not (fu > 0.0 and fCf > 0.0):
            return
        self._dyads[:, self._n_learnt] = u / np.sqrt(fu), Cf / np.sqrt(fCf)
        self._n_learnt += 1
        if self._n_learnt == LEARNT:
            more, less = self._learnt
            self._found += more.T @ more - less.T @ less
            self._n_learnt = 0

    @property
    def _learnt(self) -> Array:
        """Dyads to be added and subtracted (2, m, k)."""
        return self._dyads[:, : self._n_learnt]

    def _near(self, D: csr_array) -> csr_array:
        """Directions (m, k) restricted to the computed unknowns."""
        shape = (D.shape[0], len(self._known))
        return csr_array((D.data, self._place[D.indices], D.indptr), shape=shape)

    def expect(self, D: csr_array) -> None:
        """Precompute the compliance columns required by these directions."""
        new = np.unique(D.indices[self._place[D.indices] < 0]).astype(np.int64)
        if len(new):
            self._extend(new)

    def _extend(self, new: Index) -> None:
        """Compute the columns of these unknowns."""
        before, n = len(self._known), len(self._known) + len(new)
        self._place[new] = np.arange(before, n)
        self._known = np.r_[self._known, new]
        C = np.empty((n, n))
        C[:before, :before] = self._found
        for first in range(0, len(new), COLUMNS_AT_ONCE):
            some = new[first : first + COLUMNS_AT_ONCE]
            unit = np.zeros((len(some), len(self._place)))
            unit[np.arange(len(some)), some] = 1.0
            at = before + first + np.arange(len(some))
            C[at] = self.solve_many(unit)[:, self._known]
        C[:before, before:] = C[before:, :before].T
        self._found = C
        self._dyads = np.concatenate([self._dyads, np.zeros((2, LEARNT, len(new)))], axis=2)


class DelassusMatrix:
    """Delassus matrix W = D C D' of the rows of a step [m/N], computed for active rows.

    D (m, n) has the directions of all rows.
    """

    def __init__(self, D: csr_array, compliance: Compliance) -> None:
        self._all, self._compliance = D, compliance
        self._known = np.empty(0, dtype=np.int64)
        self._place = np.full(D.shape[0], -1)
        self._expected = np.zeros(D.shape[0], dtype=bool)
        self._directions: csr_array = D[self._known]
        self._between = np.empty((0, 0))

    def expect(self, rows: Index) -> None:
        """Precompute the columns of rows that may become active."""
        new = rows[~self._expected[rows]]
        if len(new):
            self._compliance.expect(self._all[new])
            self._expected[new] = True

    def among(self, rows: Index) -> Array:
        """W (k, k) between some rows."""
        new = rows[self._place[rows] < 0]
        if len(new):
            self._between = self.with_other_rows(self._all[new], self._known)
            n = len(new)
            self._between = np.roll(self._between, (-n, -n), axis=(0, 1))
            self._place[new] = np.arange(len(self._known), len(self._known) + n)
            self._known = np.r_[self._known, new]
            self._directions = self._all[self._known]
        at = self._place[rows]
        return self._between[at[:, None], at]

    def with_other_rows(self, D: csr_array, rows: Index) -> Array:
        """W between directions D (m, n) other than the rows, and some rows."""
        every = vstack([D, self._all[rows]], format="csr")
        # The smaller matrix is multiplied with the whole compliance.
        blocks = self._compliance.between(every, D)
        own, cross = np.split(blocks, [D.shape[0]])
        return np.block([[0.5 * (own + own.T), cross.T], [cross, self.among(rows)]])

    def learn(self, forces: Array, motion: Array) -> tuple[float, float]:
        """Update such that forces (m,) of computed rows cause a displacement (n,).

        Returns the largest error of the compliance before the update, and the largest displacement
        of a row [m].
        """
        f, r = forces[self._known], self._directions @ motion
        missed, size, more = learnt(f, r, self._between @ f, KNOWN)
        if more is not None:
            self._between += more
            self._compliance.learn(self._directions.T @ f, motion)
        return missed, size
