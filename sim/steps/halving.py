"""Fixed step size, halved where the integrator fails."""

from dataclasses import dataclass

from sim.checks import real_numbers
from sim.state import State, StepReport, united
from sim.steps.contract import FAILURES, DampingWatch, Motion, Watch, require_positive


@dataclass(frozen=True)
@real_numbers
class HalvingStep:
    """Fixed step size, halved wherever the integrator fails."""

    h: float = 0.01  #: largest step [s]
    max_halvings: int = 8  #: largest number of successive halvings

    def __post_init__(self) -> None:
        require_positive(self.h)

    def advance(
        self, motion: Motion, state: State, until: float, watch: Watch | None = None
    ) -> tuple[State, StepReport]:
        """Advance over the interval; failure halves the step, two successful steps double it."""
        start, total = state.t, until - state.t
        done, level, good = 0, 0, 0  # The unit of `done` is total / 2^max_halvings.
        finest = 1 << self.max_halvings
        reports: list[StepReport] = []
        rejected = 0
        damping = DampingWatch(motion, self.h)
        while done < finest:
            size = finest >> level
            t1 = until if done + size == finest else start + total * (done + size) / finest
            damping.require_damped(state, level)
            try:
                new, report = motion.step(state, t1 - state.t)
            except FAILURES:
                if level == self.max_halvings:
                    raise
                level, good, rejected = level + 1, 0, rejected + 1
                continue
            if watch is not None:
                watch(state, new)
            state = new
            reports.append(report)
            done, good = done + size, good + 1
            if level and good >= 2 and done % (finest >> (level - 1)) == 0:
                level, good = level - 1, 0
        return state, united(reports, rejected)
