"""Latest factor of Newton's method, and the quasi-Newton updates that belong to it."""

import math
from dataclasses import replace

from sim.integrators.analysed import AnalysedSolver
from sim.integrators.quasi_newton import InverseSecants, SecantMemory
from sim.linear import NotPositiveDefinite, ReusedFactor
from sim.linear.conjugate_gradients import conjugate_gradients
from sim.linear.reused import Timed
from sim.matrix import Matrix
from sim.state import Array

DIRECTION_SHARE, DIRECTION_SOLUTIONS = 0.1, 12
"""Tolerance of a direction, and largest number of solutions."""

Key = tuple[str, float]  #: integrator, and implicit part of its step [s]


class NewtonFactor:
    """Factor that serves the iterations of many steps.

    `key` is None if the latest factor is of another matrix; `number` counts factors; `secants` and
    `inverse_secants` are updates of the factor.
    """

    def __init__(self, solver: AnalysedSolver, timed: Timed) -> None:
        self._solver, self._timed = solver, timed
        self.key: Key | None = None
        self.number = 0
        self.secants, self.inverse_secants = SecantMemory(), InverseSecants()
        self._made_of: Array | None = None
        self._beside: Matrix | None = None

    @property
    def matrix(self) -> Array | None:
        """Values of the factorised matrix, or None if it has products or there is no factor."""
        return self._made_of if self.key is not None and self._beside is None else None

    def belongs_to(self, key: Key) -> bool:
        """Test if the latest factor is of this integrator and step, up to rounding of the step."""
        return alike(self.key, key)

    def factorise(self, A: Matrix, shift: Array, key: Key, max_shifts: int = 12) -> int:
        """Factorise; while the matrix is not positive definite, add growing multiples of a diagonal.

        Multiples of the mass, added to the matrix of a time step, have the effect of a shorter step.
        Returns the number of shifts.

        Raises NotPositiveDefinite if the matrix is not positive definite with the largest shift.
        """
        self._solver.analyse(A.pattern)
        values, tau = A.to_factorise(), 0.0
        shifted = values
        self.forget()
        self._made_of = None
        for shifts in range(max_shifts + 1):
            try:
                with self._timed("factorisation"):
                    self._solver.factor.factorise(shifted)
            except NotPositiveDefinite:
                if shifts == max_shifts:
                    raise
                tau = 4.0**shifts
                shifted = values.copy()
                shifted[A.pattern.diagonal] += tau * shift
                continue
            self._made_of, self.key = shifted, key
            if A.products:
                own = A.values.copy()
                own[A.pattern.diagonal] += tau * shift
                self._beside = replace(A, values=own)
            return shifts
        raise AssertionError("unreachable: the loop returns or raises")

    def solve(self, rhs: Array) -> Array:
        """Solve with the latest factor in its own precision, with products only approximately.

        This accuracy is sufficient for a direction of Newton's method.
        """
        factor = self._solver.factor
        with self._timed("solution"):
            if self._beside is None:
                return factor.approximate(rhs)
            times = self._beside.times
            return conjugate_gradients(
                times, factor.approximate, rhs, DIRECTION_SHARE, DIRECTION_SOLUTIONS
            )[0]

    def solve_many(self, rhs: Array) -> Array:
        """Solutions (k, n) without products for many right-hand sides (k, n)."""
        with self._timed("solution"):
            return self._solver.factor.approximate_many(rhs)

    def superseded(self) -> None:
        """Discard the updates and the key, because the solver has factorised another matrix."""
        self.key = None
        self.number += 1
        self.secants.clear()
        self.inverse_secants.clear()
        self._beside = self._made_of = None

    def forget(self) -> None:
        """Discard the factor, also that of an iterative solver."""
        self.superseded()
        if isinstance(self._solver.linear, ReusedFactor):
            self._solver.linear.forget()


def alike(made: Key | None, key: Key) -> bool:
    """Test if an object belongs to this integrator and step, up to rounding of the step."""
    return made is not None and made[0] == key[0] and math.isclose(made[1], key[1], rel_tol=1e-9)
