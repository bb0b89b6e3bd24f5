"""The trapezoidal rule solved to a tolerance."""

from dataclasses import dataclass, replace
from typing import ClassVar

from sim.integrators.constrained_acceleration import forces_at
from sim.integrators.contract import require_no_contact
from sim.integrators.converged_euler import InelasticLimits
from sim.integrators.stage import (
    Stage,
    by_joints,
    final_state,
    hits_limit,
    middle_damping,
    report_of,
)
from sim.integrators.workspace import Workspace
from sim.state import ControlAt, State, StepReport, require_upright
from sim.system import System


@dataclass(frozen=True)
class Trapezoidal(InelasticLimits):
    """q1 = q0 + h/2 (v0 + v1), M (v1 - v0) = h/2 (f0 + f1), with f = f(q, a) - D v.

    One implicit stage of length h/2 from the base q0 + h/2 v0, v0 + h/2 M^-1 f0; D is that at the
    predicted middle of the step. Attributes: as `Tolerances`.

    Notes
    -----
    Second order, A-stable but not L-stable: modes much faster than the step oscillate from step to
    step, as with the rule of Crank and Nicolson. `Sdirk2` damps them. There is no error estimate,
    because that of the rule, h^2/12 (a1 - a0), is dominated by these modes. A step in which a limit of a
    joint is hit is one of `ConvergedEuler`: impacts are inelastic, and of first order.
    """

    order: ClassVar[int] = 2
    stability: ClassVar[str] = "A-stable"

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h; errors as `ConvergedEuler.step`, and SceneError with ConstraintContact."""
        require_no_contact(system, "Trapezoidal")
        given, system = system, work.form(system)
        t1, half, over = state.t + h, 0.5 * h, system.during(state, h)
        line = control.moments(state.t, h, (0.0, 1.0))
        with work.timed("force"):
            here = system.during(state, 0.0).force(state.q, line.at(0.0))
        require_upright(here.element, here.smallest_J, state.t)
        with work.timed("tangent"):
            D = middle_damping(over, state, line, h)
        kinematics = system.kinematics
        w0 = kinematics.velocities(state)
        force = kinematics.generalised_force(here.f, state.pose) - D.force(w0)
        if system.rows is not None:
            # forces of the motion at the start, not of the step before, which would ring
            reaction = forces_at(system, state, line.at(0.0))
            force = force + by_joints(system, state.pose, reaction)
        base = kinematics.advance(state.pose, half * w0, state.t + half)
        u0 = kinematics.inertial(w0, state.pose)
        u = kinematics.kicked(u0, half * force, half, state)
        stage = Stage(t1, base, u, half, line.at(1.0), D)
        end = self._solve(over, stage, state, work)
        if hits_limit(system, state, end, h):
            after, report = self.inelastic(given, state, control, h, work)
            return after, replace(report, local_error=None, input_error=None)
        memory = over.remember(end.pose.q)
        return final_state(system, end, end.w, memory, h), report_of(h, [end])
