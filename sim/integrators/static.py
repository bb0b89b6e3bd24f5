"""Quasi-static equilibrium by the iteration without inertia and damping."""

import math
from dataclasses import asdict, dataclass, replace

import numpy as np

from sim.contact.step import ContactStep
from sim.integrators.contact_converged import minimise_in_contact
from sim.integrators.contact_stage import StageWithRows
from sim.integrators.contract import require_fixed_contact
from sim.integrators.newton import Point, PotentialOfMoves
from sim.integrators.stage import Iterative
from sim.integrators.workspace import Workspace
from sim.joints.contract import REACTIONS
from sim.linear.contract import Matrix
from sim.state import Array, Control, ControlAt, State, StepReport, require_upright
from sim.system import System, stiffness_matrix


@dataclass(frozen=True)
class Static(Iterative):
    """The nearest minimum of the energy E(q) under the control of the step's end.

    Time has no effect except through the control: a load is applied in steps by an activation that
    increases with time, and `HalvingStep` divides steps that are too large. Velocities are zero.
    Attributes: as `Tolerances`, with separate tolerances.

    Notes
    -----
    The scene must be held against rigid motion. If minima are not unique (buckling), the result is
    that of the descent from the previous state.
    """

    tolerance: float = 1e-7
    residual_tolerance: float = 1e-6
    max_iterations: int = 200

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Find equilibrium; h only advances the time. Errors as `ConvergedEuler.step`."""
        require_fixed_contact(system, "Static")
        system = work.form(system).during(state, math.inf)
        energy = _Energy(system, state, control(state.t + h), work)
        start = energy.point(energy.coordinates(state.pose))
        require_upright(start.here.element, start.here.smallest_J, state.t)
        until, memory = state.t + h, dict[str, Array]()
        settle = self._minimiser(system, work, 0.0, until)
        moved: Array | None = None
        if system.rows is not None:
            rows = StageWithRows(energy, None, work, ("Static", 0.0), self, until)
            done = rows.solve(start, np.zeros(len(state.q)))
            assert done.reaction is not None  # of the rows of joints
            end, went, memory[REACTIONS] = done.point, done.went, done.reaction
            least = end.here.smallest_J
        elif system.contact is None:
            end, went = settle(energy, start)
            least = end.here.smallest_J
        else:
            contact = ContactStep(system.contact, state, until, equilibrium=True)
            way, key = np.zeros(len(state.q)), ("Static", 0.0)
            solution = minimise_in_contact(
                energy, start, contact, way, key, work, settle, until, start_closed=True
            )
            end, went, moved, memory = (
                solution.point,
                solution.went,
                solution.q,
                dict(solution.memory),
            )
            least = solution.here.smallest_J
        pose = end.pose
        if moved is not None:
            pose = replace(pose, q=moved)
        still = np.zeros(system.pattern.n)
        new = system.kinematics.state(pose, still, {**system.remember(pose.q), **memory})
        return new, StepReport(h=h, smallest_J=least, **asdict(went))


class _Energy(PotentialOfMoves):
    """E(q0 + d) under one control."""

    scale = 1.0

    def __init__(self, system: System, state: State, control: Control, work: Workspace) -> None:
        super().__init__(system, state.pose, control, work)
        self.shift = np.ones(system.pattern.n)

    def point(self, d: Array) -> Point:
        """Evaluate E and its gradient."""
        pose = self.pose(d)
        here = self._evaluate(pose)
        kinematics = self.system.kinematics
        g = kinematics.gradient(-kinematics.generalised_force(here.f, pose), d)
        return Point(d, pose, g, here.energy, here)

    def matrix(self, point: Point) -> Matrix:
        """Second derivative K at a point."""
        pose = point.pose
        here, K = self.system.tangent(pose.q, self._control)
        A = stiffness_matrix(self.system, pose, K, here.f)
        # A shift of 1 % of the typical stiffness is effective without dominating the matrix.
        self.shift = np.full(len(point.d), 0.01 * np.abs(A.values[A.pattern.diagonal]).mean())
        return A
