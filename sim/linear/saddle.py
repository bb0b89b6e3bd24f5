"""Solution of the saddle system [[A, G'], [G, 0]] [x, y] = [r, gamma].

Small systems are factorised as they are. For large ones the factor is that of A + G'G/c, which has the
sparsity of A and serves many steps as the preconditioner of an iteration with the saddle matrix itself.
"""

from typing import cast

import numpy as np

from sim.constraints.union import Constraints
from sim.errors import SingularSystem
from sim.linear import Factor, ReusedFactor, linear_solver, symmetric_product
from sim.linear.reused import Timed, untimed
from sim.pattern import Array, Index, Sparsity

# With this compliance the matrix is quasi-definite, and every ordering has a factor (Vanderbei 1995).
COMPLIANCE = 1e-8
# Each refinement reduces the error due to the compliance by about its size.
SADDLE_REFINEMENTS = 12
ACCURACY = 1e-12  # Relative residual at which refinement ends.
# Relative residual above which a solution is refused, and at which that of a correction ends, which is
# small itself.
FAILURE = 1e-7
# Entries of G relative to those of A, and of G'G/c. Thirty times larger: two iterations fewer with a
# factor of the same matrix, and a condition at the limit of single precision, with which a factor takes
# half the time. Three times smaller: three iterations more.
PENALTY = 3e1


class QuasiDefinite:
    """Direct solver of the saddle matrix, by a factor with a small compliance and refinement.

    `weight` are entries of G relative to those of A.
    """

    def __init__(self, constraints: Constraints, weight: float = 1.0) -> None:
        self._rows, self._compliance = constraints.n, COMPLIANCE * weight**2
        self._solver = cast(Factor, linear_solver(indefinite=True))

    @property
    def name(self) -> str:
        """Name of the linear solver."""
        return self._solver.name

    @property
    def solutions_per_factorisation(self) -> int:
        """That of the linear solver."""
        return self._solver.solutions_per_factorisation

    @property
    def negative_pivots(self) -> int | None:
        """Number of negative eigenvalues in addition to the constraints, if the solver provides it.

        It is 0 exactly if A is positive definite on the null space of G.
        """
        count: int | None = getattr(self._solver, "negative_pivots", None)
        return None if count is None else abs(count - self._rows)

    def analyse(self, pattern: Sparsity) -> None:
        """Order and analyse the sparsity of the saddle matrix."""
        self._pattern = pattern
        self._solver.analyse(pattern)

    def factorise(self, values: Array) -> None:
        """Factorise; SingularSystem if the matrix is singular or contains NaN."""
        self._values, diagonal = values, self._pattern.diagonal
        softened = values.copy()
        size = np.abs(values[diagonal[: -self._rows]]).mean()
        softened[diagonal[-self._rows :]] = -self._compliance * size
        self._solver.factorise(softened)

    def approximate(self, rhs: Array) -> Array:
        """Solve with the compliance."""
        return self._solver.solve(rhs)

    def approximate_many(self, rhs: Array) -> Array:
        """As `approximate`, for right-hand sides (k, n)."""
        return self._solver.approximate_many(rhs)

    def solve(self, rhs: Array, accuracy: float = ACCURACY) -> Array:
        """Solve without the compliance, refined until the residual no longer halves.

        `accuracy` is the relative residual at which refinement ends earlier. Raises SingularSystem if a
        solution is not finite, or does not satisfy the equations, because the constraints are
        contradictory or redundant.
        """
        z, size, left = self._solver.solve(rhs), float(np.abs(rhs).max()), np.inf
        for _ in range(SADDLE_REFINEMENTS):
            residual = rhs - symmetric_product(self._pattern, self._values, z)
            before, left = left, float(np.abs(residual).max())
            if left <= accuracy * size or left > 0.5 * before:
                break
            z = z + self._solver.solve(residual)
        if not left <= FAILURE * size:
            raise SingularSystem(
                f"the constrained system was solved to {left / (size or 1.0):.1e} only, expected "
                f"{FAILURE:g}: the constraints are contradictory or linearly dependent"
            )
        return z


class Penalised:
    """Solver of [[A, G'], [G, -c]], the saddle matrix with a compliance c, by a factor of A + G'G/c.

    From G x - c y = s follows y = (G x - s)/c, hence (A + G'G/c) x = r + G's/c. With c small it is a
    preconditioner of the saddle matrix whose eigenvalues are 1, and s/(s + c) with those of G A^-1 G'
    (Benzi, Golub and Liesen 2005, Numerical solution of saddle point problems, section 8). The pattern
    of A contains all pairs of unknowns of a constraint.
    """

    def __init__(self, pattern: Sparsity, constraints: Constraints, factor: Factor) -> None:
        self._constraints, self._own, self._factor = constraints, pattern, factor
        first, column = constraints.rows_of_entries
        counts = np.diff(first)
        pairs: tuple[list[Index], list[Index]] = ([], [])
        for k in np.unique(counts).tolist():
            start = first[:-1][counts == k][:, None]
            for side, own in zip(pairs, np.triu_indices(k), strict=True):
                side.append((start + own).ravel())
        self._one: Index = np.concatenate(pairs[0])
        self._two: Index = np.concatenate(pairs[1])
        ends: Index = np.sort(np.stack([column[self._one], column[self._two]]), axis=0)
        row = np.repeat(np.arange(pattern.n), np.diff(pattern.indptr))
        # rows and columns of a pattern ascend
        self._place: Index = np.searchsorted(
            row * pattern.n + pattern.indices, ends[0] * pattern.n + ends[1]
        )

    @property
    def name(self) -> str:
        """Name of the factor."""
        return self._factor.name

    @property
    def solutions_per_factorisation(self) -> int:
        """That of the factor."""
        return self._factor.solutions_per_factorisation

    def analyse(self, pattern: Sparsity) -> None:
        """Order and analyse the sparsity of A."""
        self._factor.analyse(self._own)

    def factorise(self, values: Array) -> None:
        """Factorise A + G'G/c.

        Raises NotPositiveDefinite if A is not positive definite on the null space of G, or nearly not;
        SingularSystem if the matrix contains NaN.
        """
        A, G = self._constraints.parts_of(values)
        self._G, self._compliance = self._constraints.matrix(G), float(np.abs(G).mean()) or 1.0
        squares = np.bincount(self._place, G[self._one] * G[self._two], self._own.nnz)
        self._factor.factorise(A + squares / self._compliance)

    def approximate(self, rhs: Array) -> Array:
        """Solve with the latest factor in its own precision."""
        r, s = np.split(rhs, [self._own.n])
        x = self._factor.approximate(r + self._G.T @ (s / self._compliance))
        return np.concatenate([x, (self._G @ x - s) / self._compliance])

    def approximate_many(self, rhs: Array) -> Array:
        """As `approximate`, for right-hand sides (k, n)."""
        r, s = np.split(rhs, [self._own.n], axis=1)
        x = self._factor.approximate_many(r + (self._G.T @ (s.T / self._compliance)).T)
        return np.concatenate([x, ((self._G @ x.T).T - s) / self._compliance], axis=1)

    def solve(self, rhs: Array) -> Array:
        """As `approximate`."""
        return self.approximate(rhs)


class Saddle:
    """Solver of saddle systems of one sparsity; the rows of G are scaled relative to A.

    The pattern is that of A. Without a `factor`, for an iteration that reuses factors, every saddle
    matrix is factorised. `iterations` and `factorisations` are of the latest solution.
    """

    def __init__(
        self,
        pattern: Sparsity,
        constraints: Constraints,
        factor: Factor | None = None,
        timed: Timed = untimed,
    ) -> None:
        def direct() -> QuasiDefinite:
            return QuasiDefinite(constraints, self._weight)

        self._weight = 1.0 if factor is None else PENALTY
        self._constraints, self._pattern = constraints, pattern
        self._solver: QuasiDefinite | ReusedFactor = direct()
        if factor is not None:
            self._solver = ReusedFactor(Penalised(pattern, constraints, factor), direct, direct)
            self._solver.timed = timed
        self._timed = timed
        self._solver.analyse(constraints.saddle)
        self._scale: float | None = None
        self._y = np.zeros(constraints.n)
        self.iterations = self.factorisations = 1

    @property
    def name(self) -> str:
        """Name of the linear solver."""
        return self._solver.name

    @property
    def definite(self) -> bool | None:
        """Test if A is positive definite on the null space of G; None if not known exactly."""
        if isinstance(self._solver, ReusedFactor):
            return None if self._solver.definite else False
        return None if self._solver.negative_pivots is None else self._solver.negative_pivots == 0

    def start_over(self) -> None:
        """Discard a factor, its scale and the latest multipliers."""
        self._scale, self._y = None, np.zeros(self._constraints.n)
        if isinstance(self._solver, ReusedFactor):
            self._solver.start_over()

    def forget(self) -> None:
        """Discard a reused factor, so that the next matrix is factorised."""
        if isinstance(self._solver, ReusedFactor):
            self._solver.forget()

    def factorise(self, A: Array, G: Array) -> None:
        """Set the values A of the pattern and G of the constraints; factorise where that is needed.

        Raises SingularSystem if the matrix is singular or contains NaN.
        """
        if self._scale is None or not isinstance(self._solver, ReusedFactor):
            size = np.abs(G).mean() or 1.0
            self._scale = self._weight * float(np.abs(A[self._pattern.diagonal]).mean() / size)
        values = self._constraints.saddle_values(A, self._scale * G)
        if isinstance(self._solver, ReusedFactor):
            self._solver.factorise(values)
            return
        with self._timed("factorisation"):
            self._solver.factorise(values)

    def solve(
        self,
        r: Array,
        gamma: Array,
        start: Array | None = None,
        error: float | None = None,
        *,
        correction: bool = False,
    ) -> tuple[Array, Array]:
        """X (n_free,) and multipliers y (n,) with A x + G' y = r and G x = gamma.

        Raises SingularSystem if the solution is not finite, or does not satisfy the equations, because
        the constraints are contradictory or redundant.

        An iteration begins with `start` (n_free,), by default zero, and the latest multipliers, and
        leaves `error` at most in x, by default 1e-12 of the solution. A direct solution leaves 1e-12 of
        the right-hand side, and as a `correction`, which is small itself, 1e-7.
        """
        assert self._scale is not None  # a matrix has been set
        rhs, solver = np.concatenate([r, self._scale * gamma]), self._solver
        if isinstance(solver, ReusedFactor):
            first = None if start is None else np.concatenate([start, self._y / self._scale])
            z = solver.solve(rhs, first, error)
            self.iterations, self.factorisations = solver.iterations, solver.factorisations
        else:
            with self._timed("solution"):
                z = solver.solve(rhs, FAILURE if correction else ACCURACY)
        x, y = np.split(z, [len(r)])
        y = self._scale * y
        if start is not None:
            self._y = y
        return x, y

    def roughly(self, r: Array) -> Array:
        """X of G x = 0 with an existing factor, of this matrix or a similar one; r (n,) or (k, n)."""
        if not r.size:
            return r.copy()
        rhs = np.concatenate([r, np.zeros((*r.shape[:-1], self._constraints.n))], axis=-1)
        solver = self._solver
        if isinstance(solver, ReusedFactor):
            z = solver.roughly(rhs)
        else:
            z = solver.approximate(rhs) if r.ndim == 1 else solver.approximate_many(rhs)
        return z[..., : r.shape[-1]]
