"""Fixed step size."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sim.checks import real_numbers
from sim.integrators.contract import RunsSteps
from sim.state import Outputs, State, StepReport
from sim.steps.contract import Motion, Watch, require_positive


@dataclass(frozen=True)
@real_numbers
class FixedStep:
    """Fixed step size; a failure ends the simulation."""

    h: float = 0.01  #: step [s]

    def __post_init__(self) -> None:
        require_positive(self.h)

    def through(
        self, motion: Motion, state: State, groups: Sequence[Sequence[float]]
    ) -> Iterator[Outputs]:
        """States after each group of steps that end at the given times [s]."""
        method = motion.integrator
        assert isinstance(method, RunsSteps)
        return method.run(motion.system, state, motion.control, groups, motion.work)

    def advance(
        self, motion: Motion, state: State, until: float, watch: Watch | None = None
    ) -> tuple[State, StepReport]:
        """Advance by one step."""
        new, report = motion.step(state, until - state.t)
        if watch is not None:
            watch(state, new)
        return new, report
