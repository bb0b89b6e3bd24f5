"""Equations of few components that a linear solution satisfies, by their Schur complement."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sim.dense import least, solve_under_rows, solved
from sim.pattern import Index
from sim.state import Array

EQUATIONS_MATRIX = "the matrix of the equations of joints"


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations G x = b of the solution of A x = r + G'mu.

    With P similar to A and the columns X of its inverse, the complement S = G X G' yields solutions
    P^-1 (r + G'mu) with G x = 0 for one solution with P. They precondition an iteration among the
    vectors with G x = 0 (a constraint preconditioner: Keller, Gould and Wathen 2000, SIAM J. Matrix
    Anal. Appl. 21, 1300-1317).
    """

    columns: Index  #: (k,) components on which the equations depend
    G: Array  #: (m, k) of full rank
    b: Array  #: (m,)

    @property
    def homogeneous(self) -> "Equations":
        """The equations G x = 0."""
        return Equations(self.columns, self.G, np.zeros(len(self.b)))

    def unit(self, n: int) -> Array:
        """Unit vectors (k, n) of the components."""
        out = np.zeros((len(self.columns), n))
        out[np.arange(len(out)), self.columns] = 1.0
        return out

    def solved(self, x: Array, X: Array) -> Array:
        """Nearest x (n,) in the norm of P that satisfies the equations, with X = P^-1 E (k, n)."""
        return self._closed(x, X, self.b, 1)

    def without_forces(self, r: Array) -> Array:
        """A right-hand side (n,) or (j, n) without its part G'mu, which does not change solutions.

        Its solution with P, from which it is removed otherwise, would be larger and so be its rounding.
        """
        out, G = r.copy(), self.G
        own = out[..., self.columns]
        out[..., self.columns] = own - solved(G @ G.T, G @ own.T, EQUATIONS_MATRIX).T @ G
        return out

    def kept(self, z: Array, X: Array) -> Array:
        """Part of z, (n,) or (j, n), with G z = 0."""
        return self._closed(
            z, X, 0.0, 2
        )  # without rows a body may move by much more than with them

    def _closed(self, x: Array, X: Array, wanted: Array | float, repeats: int) -> Array:
        m, k = len(self.G), len(self.columns)
        ends: Index = k * np.arange(m + 1)
        own = self.G.ravel(), np.tile(self.columns, m), ends
        rows = csr_array(own, shape=(m, x.shape[-1]))
        S = self.G @ X[:, self.columns].T @ self.G.T  # not symmetric in single precision

        def push(f: Array) -> Array:
            return (f @ self.G) @ X

        return solve_under_rows(
            x, rows, S, push, EQUATIONS_MATRIX, wanted=wanted, repeats=repeats, most=-1.0
        )[0]

    def multipliers(self, left: Array) -> Array:
        """Forces mu (m,) with G'mu = A x - r, of the residual (n,) of a solution."""
        return least(self.G.T, left[self.columns], EQUATIONS_MATRIX)
