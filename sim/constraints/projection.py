"""Projection of positions to c = 0, by the displacement with the smallest norm of the mass."""

import numpy as np
from scipy.sparse import csr_array, triu

from sim.constraints.union import Constraints
from sim.errors import SingularSystem
from sim.linear import linear_solver
from sim.linear.contract import Operator
from sim.linear.krylov import conjugate_gradients
from sim.pattern import Array, Sparsity

MULTIPLIER_CHANGE = 1e-10  #: largest relative change of the multipliers in the last iteration

STALLED_ITERATIONS = 9
"""Number of iterations with a factor after which it is renewed for the next projection."""

SOLUTIONS = 60  #: largest number of iterations
FACTOR_REGULARISATION = 1e-12  #: relative regularisation of the factor


class Projection:
    """Displacement -M^-1 G' (G M^-1 G')^-1 c along the derivative G of constraints.

    The matrix has one row per constraint and couples neighbours alone. It is solved by conjugate
    gradients, preconditioned by its factor from an earlier step. `mass` (n,) is the diagonal [kg, kg
    m^2]; `iterations` and `factorisations` are those of the latest projection.
    """

    def __init__(self, constraints: Constraints, mass: Array) -> None:
        self._constraints, self._mass = constraints, mass
        self._solver = linear_solver()
        self._analysed = self._due = self._made = False
        self.iterations = self.factorisations = 0

    def start_over(self) -> None:
        """Discard the factor."""
        self._made = self._due = False

    def displacement(self, G: Array, c: Array, inverse: Operator | None = None) -> Array:
        """Displacement (n_free,) that closes c (n,), with the entries of G.

        `inverse` is the map p -> M^-1 p of a mass that is not diagonal, or of motions that joints allow.

        Raises SingularSystem if the constraints are linearly dependent, or the iteration does not
        converge.
        """
        self.factorisations = 0
        if not self._made or self._due:
            self._factorise(G)
            self.factorisations = 1
        rows, solutions = self._constraints.matrix(G), 0

        def pushed(y: Array) -> Array:
            p = rows.T @ y
            return p / self._mass if inverse is None else inverse(p)

        def product(y: Array) -> Array:
            return rows @ pushed(y)

        def precondition(r: Array) -> Array:
            nonlocal solutions
            solutions += 1
            return self._solver.solve(r)

        y, done = conjugate_gradients(product, precondition, c, MULTIPLIER_CHANGE, SOLUTIONS)
        if not done and not self.factorisations:  # the factor is of an earlier step
            self._factorise(G)
            self.factorisations = 1
            y, done = conjugate_gradients(product, precondition, c, MULTIPLIER_CHANGE, SOLUTIONS)
        if not done:
            raise SingularSystem(
                f"positions were not projected to the constraints in {SOLUTIONS} solutions, expected "
                "linearly independent constraints: try a smaller step, or leave out repeated ones"
            )
        self.iterations, self._due = solutions, solutions > STALLED_ITERATIONS
        return -pushed(y)

    def _factorise(self, G: Array) -> None:
        """Factorise G M^-1 G'."""
        rows = self._constraints.matrix(G)
        upper = csr_array(triu((rows / self._mass[None, :]) @ rows.T, format="csr"))
        upper.sort_indices()
        start = upper.indptr.astype(np.int32)
        if not self._analysed:
            places = upper.indices.astype(np.int32), start[:-1].astype(np.int64)
            self._solver.analyse(Sparsity(start, *places))
            self._analysed = True
        values = np.asarray(upper.data, dtype=np.float64)
        values[start[:-1]] *= 1.0 + FACTOR_REGULARISATION
        self._solver.factorise(values)
        self._made, self._due = True, False
