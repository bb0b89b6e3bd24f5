"""Linearly implicit step with given rows, by a semi-smooth Newton iteration."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sim.contact.rows import Acting, Flags, Multipliers, RowPlaces, Rows
from sim.contact.step import ContactStep
from sim.errors import NotConverged
from sim.integrators.workspace import Workspace
from sim.linear import ReusedFactor
from sim.state import Array, State
from sim.step_matrices import LinearStep
from sim.system import System
from sim.vectors import dot, norm

FRICTION_SETTLED = 1e-4  #: relative tolerance of the bounds of friction
NO_FORCE = 1e-12  #: force change below which bounds are regarded as equal [N]
PULL = 0.1  #: tensile force of a row, relative to the mean force, above which it is released
ENOUGH = 0.1  #: fraction of the initial slope at which a line search may end
TURNING = 0.3  #: fraction of the residual above which the sliding directions are updated
MAX_FLIPS = 6  #: number of changes of a row after which it is released for the step

SHORT, SLOW, STALLED = 0.1, 0.9, 8
"""Relative step length below which an iteration counts as stalled, ratio of gaps above which an update
of the multipliers does, and number of successive stalled ones that end it. Ordinary steps take two to
four passes at full length."""

PASSES, HALVINGS = 60, 40

MOST, RENEWALS = 2 * PASSES, 30
"""Passes and matrices of a whole step that end it, ten times those of ordinary steps (3, with friction
12). The hardest steps of faces that succeeded took 120 and 30."""

Solve = Callable[[Array, float], Array]
"""Solution for a right-hand side, with the largest error of an iterative one [m]."""


class ContactEquation:
    """The equation A x = b + scale N'f of x = h v1 with the forces f of the rows.

    Parameters
    ----------
    equation : matrix and right-hand side for the velocities.
    h : length of the step [s].

    Attributes
    ----------
    scale : h^2 [s^2].
    diagonal : (n_free,) of the stiffness of the tissue, A/h^2 [N/m].
    solutions, factorisations : numbers so far.
    definite : True if all matrices were positive definite.
    """

    def __init__(
        self,
        system: System,
        state: State,
        equation: LinearStep,
        step: ContactStep,
        h: float,
        work: Workspace,
    ) -> None:
        self._system, self._state, self._step, self._work = system, state, step, work
        self._A, self._b, self.scale = equation.A, h * equation.rhs, h * h
        self._until, self.tolerances = state.t + h, step.tolerances
        self.diagonal = equation.A.to_factorise()[system.pattern.diagonal] / self.scale
        self.solutions = self.factorisations = 0
        self._passes = self._renewals = 0
        self.definite, self._settling = True, False

    def displacement(self, x: Array) -> Array:
        """Nodal vector (n_nodes, 3) of x, zero at fixed components."""
        return self._system.kinematics.displacements(x, self._state.pose)

    def settle(self, multipliers: Multipliers, x: Array) -> tuple[Array, Acting, Solve]:
        """Solution with the active rows, from an initial value x.

        Each pass solves for the active and sticking rows; when they no longer change, the
        multipliers are updated, until gaps and slips are closed.

        Raises NotConverged if the active set did not converge; SingularSystem if a matrix could not be
        factorised.
        """
        self._settling = True
        try:
            return self._settle(multipliers, x)
        finally:
            self._settling = False

    def _settle(self, multipliers: Multipliers, x: Array) -> tuple[Array, Acting, Solve]:
        system, rows = self._system, multipliers.rows
        kinematics = system.kinematics
        n = self._state.q.shape[0]
        if not len(rows):
            solve = self._solver(None, rows, np.empty((0, 3, 3)), x)
            move = solve(self._b - self._A.times(x), self.tolerances.solution)
            return x + move, multipliers.at(self.displacement(x + move)), solve
        places = self._step.places(system.point_pattern, rows)
        acting = multipliers.at(self.displacement(x))
        # rows that were active in the previous step, and those that the motion would violate
        pushes = (multipliers.normal > 0.0) | (acting.gap < -self.tolerances.residual)
        factored, sticks, solve = pushes, acting.sticks, None
        flips, miss, last = np.zeros(len(rows), dtype=np.int64), np.inf, np.inf
        short = stalled = 0
        for _ in range(PASSES):
            self._passes += 1
            force = multipliers.held(acting, pushes)[:, None] * rows.normal + acting.friction
            Ax = self._A.times(x)
            pushed = kinematics.generalised_force(rows.spread(force, n), self._state.pose)
            missing = self._b + self.scale * pushed - Ax
            left = norm(missing)
            same = np.array_equal(factored, pushes) and np.array_equal(sticks, acting.sticks)
            # The stiffness of a sliding contact rotates with its direction.
            if solve is None or not same or (acting.turn.any() and left > TURNING * last):
                first = solve is None
                self._renewals += 1
                if self._passes > MOST or self._renewals > RENEWALS:
                    break
                solve = self._solver(places, rows, multipliers.stiffness(acting, pushes), x)
                factored, sticks = pushes, acting.sticks
            else:
                first = False
            move, last = solve(missing, self.tolerances.solution), left
            if first:
                x, acting = x + move, multipliers.at(self.displacement(x + move))
            else:
                x, acting, length = self._along(multipliers, x, move, Ax - self._b)
                short = short + 1 if length < SHORT else 0
                if short == STALLED:
                    break
            rough = float(np.abs(move).max()) if multipliers.bound.any() else 0.0
            settled = np.array_equal(sticks, acting.sticks) and rough <= self.tolerances.accepted
            if not (settled and self._stand(multipliers, acting, pushes)):
                now = acting.force > 0.0
                flips += now != pushes
                multipliers.released |= flips > MAX_FLIPS
                pushes = now & ~multipliers.released
                continue
            before, miss = miss, acting.miss(multipliers, pushes)
            slow = miss > max(SLOW * before, self.tolerances.residual)
            stalled = stalled + 1 if slow else 0
            if stalled == STALLED:
                break
            bound = multipliers.bound
            multipliers.update(acting)
            change = np.abs(multipliers.bound - bound).max(initial=0.0)
            small = FRICTION_SETTLED * multipliers.bound.max(initial=0.0) + NO_FORCE
            if max(miss, rough) <= self.tolerances.residual and change <= small:
                return x, acting, solve
            acting, last = multipliers.at(self.displacement(x)), np.inf
        if solve is None or miss > self.tolerances.accepted:
            left = acting.miss(multipliers)
            raise NotConverged((), self._until, f"contact did not converge; {left:.2g} m remain")
        return x, acting, solve

    def _stand(self, multipliers: Multipliers, acting: Acting, pushes: Flags) -> bool:
        """Test if the active set is valid for the step: no penetration, little tension."""
        inside = float(-acting.gap[~pushes & ~multipliers.released].min(initial=0.0))
        if inside > self.tolerances.accepted:
            return False
        force = multipliers.held(acting, pushes)
        pull = float(-force.min(initial=0.0))
        pushing = force[force > 0.0]
        return pull == 0.0 or (len(pushing) > 0 and pull <= PULL * float(pushing.mean()))

    def _along(
        self, multipliers: Multipliers, x: Array, move: Array, residual: Array
    ) -> tuple[Array, Acting, float]:
        """Minimiser of the augmentation along a direction, at most its end, and the length of the step.

        residual is A x - b.
        """
        start = multipliers.rows.displacement(self.displacement(x))
        way = multipliers.rows.displacement(self.displacement(x + move)) - start
        straight = dot(residual, move)
        bent = dot(move, self._A.times(move))

        def slope(length: float) -> tuple[float, Acting]:
            acting = multipliers.at_relative(start + length * way)
            pushed = self.scale * dot(acting.on_vertices(multipliers.rows), way)
            return straight + length * bent - pushed, acting

        first, _ = slope(0.0)
        last, acting = slope(1.0)
        if first >= 0.0 or last <= ENOUGH * abs(first):
            return x + move, acting, 1.0
        low, high, length = 0.0, 1.0, 1.0
        for _ in range(HALVINGS):
            length = 0.5 * (low + high)
            here, acting = slope(length)
            if abs(here) <= ENOUGH * abs(first):
                break
            low, high = (low, length) if here > 0.0 else (length, high)
        return x + length * move, acting, length

    def _solver(self, places: RowPlaces | None, rows: Rows, block: Array, x: Array) -> Solve:
        """Solver for the matrix with the stiffness of rows, from x under the constraints."""
        system, work = self._system, self._work
        A = replace(self._A, values=self._A.values.copy())
        if places is not None:
            places.add(block, self.scale, A.values)
        if system.constraints is not None:
            saddle, slopes = (
                work.constraints.saddle,
                system.constraints.evaluate(self._state.pose)[1],
            )
            saddle.factorise(A.values, slopes)
            gamma = -(system.constraints.matrix(slopes) @ x)

            def under(r: Array, error: float) -> Array:
                start = np.zeros(len(r)) if self._settling else None
                # The first solution moves x onto the constraints, later ones remain on them.
                # Multipliers are those of the whole step while it is settled, and of a small motion
                # afterwards.
                found, _ = saddle.solve(r, gamma, start, error)
                gamma[:] = 0.0
                self.factorisations += saddle.factorisations
                self.definite &= saddle.definite is not False
                return self._counted(found, saddle.iterations)

            return under
        if not isinstance(work.linear, ReusedFactor):
            direct, definite = work.steps.factorised(A.values)
            self.factorisations += 1
            self.definite &= definite
            return lambda r, _: self._counted(direct(r))

        def solve(r: Array, error: float) -> Array:
            found = work.steps.solve(A, r, np.zeros(len(r)), error)
            self.factorisations += found.factorisations
            self.definite &= found.definite
            return self._counted(found.x, found.iterations)

        return solve

    def _counted(self, x: Array, solutions: int = 1) -> Array:
        self.solutions += solutions
        return x
