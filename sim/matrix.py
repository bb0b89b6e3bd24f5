"""Symmetric matrices with low-rank terms in product form.

A pressure that acts on many nodes couples all of them. Its stiffness k g g', with the derivative g
of a volume, has few numbers as a product and many as entries of a matrix.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from sim.linear.contract import symmetric_product
from sim.pattern import Sparsity
from sim.state import Array


@dataclass(frozen=True, eq=False)
class Product:
    """The matrix G' diag(k) G, or R'G' diag(k) G R."""

    G: csr_array  #: (m, n_free) sparse
    k: Array  #: (m,)
    R: csr_array | None = None  #: (n_free, n) sparse or None

    def times(self, x: Array) -> Array:
        """Product with a vector (n_free,), or (n,) with R."""
        if self.R is None:
            return self.G.T @ (self.k * (self.G @ x))
        return self.R.T @ (self.G.T @ (self.k * (self.G @ (self.R @ x))))

    def scaled(self, factor: float) -> "Product":
        """The same matrix multiplied by a number."""
        return replace(self, k=factor * self.k)


@dataclass(frozen=True, eq=False)
class Matrix:
    """Symmetric matrix: entries on a pattern, and matrix-free products."""

    pattern: Sparsity
    values: Array  #: (pattern.nnz,)
    products: tuple[Product, ...] = ()
    #: values that replace the products in a factorisation, on the pattern
    stand_in: Callable[[], Array] | None = None
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
        return self.values if self.stand_in is None else self.values + self.stand_in()


def merged(products: Sequence[Product]) -> tuple[Product, ...]:
    """Sum of products, combined if their G are equal."""
    found: list[Product] = []
    for part in products:
        same = [i for i, other in enumerate(found) if _same(other, part)]
        if same:
            found[same[0]] = replace(part, k=found[same[0]].k + part.k)
        else:
            found.append(part)
    return tuple(found)


def _same(one: Product, other: Product) -> bool:
    a, b = one.G, other.G
    if (one.R is None) != (other.R is None) or (
        one.R is not None and other.R is not None and one.R.data is not other.R.data
    ):
        return False
    if a is b:
        return True
    return np.array_equal(a.data, b.data) and np.array_equal(a.indices, b.indices)
