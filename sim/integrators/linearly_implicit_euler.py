"""Implicit Euler with one linear solution per step."""

from dataclasses import dataclass
from typing import ClassVar

from sim.integrators.contract import require_upright
from sim.integrators.linearly_implicit import (
    LinearStep,
    Missed,
    momentum_at,
    predicted_pose,
    step_of,
)
from sim.integrators.workspace import Workspace
from sim.state import ControlAt, State, StepReport
from sim.system import System


@dataclass(frozen=True)
class LinearlyImplicitEuler:
    """One Newton step of implicit Euler, (M + h D + h^2 K) v1 = M v0 + h f(q0), q1 = q0 + h v1.

    K, D and f are taken at q0 with the control of the step's end, or with the mean of the activation
    where that does not run straight through the step. First order; it follows the published simulator,
    and like it can invert elements when forces are large.

    Attributes
    ----------
    tolerance : float
        Largest estimated error of a nodal position that an iterative linear solver leaves in a step
        [m]; a direct one leaves none.

    Notes
    -----
    The equation is solved as it stands also when its matrix is not positive definite, as strongly
    active muscles make it; the report counts such steps as ``indefinite``.
    """

    order: ClassVar[int] = 1
    stability: ClassVar[str] = "L-stable"
    tolerance: float = 1e-6

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h.

        Raises
        ------
        InvertedElement
            det F <= 0 somewhere at the start or at the end of the step.
        SingularSystem
            The matrix could not be factorised.
        """
        line = control.chord(state.t, h)
        at_end = line.at(1.0)

        def equation(system: System) -> LinearStep:
            with work.timed("tangent"):
                pose = system.kinematics.at(state.pose, at_end.t)
                here, K = system.tangent(pose.q, at_end)
                D = system.damping_matrix(pose, at_end, K)
                predicted = predicted_pose(system, state, h)
                A = system.implicit_matrix(pose, here, K, D, h, h * h, predicted)
            require_upright(here.element, here.smallest_J, state.t)
            force = system.kinematics.generalised_force(here.f, pose)
            if D.offset is not None:
                force = force - D.offset
            rhs = momentum_at(system, state, predicted) + h * force
            return LinearStep(A, rhs, 1.0, Missed(line, D, here))

        return step_of(equation, system, state, h, self.tolerance, work)
