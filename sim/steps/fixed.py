"""Steps of one size."""

from dataclasses import dataclass

from sim.integrators.contract import Integrator
from sim.integrators.workspace import Workspace
from sim.state import ControlAt, State, StepReport
from sim.steps.contract import Watch, require_positive
from sim.system import System


@dataclass(frozen=True)
class FixedStep:
    """Steps of one size; a failure ends the simulation.

    Attributes
    ----------
    h : float
        Step [s].
    """

    h: float = 0.01

    def __post_init__(self) -> None:
        """Check the step."""
        require_positive(self.h)

    def advance(
        self,
        integrator: Integrator,
        system: System,
        state: State,
        control: ControlAt,
        until: float,
        work: Workspace,
        watch: Watch | None = None,
    ) -> tuple[State, StepReport]:
        """One step."""
        new, report = integrator.step(system, state, control, until - state.t, work)
        if watch is not None:
            watch(state, new)
        return new, report
