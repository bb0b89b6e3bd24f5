"""The trapezoidal rule with one linear solution per step."""

from dataclasses import dataclass
from typing import ClassVar

from sim.integrators.contract import require_upright
from sim.integrators.linearly_implicit import (
    LinearStep,
    momentum_at,
    predicted_pose,
    step_of,
)
from sim.integrators.workspace import Workspace
from sim.state import ControlAt, State, StepReport
from sim.system import System


@dataclass(frozen=True)
class LinearlyImplicitTrapezoidal:
    """The trapezoidal rule linearised at the start of the step.

    (M + h/2 D + h^2/4 K) v1 = (M - h/2 D - h^2/4 K) v0 + h f(q0), q1 = q0 + h/2 (v0 + v1).

    K, D and f are taken at q0 with the control of the step's end, as the published simulator does; where
    the activation does not run straight through the step, with its mean.

    Attributes
    ----------
    tolerance : float
        As of `LinearlyImplicitEuler`.

    Notes
    -----
    Second order when control and damping matrix are constant, else first, since both are taken at
    one end of the step. Fast modes ring, and elements can invert.
    """

    order: ClassVar[int] = 1
    stability: ClassVar[str] = "A-stable"
    tolerance: float = 1e-6

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h; errors as `LinearlyImplicitEuler.step`."""
        at_end = control.chord(state.t, h).at(1.0)

        def equation(system: System) -> LinearStep:
            with work.timed("tangent"):
                pose = system.kinematics.at(state.pose, at_end.t)
                here, K = system.tangent(pose.q, at_end)
                D = system.damping_matrix(pose, at_end, K)
                predicted = predicted_pose(system, state, h)
                A = system.implicit_matrix(pose, here, K, D, 0.5 * h, 0.25 * h * h, predicted)
            require_upright(here.element, here.smallest_J, state.t)
            kinematics = system.kinematics
            w0 = kinematics.velocities(state)
            # (M - h/2 D - h^2/4 K) w0 is twice the mass less the matrix
            momentum = momentum_at(system, state, predicted) + kinematics.apply_mass(w0, predicted)
            force = kinematics.generalised_force(here.f, pose)
            if D.offset is not None:
                force = force - D.offset
            rhs = momentum - A.times(w0) + h * force
            return LinearStep(A, rhs, 0.5)

        return step_of(equation, system, state, h, self.tolerance, work)
