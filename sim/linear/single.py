"""Factor in single precision, with refinement to double."""

import numpy as np

from sim.linear.contract import NotPositiveDefinite, symmetric_product
from sim.linear.pardiso import Pardiso
from sim.pattern import Sparsity
from sim.state import Array

REFINED = 1e-14  # Relative correction at which the refinement ends.
ENOUGH = 1e-11  # Relative correction that is accepted if rounding ends the refinement earlier.
REFINEMENTS = 10
TRUSTED = 0.1  # Largest accepted error of a solution without refinement.


class SinglePardiso:
    """PARDISO's Cholesky factor in single precision: half the memory, half the time of a solution.

    `solve` refines iteratively, x <- x + L^-T L^-1 (b - A x) with the residual in double precision,
    to the accuracy of a factor in double precision; `approximate` does not refine. After a matrix
    that is too ill-conditioned for single precision, factors are computed in double precision.

    Source: Wilkinson's iterative refinement in mixed precision, Buttari et al. 2008, Using mixed
    precision for sparse matrix computations, ACM Trans. Math. Softw. 34(4), Algorithm 1; it converges
    while the condition number is well below 1e7.
    """

    name = "pardiso_single"

    def __init__(self) -> None:
        self._factor = self._single = Pardiso(np.float32)
        self._double: Pardiso | None = None
        self._is_single = True

    def analyse(self, pattern: Sparsity) -> None:
        """Order the unknowns and find the structure of the factor."""
        self._pattern = pattern
        self._factor.analyse(pattern)

    @property
    def solutions_per_factorisation(self) -> int:
        """That of the present precision."""
        return self._factor.solutions_per_factorisation

    @property
    def factor_bytes(self) -> int:
        """Size of the non-zeros of the factor [B], as PARDISO counts them."""
        return self._factor.factor_bytes

    def factorise(self, values: Array) -> None:
        """Cholesky factorisation.

        Raises NotPositiveDefinite if a pivot is not positive, in double precision either;
        SingularSystem if the matrix contains NaN, or PARDISO failed otherwise.
        """
        self._values = values
        try:
            self._factor.factorise(values)
        except NotPositiveDefinite:
            if not self._is_single:
                raise
            self._factorise_in_double()
            return
        if self._is_single and not self._serves():
            self._factorise_in_double()

    def _serves(self) -> bool:
        """Test if the factor recovers a constant vector from its product with the matrix."""
        one = np.ones(self._pattern.n)
        x = self._factor.approximate(symmetric_product(self._pattern, self._values, one))
        return float(np.abs(x - one).max()) <= TRUSTED

    def _factorise_in_double(self) -> None:
        if self._double is None:
            self._double = Pardiso()
            self._double.analyse(self._pattern)
        self._double.factorise(self._values)
        self._factor, self._is_single = self._double, False

    @property
    def in_double(self) -> bool:
        """True if single precision was insufficient, so that factors are in double precision."""
        return not self._is_single

    def start_over(self) -> None:
        """Reset the precision."""
        self._is_single, self._factor = True, self._single

    def approximate(self, rhs: Array) -> Array:
        """Solve without refinement, to about six digits over the condition number."""
        return self._factor.approximate(rhs)

    def approximate_many(self, rhs: Array) -> Array:
        """As `approximate`, for right-hand sides (k, n)."""
        return self._factor.approximate_many(rhs)

    def solve(self, rhs: Array) -> Array:
        """Solve to double precision.

        Raises SingularSystem if there is no factor, or the solution is not finite.
        """
        x = self._factor.approximate(rhs)
        if not self._is_single:
            return x
        last = np.inf
        for _ in range(REFINEMENTS):
            residual = rhs - symmetric_product(self._pattern, self._values, x)
            correction = self._factor.approximate(residual)
            x += correction
            size, moved = float(np.abs(x).max()), float(np.abs(correction).max())
            if moved <= REFINED * size or (moved > 0.5 * last and moved <= ENOUGH * size):
                return x
            if moved > 0.5 * last:
                break
            last = moved
        self._factorise_in_double()
        return self.solve(rhs)
