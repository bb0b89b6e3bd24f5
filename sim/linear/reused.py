"""Solution with the present matrix by the factor of an older one."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

import numpy as np

from sim.errors import SingularSystem
from sim.linear.contract import Factor, LinearSolver, NotPositiveDefinite, symmetric_product
from sim.linear.gmres import Iterate, gmres
from sim.pattern import Sparsity
from sim.state import Array

PATIENCE = 8  # solutions beyond those with a new factor, before an iteration renews it
LIMIT = 60  # solutions with a new factor, before the matrix itself is factorised
RELATIVE = 1e-12  # accuracy where no error is asked for


class ReusedFactor:
    """GMRES on the matrix at hand, preconditioned by a factor that serves as long as it pays.

    The factor is renewed when the solutions spent since it was made, beyond those that a new factor
    needs, add up to the cost of a factorisation. The decision rests on counts alone, never on clock
    times, so that results do not depend on the load of the machine. The matrix need not be definite;
    where one to be factorised is not, its factor comes from `indefinite`.

    Parameters
    ----------
    factor : Factor
        Makes the factors.
    indefinite : callable
        Makes, on demand, a solver that factorises what is not positive definite.
    whole : callable
        Makes, on demand, the direct solver that stands in where the iteration fails.

    Attributes
    ----------
    iterations, factorisations : int
        Of the latest solution.
    definite : bool
        Whether the latest factorised matrix was positive definite.
    timed : callable
        Context manager to time the phases "factorisation" and "solution" with.
    """

    def __init__(
        self,
        factor: Factor,
        indefinite: Callable[[], Factor],
        whole: Callable[[], LinearSolver],
    ) -> None:
        self.factor, self._new_indefinite, self._new_whole = factor, indefinite, whole
        self._indefinite: Factor | None = None
        self._whole: LinearSolver | None = None
        self._active: Factor | None = None
        self._fresh: int | None = None
        self._excess = 0
        self.iterations = self.factorisations = 0
        self.definite = True
        self.timed: Callable[[str], AbstractContextManager[None]] = _untimed

    @property
    def name(self) -> str:
        """Name of the iteration and of the direct solver that preconditions it."""
        return f"gmres_{self.factor.name}"

    def analyse(self, pattern: Sparsity, nearby: Sparsity | None = None) -> None:
        """Analyse the pattern of the factors: the matrix's, or one nearby with fewer entries."""
        self._pattern, self._nearby = pattern, nearby
        self.factor.analyse(nearby or pattern)

    def forget(self) -> None:
        """Drop the factor, as when it was made for something else."""
        self._active = None

    def factorise(self, values: Array, near: Callable[[], Array] | None = None) -> None:
        """Take the matrix to solve with; a factor is made when a solution needs one.

        Parameters
        ----------
        values : (nnz,) of the pattern.
        near : callable, optional
            Values of the nearby matrix, asked for when a factor is made.

        Raises
        ------
        SingularSystem
            The matrix holds NaN or infinity.
        """
        if not np.isfinite(values).all():
            raise SingularSystem("the matrix holds NaN or infinity, expected finite values")
        self._values = values
        self._near = near or (lambda: values)
        # without values for its pattern a nearby factor cannot be made, and the matrix has its own
        self._is_direct = near is None and self._nearby is not None

    def solve(self, rhs: Array, start: Array | None = None, error: float | None = None) -> Array:
        """Solve with the matrix at hand.

        Parameters
        ----------
        rhs : (n,)
        start : (n,) where the iteration begins, zero by default.
        error : float, optional
            Largest error of a component of the solution, as the iteration estimates it; by default
            1e-12 of the largest component.

        Raises
        ------
        SingularSystem
            The matrix is singular.
        """
        self.iterations = self.factorisations = 0
        if self._is_direct:
            return self._solve_whole(rhs)
        x = np.zeros(len(rhs)) if start is None else start
        if self._active is None or self._excess >= self._active.solutions_per_factorisation:
            self._renew()
        if self._fresh is not None:
            found = self._iterate(rhs, x, error, self._fresh + PATIENCE)
            self._excess += max(found.iterations - self._fresh, 0)
            if found.reached:
                return found.x
            self._renew()
            x = found.x if np.isfinite(found.x).all() else x
        found = self._iterate(rhs, x, error, LIMIT)
        self._fresh = found.iterations
        return found.x if found.reached else self._solve_whole(rhs)

    def _iterate(self, rhs: Array, x: Array, error: float | None, limit: int) -> Iterate:
        assert self._active is not None  # callers have made a factor
        factor = self._active

        def product(x: Array) -> Array:
            return symmetric_product(self._pattern, self._values, x)

        with self.timed("solution"):
            if error is None:
                error = RELATIVE * float(np.abs(factor.approximate(rhs)).max())
            found = gmres(product, factor.approximate, rhs, x, error, limit)
        self.iterations += found.iterations
        return found

    def _renew(self) -> None:
        """Factorise the matrix at hand, or the one nearby."""
        values, self._fresh, self._excess = self._near(), None, 0
        with self.timed("factorisation"):
            self.factorisations += 1
            try:
                self.factor.factorise(values)
                self._active, self.definite = self.factor, True
            except NotPositiveDefinite:
                if self._indefinite is None:
                    self._indefinite = self._new_indefinite()
                    self._indefinite.analyse(self._nearby or self._pattern)
                self._indefinite.factorise(values)
                self.factorisations += 1
                self._active, self.definite = self._indefinite, False

    def _solve_whole(self, rhs: Array) -> Array:
        """Solve by a factor of the matrix itself."""
        if self._whole is None:
            self._whole = self._new_whole()
            self._whole.analyse(self._pattern)
        with self.timed("factorisation"):
            self._whole.factorise(self._values)
            self.factorisations += 1
        with self.timed("solution"):
            self.iterations += 1
            return self._whole.solve(rhs)


def _untimed(phase: str) -> AbstractContextManager[None]:
    return nullcontext()
