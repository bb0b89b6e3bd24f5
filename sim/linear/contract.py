"""The contract of a linear solver for symmetric matrices."""

from typing import Protocol

from sim.errors import SingularSystem
from sim.pattern import Sparsity
from sim.state import Array


class NotPositiveDefinite(SingularSystem):
    """The matrix has a non-positive pivot; the caller may shift it and try again."""


class LinearSolver(Protocol):
    """Solver of A x = b for symmetric A given by the values of its upper triangle."""

    name: str

    def analyse(self, pattern: Sparsity) -> None:
        """Order and analyse the sparsity, once."""
        ...

    def factorise(self, values: Array) -> None:
        """Factorise numerically.

        Raises
        ------
        NotPositiveDefinite
            If the method needs a positive definite matrix and met a non-positive pivot.
        SingularSystem
            If the matrix is singular or holds NaN.
        """
        ...

    def solve(self, rhs: Array) -> Array:
        """Solve with the latest factor, rhs (n,).

        Raises
        ------
        SingularSystem
            If the solution is not finite.
        """
        ...
