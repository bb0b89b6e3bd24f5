"""Implicit Euler solved to a tolerance: Newton on the incremental potential."""

from dataclasses import dataclass, fields
from typing import ClassVar

from sim.integrators.stage import Converged, Stage, by_joints, final_state, report_of
from sim.integrators.workspace import Workspace
from sim.state import ControlAt, State, StepReport, require_upright
from sim.system import System, damping_matrix


@dataclass(frozen=True)
class ConvergedEuler(Converged):
    """The minimiser of the incremental potential of one implicit Euler step.

    phi(q) = 1/(2 h^2) |q - q0 - h v0|^2_M + E(q) + 1/(2 h) (q - q0)' D0 (q - q0),

    with D0 the damping matrix at the start of the step. Attributes: as `Tolerances`.

    Notes
    -----
    The activation is that at the end of the step if it is linear over the step, otherwise its mean.
    First order, L-stable. The estimated error of a step is h/2 (v1 - v0), the leading term
    h^2/2 dv/dt, without the contribution of jumps of the load (`sim.integrators.estimate`).

    Source of the potential: the variational form of implicit Euler (Martin et al. 2011, Example-based
    elastic materials); the damping is lagged so that the step has a potential.
    """

    order: ClassVar[int] = 1
    stability: ClassVar[str] = "L-stable"

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h.

        Raises
        ------
        InvertedElement
            det F <= 0 at the start of the step.
        NotConverged
            The tolerances were not met, or no step length lowers the potential.
        SingularSystem
            The matrix could not be factorised.
        """
        system = work.form(system, state).during(state, h)
        t1, line = state.t + h, control.chord(state.t, h)
        at_end = line.at(1.0)
        with work.timed("force"):
            here = system.force(state.q, at_end)
        require_upright(here.element, here.smallest_J, state.t)
        with work.timed("tangent"):
            D = damping_matrix(system, state.pose, state.v, at_end)
        kinematics = system.kinematics
        w0 = kinematics.velocities(state)
        u0 = kinematics.inertial(w0, state.pose)
        stage = Stage(t1, state.pose, u0, h, at_end, D)
        end = self._solve(system, stage, state, work, here)
        memory = {**system.remember(end.pose.q), **end.memory}
        with work.timed("force"):
            f0 = system.force(state.q, line.at(0.0)).f
        if end.contact is not None:
            # forces of closed rows do not change the motion, so that those at the end are used
            f0 = f0 + end.contact.pushed
        loads = kinematics.generalised_force(f0, state.pose)
        Q0 = loads + by_joints(system, state.pose, end.reaction)
        u1 = kinematics.inertial(end.w, end.pose)
        gained = kinematics.momentum(u1 - u0, end.pose) - h * (Q0 - D.force(w0))
        error = self._freed(system, 0.5 * h * (end.w - w0), 0.5 * gained, D, h, end, work)
        missed = self._of_input(system, control, line, h, end, work)
        lag = self._of_contact(system, h, h, ((1.0, end),), work)
        return final_state(system, end, end.w, memory, h), report_of(h, [end], error, missed, lag)


@dataclass(frozen=True)
class InelasticLimits(Converged):
    """Method of second order whose steps with an impact at a limit are those of `ConvergedEuler`."""

    def inelastic(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h with the same tolerances."""
        tolerances = {each.name: getattr(self, each.name) for each in fields(Converged)}
        return ConvergedEuler(**tolerances).step(system, state, control, h, work)
