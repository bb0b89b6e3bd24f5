"""Symmetric matrices with low-rank terms in product form, and interfaces of linear solvers.

A pressure that acts on many nodes couples all of them. Its stiffness k g g', with the derivative g
of a volume, has few numbers as a product and many as entries of a matrix.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.sparse import csr_array

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


@dataclass(frozen=True, eq=False)
class LowRankTerm:
    """The matrix G' diag(k) G, or R'G' diag(k) G R."""

    G: csr_array  #: (m, n_free) sparse
    k: Array  #: (m,)
    R: csr_array | None = None  #: (n_free, n) sparse or None

    def times(self, x: Array) -> Array:
        """Product with a vector (n_free,), or (n,) with R."""
        if self.R is None:
            return self.G.T @ (self.k * (self.G @ x))
        return self.R.T @ (self.G.T @ (self.k * (self.G @ (self.R @ x))))

    def scaled(self, factor: float) -> "LowRankTerm":
        """The same matrix multiplied by a number."""
        return replace(self, k=factor * self.k)


@dataclass(frozen=True, eq=False)
class Matrix:
    """Symmetric matrix: entries on a pattern, and matrix-free products."""

    pattern: Sparsity
    values: Array  #: (pattern.nnz,)
    products: tuple[LowRankTerm, ...] = ()
    #: values that replace the products in a factorisation, on the pattern
    preconditioner_values: Callable[[], Array] | None = None
    #: (n,) or None; for a damping matrix, the force due to prescribed velocities and to forces that are
    #: nonlinear in the velocities [N]
    offset: Array | None = None

    def force(self, w: Array) -> Array:
        """Product with velocities (n,) and the offset."""
        f = self.times(w)
        return f if self.offset is None else f + self.offset

    def times(self, x: Array) -> Array:
        """Product with a vector (n,)."""
        y = symmetric_product(self.pattern, self.values, x)
        for part in self.products:
            y += part.times(x)
        return y

    def to_factorise(self) -> Array:
        """Values of the matrix that is factorised as its preconditioner."""
        return (
            self.values
            if self.preconditioner_values is None
            else self.values + self.preconditioner_values()
        )


def merged(products: Sequence[LowRankTerm]) -> tuple[LowRankTerm, ...]:
    """Sum of products, combined if their G are equal."""
    terms: list[LowRankTerm] = []
    for part in products:
        same = [i for i, other in enumerate(terms) if _same(other, part)]
        if same:
            terms[same[0]] = replace(part, k=terms[same[0]].k + part.k)
        else:
            terms.append(part)
    return tuple(terms)


def _same(one: LowRankTerm, other: LowRankTerm) -> bool:
    a, b = one.G, other.G
    if (one.R is None) != (other.R is None) or (
        one.R is not None and other.R is not None and one.R.data is not other.R.data
    ):
        return False
    if a is b:
        return True
    return np.array_equal(a.data, b.data) and np.array_equal(a.indices, b.indices)
