"""Interfaces of linear solvers for symmetric matrices."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from sim._kernels import matrix as kernel
from sim.errors import SingularSystem
from sim.pattern import Sparsity
from sim.state import Array

Operator = Callable[[Array], Array]  #: a linear map of vectors (n,)


class NotPositiveDefinite(SingularSystem):
    """The matrix has a non-positive pivot; the caller may shift it and try again."""


class LinearSolver(Protocol):
    """Solver of A x = b for symmetric A given by the values of its upper triangle."""

    @property
    def name(self) -> str:
        """Name for labels of results."""
        ...

    def analyse(self, pattern: Sparsity) -> None:
        """Order and analyse the sparsity, once."""
        ...

    def factorise(self, values: Array) -> None:
        """Factorise numerically.

        Raises NotPositiveDefinite if the method requires a positive definite matrix, and a pivot is not
        positive; SingularSystem if the matrix is singular or contains NaN.
        """
        ...

    def solve(self, rhs: Array) -> Array:
        """Solve with the latest factor, rhs (n,).

        Raises SingularSystem if the solution is not finite.
        """
        ...


class Factor(LinearSolver, Protocol):
    """A direct solver, whose factor may also precondition an iteration."""

    @property
    def solutions_per_factorisation(self) -> int:
        """Approximate number of solutions that take as long as one factorisation."""
        ...

    def approximate(self, rhs: Array) -> Array:
        """Solve with the latest factor in its own precision, without refinement."""
        ...

    def approximate_many(self, rhs: Array) -> Array:
        """Same as `approximate`, for several right-hand sides (k, n)."""
        ...


def require_finite_matrix(values: Array) -> None:
    """Raise SingularSystem unless all values of a matrix are finite."""
    if not np.isfinite(values).all():
        raise SingularSystem("the matrix contains NaN or infinity, expected finite values")


def require_finite_solution(x: Array) -> None:
    """Raise SingularSystem unless a solution is finite."""
    if not np.isfinite(x).all():
        raise SingularSystem("the solution contains NaN or infinity: the matrix is singular")


def symmetric_product(pattern: Sparsity, values: Array, x: Array) -> Array:
    """A x (n,) for the symmetric A with these values on the pattern."""
    out = np.empty_like(x)
    kernel.symmetric_product(pattern.indptr, pattern.indices, values, x, out)
    return out
