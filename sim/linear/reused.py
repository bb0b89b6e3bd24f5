"""Iterative solution with the current matrix, preconditioned by the factor of an older one."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial

import numpy as np

from sim.errors import SingularSystem
from sim.linear.contract import (
    Factor,
    LinearSolver,
    NotPositiveDefinite,
    Operator,
    require_finite_matrix,
    symmetric_product,
)
from sim.linear.equations import Equations
from sim.linear.krylov import Iterate, gmres
from sim.pattern import Index, Sparsity
from sim.state import Array

EXTRA_SOLUTIONS = (
    8  # Additional solutions, compared with a new factor, before an iteration renews it.
)
MOST_SOLUTIONS = 60  # Solutions with a new factor before the matrix itself is factorised.
RELATIVE = 1e-12  # Default accuracy.
NEARLY_SINGULAR = 0.1  # Ritz value below which a matrix is nearly singular and is factorised.
SENSITIVE = 1e-3  # Factor on the requested error if the matrix is not positive definite.

Timed = Callable[[str], AbstractContextManager[None]]  #: context manager that times a phase


def untimed(phase: str) -> AbstractContextManager[None]:
    """Time nothing."""
    return nullcontext()


class NotReached(SingularSystem):
    """The iteration missed its tolerance, and the matrix is not fully assembled."""


class ReusedFactor:
    """GMRES for the current matrix, preconditioned by a factor that is reused while efficient.

    The factor is renewed when the number of solutions, beyond those required with a new factor,
    reaches the cost of a factorisation. The decision is based on counts and not on run times, so
    that results do not depend on the load of the machine. The matrix need not be definite; the
    factor of an indefinite matrix is computed by `indefinite`.

    An older factor does not detect that the matrix has become singular or indefinite, and the
    estimated error is too small if the matrix is softer. If the smallest Ritz value of the
    iteration is below `NEARLY_SINGULAR`, the matrix is therefore factorised. If it is not positive
    definite, remaining errors grow from step to step, and the iteration continues to `SENSITIVE` of
    the requested error.

    `indefinite` returns a solver for indefinite matrices, and `whole` a direct one for failed
    iterations. `iterations` and `factorisations` are of the latest solution; `definite` is True if the
    matrix was positive definite, according to its factor and the iteration; `timed` times the phases
    "factorisation" and "solution".
    """

    def __init__(
        self, factor: Factor, indefinite: Callable[[], Factor], whole: Callable[[], LinearSolver]
    ) -> None:
        self.factor, self._new_indefinite, self._new_whole = factor, indefinite, whole
        self._indefinite: Factor | None = None
        self._whole: LinearSolver | None = None
        self._active: Factor | None = None
        self._inverse: tuple[Index, Array] | None = None  # columns of that of the active factor
        self._fresh: int | None = None
        self._excess = 0
        self.iterations = self.factorisations = 0
        self.definite = True
        self.timed: Timed = untimed

    @property
    def name(self) -> str:
        """Name of the iteration and of the direct solver that preconditions it."""
        return f"gmres_{self.factor.name}"

    def analyse(self, pattern: Sparsity) -> None:
        """Order and analyse the sparsity, once."""
        self._pattern = pattern
        self.factor.analyse(pattern)

    def forget(self) -> None:
        """Discard the factor."""
        self._active = self._inverse = None

    def start_over(self) -> None:
        """Discard the factor and what was learnt from its solutions."""
        self._fresh, self._excess, self.definite = None, 0, True
        self.forget()

    def _for_indefinite(self) -> Factor:
        """Solver for indefinite matrices, analysed on its first use."""
        if self._indefinite is None:
            self._indefinite = self._new_indefinite()
            self._indefinite.analyse(self._pattern)
        return self._indefinite

    def factorise(
        self,
        values: Array,
        product: Operator | None = None,
        to_factorise: Callable[[], Array] | None = None,
    ) -> None:
        """Set the matrix; it is factorised when a solution requires it.

        Raises SingularSystem if the matrix contains NaN or infinity.

        Values (nnz,) are of the pattern; `product` x -> A x is given if the matrix has further terms,
        and `to_factorise` then returns similar values to factorise.
        """
        require_finite_matrix(values)
        self._values, self._product, self._to_factorise = values, product, to_factorise

    def solve(
        self,
        rhs: Array,
        start: Array | None = None,
        error: float | None = None,
        under: Equations | None = None,
    ) -> Array:
        """Solve with the current matrix.

        Raises NotReached if the iteration failed, and the matrix is not fully assembled; SingularSystem
        if the matrix is singular.

        The iteration begins with `start` (n,), by default zero, and ends at an estimated error of the
        largest component, by default 1e-12 of it. The solution satisfies the equations `under` by
        additional forces G'mu.
        """
        self.iterations = self.factorisations = 0
        x = np.zeros(len(rhs)) if start is None else start
        if self._active is None or self._excess >= self._active.solutions_per_factorisation:
            self._renew()
        if self._fresh is not None:
            solution = self._iterate(rhs, x, error, self._fresh + EXTRA_SOLUTIONS, under)
            self._excess += max(solution.iterations - self._fresh, 0)
            if solution.reached and solution.smallest >= NEARLY_SINGULAR:
                return solution.x
            self._renew()
            x = solution.x if np.isfinite(solution.x).all() else x
        solution = self._iterate(rhs, x, error, MOST_SOLUTIONS, under)
        self._fresh = solution.iterations
        # The matrix may be indefinite although its approximation is not.
        self.definite = self.definite and solution.smallest > 0.0
        return solution.x if solution.reached else self._solve_whole(rhs, under)

    def roughly(self, rhs: Array, under: Equations | None = None) -> Array:
        """Solve with the existing factor of a similar matrix, rhs (n,) or (k, n).

        With G x = 0 for the equations `under`.
        """
        assert self._active is not None  # computed by a solution
        rhs = rhs if under is None else under.without_forces(rhs)
        one = rhs.ndim == 1
        x = self._active.approximate(rhs) if one else self._active.approximate_many(rhs)
        return x if under is None else under.kept(x, self._columns(under))

    def _columns(self, under: Equations) -> Array:
        """P^-1 E (k, n) of the active factor for the components of equations."""
        assert self._active is not None  # callers have computed a factor
        if self._inverse is None or not np.array_equal(self._inverse[0], under.columns):
            unit = under.unit(self._pattern.n)
            self._inverse = under.columns, self._active.approximate_many(unit)
        return self._inverse[1]

    def _iterate(
        self, rhs: Array, x: Array, error: float | None, limit: int, under: Equations | None
    ) -> Iterate:
        assert self._active is not None  # callers have computed a factor
        factor = self._active

        def entries(x: Array) -> Array:
            return symmetric_product(self._pattern, self._values, x)

        product, precondition = self._product or entries, factor.approximate
        with self.timed("solution"):
            if error is None:
                error = RELATIVE * float(np.abs(factor.approximate(rhs)).max())
            elif not self.definite:
                error *= SENSITIVE
            if under is not None:
                x = under.solved(x, self._columns(under))
                precondition = partial(self.roughly, under=under)
            solution = gmres(product, precondition, rhs, x, error, limit)
        self.iterations += solution.iterations
        return solution

    def _renew(self) -> None:
        """Factorise the current matrix, or its approximation."""
        values = self._values if self._to_factorise is None else self._to_factorise()
        self._fresh, self._excess = None, 0
        self.forget()
        with self.timed("factorisation"):
            self.factorisations += 1
            if not self.definite and hasattr(self._for_indefinite(), "negative_pivots"):
                # With active muscles, a matrix remains indefinite for many steps.
                active = self._for_indefinite()
                active.factorise(values)
                self._active = active
                self.definite = getattr(active, "negative_pivots", 0) == 0
                return
            try:
                self.factor.factorise(values)
                self._active, self.definite = self.factor, True
            except NotPositiveDefinite:
                active = self._for_indefinite()
                active.factorise(values)
                self.factorisations += 1
                self._active, self.definite = active, False

    def _solve_whole(self, rhs: Array, under: Equations | None) -> Array:
        """Solve by a factor of the matrix itself."""
        if self._product is not None:
            raise NotReached(
                f"the linear iteration did not reach its tolerance in {self.iterations} solutions, "
                "expected a matrix that its preconditioner approximates better: choose a direct solver"
            )
        if self._whole is None:
            self._whole = self._new_whole()
            self._whole.analyse(self._pattern)
        with self.timed("factorisation"):
            self._whole.factorise(self._values)
            self.factorisations += 1
        with self.timed("solution"):
            self.iterations += 1
            x = self._whole.solve(rhs)
            if under is None:
                return x
            unit = under.unit(len(rhs))
            return under.solved(x, np.array([self._whole.solve(e) for e in unit]))
