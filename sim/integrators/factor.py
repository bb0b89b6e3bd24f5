"""Linear solver of a simulation, its latest factor for Newton's method, and quasi-Newton updates of it.

The updates come from the steps since the factor was computed, (6) of docs/step.md.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array

from sim.dense import curvature, dot, inverse
from sim.linear import Factor, NotPositiveDefinite, ReusedFactor, solver_of_steps
from sim.linear.contract import Matrix
from sim.linear.krylov import conjugate_gradients
from sim.linear.reused import Timed
from sim.pattern import Sparsity
from sim.state import Array, State
from sim.system import System

MOST_APART = 1000
"""Largest number of active rows for the Schur complement, whose compliance takes 0.2 GB.

With friction, a vertex has three.
"""


class AnalysedSolver:
    """Linear solver, and the form of the system for which it is analysed.

    The name is that of the linear solver, or "auto". `system` is the whole one with its `pattern`,
    `form_pattern` is of the form that the solver requires, and `analysed` the sparsity for which it is
    analysed.
    """

    linear: Factor | ReusedFactor  #: solver for the matrix of a step
    factor: Factor  #: computes the factors, also for Newton's method

    def __init__(self, system: System, name: str, timed: Timed) -> None:
        self._name, self._timed = name, timed
        self._take(system.pattern.n)
        self.system, self.pattern = system, system.pattern
        self._form = self._with_products(system)
        self.form_pattern = self._form.pattern
        self.analysed: Sparsity | None = None
        if self._form.contact is None:
            # with contact the form is chosen at the first step
            self.analyse(self.form_pattern)

    def _take(self, n: int) -> None:
        self.linear = solver_of_steps(self._name, n)
        if isinstance(self.linear, ReusedFactor):
            self.linear.timed = self._timed
            self.factor = self.linear.factor
        else:
            self.factor = self.linear

    def analyse(self, pattern: Sparsity) -> None:
        """Set the solver for a sparsity, unless it is already set."""
        if pattern is self.analysed:
            return
        if self.analysed is not None:
            self._take(pattern.n)
        self.linear.analyse(pattern)
        self.analysed = pattern

    def form(self, system: System, state: State | None, *, rows_apart: bool) -> System:
        """Return the system in the form required by the solver; see `Workspace.form`."""
        form, contact = self._with_products(system), system.contact
        if contact is None or system.with_rows is None or rows_apart:
            return form
        if state is not None and not form.has_products:
            few = len(contact.pushing(state)) * (3 if contact.rubs else 1) <= MOST_APART
            if few:
                return form
        return self._with_products(system.with_rows.system)

    def _with_products(self, system: System) -> System:
        reuses = isinstance(self.linear, ReusedFactor)
        return system.sparse if reuses and system.sparse is not None else system

    def forget(self) -> None:
        """Discard an older factor and a choice of its precision."""
        if self.analysed is None:
            return
        start_over = getattr(self.factor, "start_over", None)
        if start_over is not None:
            start_over()
        if isinstance(self.linear, ReusedFactor):
            self.linear.start_over()


Solve = Callable[[Array], Array]


class LBFGS:
    """Limited-memory BFGS inverse Hessian, from the latest steps and gradient changes.

    A factor can be reused in many steps, because each pair (s, y) contains the difference of the
    current Hessian from the factorised one. Source: Nocedal and Wright, Numerical Optimization,
    Algorithm 7.4, with the old factor as initial inverse Hessian. `size` is the number of stored
    pairs.
    """

    def __init__(self, size: int = 8) -> None:
        self._pairs: deque[tuple[Array, Array, float]] = deque(maxlen=size)

    def clear(self) -> None:
        """Remove all pairs, as after a factorisation."""
        self._pairs.clear()

    def learn(self, s: Array, y: Array) -> None:
        """Add a step s and the gradient change y, if the curvature is positive."""
        sy = curvature(s, y)
        if sy > 0.0:
            self._pairs.append((s, y, 1.0 / sy))

    def direction(self, g: Array, solve: Solve) -> Array:
        """-H g, with `solve` the inverse of the factorised Hessian."""
        q, weights = -g, list[float]()
        for s, y, r in reversed(self._pairs):
            a = r * dot(s, q)
            q = q - a * y
            weights.append(a)
        z = solve(q)
        for (s, y, r), a in zip(self._pairs, reversed(weights), strict=True):
            z = z + (a - r * dot(y, z)) * s
        return z


class CompactBFGS:
    """Compact BFGS H = H0 + E' M E of an inverse H0, with the latest steps and H0 y in E.

    Source: Byrd, Nocedal and Schnabel 1994, Representations of quasi-Newton matrices and their use
    in limited memory methods, Math. Programming 63, equation (2.6), with any H0. `size` is the
    number of stored pairs.
    """

    def __init__(self, size: int = 8) -> None:
        self._pairs: deque[tuple[Array, Array, Array]] = deque(maxlen=size)
        self._sides = np.empty((0, 0))
        self._middle = np.empty((0, 0))

    def clear(self) -> None:
        """Remove all pairs, as after a factorisation."""
        self._pairs.clear()
        self._lay_out()

    def learn(self, s: Array, y: Array, z: Array) -> None:
        """Add a step s, the change y of the gradient and z = H0 y, if the curvature is positive."""
        if curvature(s, y) > 0.0:
            self._pairs.append((s, y, z))
            self._lay_out()

    def _lay_out(self) -> None:
        m = len(self._pairs)
        if not m:
            self._sides, self._middle = np.empty((0, 0)), np.empty((0, 0))
            return
        S, Y, Z = (np.stack(part) for part in zip(*self._pairs, strict=True))
        SY, YZ = S @ Y.T, Y @ Z.T
        R = inverse(np.triu(SY), "the matrix of quasi-Newton updates")
        middle = R.T @ (np.diag(np.diag(SY)) + 0.5 * (YZ + YZ.T)) @ R
        self._sides = np.concatenate([S, Z])
        self._middle = np.block([[middle, -R.T], [-R, np.zeros((m, m))]])

    def added(self, r: Array) -> Array:
        """(H - H0) r."""
        if not len(self._middle):
            return np.zeros_like(r)
        return self._sides.T @ (self._middle @ (self._sides @ r))

    def seen_by(self, D: csr_array) -> Array:
        """D E' (m, k), for `between`."""
        if not len(self._middle):
            return np.zeros((D.shape[0], 0))
        return D @ self._sides.T

    def between(self, seen: Array) -> Array:
        """D (H - H0) D' (m, m) of directions `seen_by` this."""
        if not len(self._middle):
            return np.zeros((len(seen), len(seen)))
        return seen @ self._middle @ seen.T


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
        self.secants, self.inverse_secants = LBFGS(), CompactBFGS()
        self._made_of: Array | None = None
        self._with_products: Matrix | None = None

    @property
    def matrix(self) -> Array | None:
        """Values of the factorised matrix, or None if it has products or there is no factor."""
        return self._made_of if self.key is not None and self._with_products is None else None

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
                self._with_products = replace(A, values=own)
            return shifts
        raise AssertionError("unreachable: the loop returns or raises")

    def solve(self, rhs: Array) -> Array:
        """Solve with the latest factor in its own precision, with products only approximately.

        This accuracy is sufficient for a direction of Newton's method.
        """
        factor = self._solver.factor
        with self._timed("solution"):
            if self._with_products is None:
                return factor.approximate(rhs)
            times = self._with_products.times
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
        self._with_products = self._made_of = None

    def forget(self) -> None:
        """Discard the factor, also that of an iterative solver."""
        self.superseded()
        if isinstance(self._solver.linear, ReusedFactor):
            self._solver.linear.forget()


def alike(made: Key | None, key: Key) -> bool:
    """Test if an object belongs to this integrator and step, up to rounding of the step."""
    return made is not None and made[0] == key[0] and math.isclose(made[1], key[1], rel_tol=1e-9)
