"""Interface of integrators."""

from collections.abc import Iterator, Sequence
from typing import ClassVar, Protocol, runtime_checkable

from sim.errors import SceneError
from sim.integrators.workspace import Workspace
from sim.state import ControlAt, Outputs, State, StepReport
from sim.system import System


class Integrator(Protocol):
    """Advances a state by one step."""

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """State at t + h for a control that is linear over the step, and the report.

        Raises InvertedElement, NotConverged, SingularSystem if the step failed; the given state is
        untouched.
        """
        ...


@runtime_checkable
class TimeIntegrator(Integrator, Protocol):
    """An integrator that approaches the motion with a declared order as h falls."""

    order: ClassVar[int]  #: the error of the positions at a given time falls with h to this power
    #: "L-stable" (fast modes decay), "A-stable" (fast modes may oscillate) or "conditional" (the step
    #: is bounded)
    stability: ClassVar[str]


@runtime_checkable
class RunsSteps(Protocol):
    """An integrator that can take several steps in one call."""

    def fuses(self, work: Workspace) -> bool:
        """Test if it computes several steps of a simulation at once, in less time than one by one."""
        ...

    def run(
        self,
        system: System,
        state: State,
        control: ControlAt,
        groups: Sequence[Sequence[float]],
        work: Workspace,
    ) -> Iterator[Outputs]:
        """States after each group of steps that end at the given times [s].

        Errors are those of `step`.
        """
        ...


def require_no_contact(system: System, integrator: str) -> None:
    """Raise SceneError for contact by constraints."""
    if system.contact is not None:
        raise SceneError(
            f"{integrator} does not support contact constraints: use Sdirk2, ConvergedEuler or "
            "LinearlyImplicitEuler"
        )


def require_no_friction(system: System, user: str) -> None:
    """Raise SceneError for contact with friction."""
    if system.contact is not None and system.contact.rubs:
        raise SceneError(
            f"{user} does not support friction, because its rows have no derivatives here: set the "
            "friction of all pairings to 0"
        )


def require_fixed_contact(
    system: System, user: str, instead: str = "use LinearlyImplicitEuler"
) -> None:
    """Raise SceneError for contact in scenes with bodies, attachments or joints."""
    if system.contact is not None and (system.kinematics.matrix_varies or system.rows is not None):
        raise SceneError(
            f"{user} does not support contact in scenes with bodies, attachments or joints: {instead}"
        )
