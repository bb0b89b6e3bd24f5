"""SciPy's SuperLU: available everywhere, unsymmetric, new ordering at every factorisation."""

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from sim.errors import SingularSystem
from sim.linear.contract import NotPositiveDefinite, require_finite_matrix, require_finite_solution
from sim.pattern import Sparsity
from sim.state import Array


class SuperLU:
    """Direct solver of `scipy.sparse.linalg.splu` on the full symmetric matrix."""

    name = "superlu"
    _pivot_threshold = 0.0
    _symmetric = True

    @property
    def solutions_per_factorisation(self) -> int:
        """Also that of the analysis, which SuperLU repeats."""
        return 40

    def analyse(self, pattern: Sparsity) -> None:
        """Lay out the full matrix and the positions of the values in it."""
        n = pattern.n
        row = np.repeat(np.arange(n), np.diff(pattern.indptr))
        column = pattern.indices.astype(np.int64)
        off = row != column
        rows = np.concatenate([row, column[off]])
        columns = np.concatenate([column, row[off]])
        source = np.concatenate([np.arange(len(row)), np.flatnonzero(off)])
        order = np.lexsort((rows, columns))
        self._source = source[order]
        self._indices = rows[order].astype(np.int32)
        self._indptr = np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=n))]).astype(
            np.int32
        )
        self._n = n

    def factorise(self, values: Array) -> None:
        """LU with a symmetric minimum-degree ordering.

        Raises NotPositiveDefinite if a pivot is not positive or off the diagonal, without partial
        pivoting; SingularSystem if the matrix is singular or contains NaN.
        """
        require_finite_matrix(values)
        full = csc_array(
            (values[self._source], self._indices, self._indptr), shape=(self._n, self._n)
        )
        try:
            self._factor = splu(
                full,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=self._pivot_threshold,
                options={"SymmetricMode": self._symmetric},
            )
        except RuntimeError as error:
            raise SingularSystem(f"SuperLU could not factorise the matrix ({error})") from error
        if not self._symmetric:
            return
        # Pivots on the diagonal are those of L D L', which have the signs of the eigenvalues.
        on_diagonal = (self._factor.perm_r == self._factor.perm_c).all()
        if not (on_diagonal and (self._factor.U.diagonal() > 0.0).all()):
            raise NotPositiveDefinite(
                "SuperLU met a non-positive pivot, expected a positive definite matrix"
            )

    def solve(self, rhs: Array) -> Array:
        """Solve with the latest factor.

        Raises SingularSystem if the solution is not finite.
        """
        x = self._factor.solve(rhs)
        require_finite_solution(x)
        return x

    def approximate(self, rhs: Array) -> Array:
        """As `solve`."""
        return self.solve(rhs)

    def approximate_many(self, rhs: Array) -> Array:
        """As `solve`, for right-hand sides (k, n)."""
        return self.solve(np.asfortranarray(rhs.T)).T


class PivotingSuperLU(SuperLU):
    """SuperLU with partial pivoting, for matrices that are not positive definite."""

    name = "superlu_pivoting"
    _pivot_threshold = 1.0
    _symmetric = False
