"""Linearly implicit step with contact: one linear system per active set."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from sim.contact.rows import Acting, Multipliers, Rows
from sim.contact.step import ContactStep, penalties, pressed
from sim.errors import NotConverged
from sim.integrators.contact_equation import ContactEquation
from sim.integrators.workspace import Workspace
from sim.state import Array, Pose, State
from sim.step_matrices import LinearStep
from sim.system import System

PENALTY = 30.0  #: penalty of a row, relative to the stiffness
FASTER = 1.5  #: factor on the initial velocity for the search range of vertices
SHARE = 0.1  #: relative tolerance of a correction
ROUNDS = 6  #: largest number of additions of violated rows


@dataclass(frozen=True)
class Touched:
    """Independent velocities w and pose of a step with contact, and its report.

    `pushed` (n_nodes, 3) are the contact forces at its end [N] and `active` their rows; `roughly` solves
    with its matrix and the stiffness of its active rows; `reaction` are the forces of joints.
    """

    w: Array
    pose: Pose
    memory: Mapping[str, Array]
    pushed: Array
    roughly: Callable[[Array], Array]
    solutions: int
    factorisations: int
    definite: bool
    active: Rows
    reaction: Array | None = None


class LinearContact:
    """Iteration of a step: solve with the current rows, and add the violated ones."""

    def __init__(
        self, system: System, state: State, equation: LinearStep, h: float, work: Workspace
    ) -> None:
        assert system.contact is not None  # Callers check that the scene has contact.
        self._system, self._state = system, state
        self._h, self._moves = h, equation.moves
        self._v0 = system.kinematics.velocities(state)
        self._step = ContactStep(system.contact, state, state.t + h)
        self._equation = ContactEquation(system, state, equation, self._step, h, work)

    def solve(self) -> Touched:
        """Velocities and positions at the end.

        Raises NotConverged if the active set did not converge; SingularSystem if a matrix could not be
        factorised.
        """
        step, h, equation = self._step, self._h, self._equation
        speed = np.sqrt((self._state.v**2).sum(axis=1))
        multipliers = self._multipliers_of(step.at_start(FASTER * h * speed))
        x = h * self._v0
        for _ in range(ROUNDS):
            x, acting, solve = equation.settle(multipliers, x)
            q = self._positions(x)
            near = step.at(q)
            missed = self._missed(multipliers, acting, q, near)
            if not len(missed):
                break
            multipliers = self._multipliers_of(multipliers.rows.joined(missed), multipliers)
        else:
            raise NotConverged(
                (), self._state.t + h, "new contact constraints appear in every iteration"
            )
        out_of = near
        if self._moves < 1.0:
            out_of = near.joined(self._through(multipliers.rows, q, near))

        kinematics, pose = self._system.kinematics, self._state.pose
        pattern, pushing = self._system.point_pattern, multipliers.pushing(acting)

        def opened(rows: Rows, wanted: Array) -> Array:
            push = pressed(rows, wanted, pushing, pattern, equation.diagonal, PENALTY)
            f = equation.scale * kinematics.generalised_force(push, pose)
            return equation.displacement(solve(f, SHARE * float(wanted.max())))

        q = step.moved_out(q, out_of, opened)
        return Touched(
            x / h,
            replace(pose, q=q, t=pose.t + h),
            step.memory(q, near, multipliers, acting),
            multipliers.rows.spread(acting.on_vertices(multipliers.rows), len(q)),
            lambda rhs: solve(rhs, step.tolerances.solution),
            equation.solutions,
            equation.factorisations,
            equation.definite,
            multipliers.rows.take(np.flatnonzero(acting.force > 0.0)),
        )

    def _multipliers_of(self, rows: Rows, before: Multipliers | None = None) -> Multipliers:
        """Rows without allowed penetration, with their multipliers."""
        rho = penalties(self._system.point_pattern, self._equation.diagonal, rows, PENALTY)
        multipliers = self._step.multipliers(self._step.entering(rows), rho)
        if before is not None:
            k = len(before.rows)
            multipliers.normal[:k], multipliers.tangent[:k] = before.normal, before.tangent
            multipliers.normal[k:], multipliers.tangent[k:] = 0.0, 0.0
            multipliers.bound = multipliers.rows.friction * multipliers.normal
        return multipliers

    def _positions(self, x: Array) -> Array:
        way = self._h * (1.0 - self._moves) * self._v0 + self._moves * x
        pose = self._state.pose
        return self._system.kinematics.advance(pose, way, pose.t + self._h).q

    def _missed(self, multipliers: Multipliers, acting: Acting, q: Array, near: Rows) -> Rows:
        """Rows that the step violates beyond a small correction."""
        passed = self._step.passed(q, near)
        deep = self._step.considerable(passed, q - self._state.q, multipliers.pushing(acting))
        return passed.take(np.flatnonzero(deep)).without(multipliers.rows)

    def _through(self, rows: Rows, q: Array, near: Rows) -> Rows:
        """Rows that are violated without a close face.

        The initial velocities, which are independent of the rows, may carry a vertex through a thin
        sheet.
        """
        rows = rows.joined(self._step.passed(q, near))
        broken = rows.gaps(q - self._state.q) < -self._step.tolerances.residual
        rows = rows.take(np.flatnonzero(broken & ~np.isin(rows.slot, near.slot)))
        return rows.take(np.unique(rows.keys, return_index=True)[1])
