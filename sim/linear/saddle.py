"""Solution of the saddle system [[A, G'], [G, 0]] [x, y] = [r, gamma] by one factor."""

import numpy as np
from scipy.sparse import csr_array

from sim.constraints.union import Constraints
from sim.errors import SingularSystem
from sim.linear import LinearSolver, linear_solver
from sim.pattern import Array, SymmetricPattern

# With this compliance the matrix is quasi-definite, and every ordering has a factor (Vanderbei 1995).
COMPLIANCE = 1e-8
# Each refinement reduces the error due to the compliance by about its size.
REFINEMENTS = 12
ACCURACY = 1e-12  # Relative residual at which refinement ends.
FAILURE = 1e-7  # Relative residual above which a solution is refused.


class Saddle:
    """Factor of a saddle matrix; the rows of G are scaled to the magnitude of A.

    Parameters
    ----------
    pattern : SymmetricPattern
        Of A.
    constraints : Constraints
        Their sparsity is analysed once.
    linear : str
        Name of a solver for indefinite matrices, or "auto".
    """

    def __init__(
        self, pattern: SymmetricPattern, constraints: Constraints, linear: str = "auto"
    ) -> None:
        self._constraints = constraints
        self._solver: LinearSolver = linear_solver(linear, indefinite=True)
        self._solver.analyse(constraints.saddle)
        self._row = np.repeat(np.arange(pattern.n), np.diff(pattern.indptr))
        self._pattern = pattern

    @property
    def name(self) -> str:
        """Name of the linear solver."""
        return self._solver.name

    @property
    def negative_pivots(self) -> int | None:
        """Number of negative eigenvalues of the latest factor, if the solver provides it.

        It equals the number of constraints exactly if A is positive definite on their null space.
        """
        return getattr(self._solver, "negative_pivots", None)

    def factorise(self, A: Array, G: Array) -> None:
        """Factorise for the values A of the pattern and G of the constraints.

        Raises
        ------
        SingularSystem
            The matrix is singular or contains NaN.
        """
        size = np.abs(G).mean() or 1.0
        self._scale = float(np.abs(A[self._pattern.diagonal]).mean() / size)
        compliance = COMPLIANCE * float(np.abs(A[self._pattern.diagonal]).mean())
        self._solver.factorise(self._constraints.saddle_values(A, self._scale * G, compliance))
        upper = csr_array(
            (A, self._pattern.indices, self._pattern.indptr),
            shape=(self._pattern.n, self._pattern.n),
        )
        self._upper = upper
        self._A_diagonal = A[self._pattern.diagonal]
        self._G = self._constraints.matrix(self._scale * G)

    def solve(self, r: Array, gamma: Array) -> tuple[Array, Array]:
        """X (n_free,) and multipliers y (n,) with A x + G' y = r and G x = gamma.

        Raises
        ------
        SingularSystem
            The solution is not finite, or does not satisfy the equations, because the constraints
            are contradictory or redundant.
        """
        n = len(r)
        rhs = np.concatenate([r, self._scale * gamma])
        z = self._solver.solve(rhs)
        size, left = np.abs(rhs).max(), np.inf
        for _ in range(REFINEMENTS):
            residual = rhs - self._product(z)
            before, left = left, np.abs(residual).max()
            if left <= ACCURACY * size or left > 0.5 * before:
                break
            z = z + self._solver.solve(residual)
        if not left <= FAILURE * size:
            raise SingularSystem(
                f"the constrained system was solved to {left / size:.1e} only, expected {FAILURE:g}: "
                "the conditions contradict or repeat each other"
            )
        return z[:n], self._scale * z[n:]

    def _product(self, z: Array) -> Array:
        n = self._pattern.n
        x, y = z[:n], z[n:]
        Ax = self._upper @ x + self._upper.T @ x - self._A_diagonal * x
        return np.concatenate([Ax + self._G.T @ y, self._G @ x])
