"""Fixed step size."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sim.integrators.contract import Integrator, RunsSteps
from sim.integrators.workspace import Workspace
from sim.state import ControlAt, State, StepReport
from sim.steps.contract import Watch, require_positive, united
from sim.system import System


@dataclass(frozen=True)
class FixedStep:
    """Fixed step size; a failure ends the simulation.

    Attributes
    ----------
    h : float
        Step [s].
    """

    h: float = 0.01

    def __post_init__(self) -> None:
        require_positive(self.h)

    def through(
        self,
        integrator: RunsSteps,
        system: System,
        state: State,
        control: ControlAt,
        groups: Sequence[Sequence[float]],
        work: Workspace,
    ) -> Iterator[tuple[State, StepReport]]:
        """States after each group of steps that end at the given times [s], with one report each."""
        for passed, reports in integrator.run(system, state, control, groups, work):
            yield passed, united(reports, 0)

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
        """Advance by one step."""
        new, report = integrator.step(system, state, control, until - state.t, work)
        if watch is not None:
            watch(state, new)
        return new, report
