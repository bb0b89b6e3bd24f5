"""Steps chosen by the estimated error of selected positions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from sim.checks import real_numbers
from sim.errors import InvertedElement, SceneError, ToleranceMissed
from sim.indices import indices, kept_until_known
from sim.integrators.contract import TimeIntegrator
from sim.scene import Index
from sim.state import Array, State, StepReport, united
from sim.steps.contract import FAILURES, DampingWatch, Motion, Watch, require_positive

STEPS_MEMORY = "steps"
"""Name in the memory of a state of (halvings of the next step, accumulated error [m])."""


@dataclass(frozen=True, eq=False)
@real_numbers
class ErrorControlledStep:
    """Steps h/2^k within every interval h, k by the estimated error at watched nodes.

    A step of length h is accepted if its estimated error is at most sqrt(h/horizon) of the remaining
    tolerance: the tolerance less the errors of earlier steps, each reduced by e^(-time/horizon). The
    horizon is the time constant with which the tissue loses the effect of an error. In steady motion
    the error of a step is then about h/horizon of the tolerance. A short transient, as after a jump of
    the load, may use the part that steady motion does not need; its steps become shorter as the
    remainder decreases. The smallest step may use the whole remainder, so that the sum stays below the
    tolerance.

    The estimate is that of the integrator, with the part of the activation that the line of the step
    misses. Without one, or if halving a step does not reduce the
    estimate according to the order of the method, the step is repeated in two halves and the error
    estimated from the difference. Steps never cross the end of an interval.

    Raises
    ------
    SceneError
        A number is not positive.

    Notes
    -----
    Error per unit step and the doubling estimate: Hairer, Norsett and Wanner, Solving Ordinary
    Differential Equations I, II.4.
    """

    reads_errors: ClassVar[bool] = True
    tolerance: float = 1e-4  #: largest error at the watched nodes [m]
    h: float = 0.01  #: largest step [s]
    #: (k,) watched nodes, or a mask (n_nodes,), such as the lip markers; all if None
    nodes: Index | None = None
    horizon: float = 0.03  #: time over which errors accumulate [s]
    #: the smallest step is h/2^max_halvings; its failure ends the simulation
    max_halvings: int = 10

    def __post_init__(self) -> None:
        if self.nodes is not None:
            nodes = kept_until_known("ErrorControlledStep", "node", self.nodes)
            object.__setattr__(self, "nodes", nodes)
        require_positive(self.h)
        for name in ("tolerance", "horizon"):
            if not getattr(self, name) > 0.0:
                raise SceneError(f"{name} = {getattr(self, name)!r}, expected a number > 0")

    def advance(
        self, motion: Motion, state: State, until: float, watch: Watch | None = None
    ) -> tuple[State, StepReport]:
        """Cover the interval, starting with the last step size of the previous interval.

        Raises
        ------
        InvertedElement, NotConverged, SingularSystem
            An element inverted in the smallest step, or no step converges.
        ToleranceMissed
            The smallest step that converges misses the tolerance.
        UnstableDamping
            Steps were divided because the damping of the current tangent feeds the motion.
        SceneError
            The integrator has no order in time, such as `Static`.
        """
        method = motion.integrator
        if not isinstance(method, TimeIntegrator):
            raise SceneError(
                f"{type(method).__name__} has no order in time, expected an integrator of motion"
            )
        start, total = state.t, until - state.t
        finest = 1 << self.max_halvings
        level, spent = state.memory.get(STEPS_MEMORY, np.zeros(2))
        done, level = 0, min(int(level), self.max_halvings)
        reports: list[StepReport] = []
        rejected, before = 0, np.inf  # the estimate of the attempt before, of twice the step
        failed: set[int] = set()  # lengths, in smallest steps, that failed from the current state
        gain = 2.0**method.order  # of the accuracy, by halving a step
        damping = DampingWatch(motion, self.h)
        while done < finest:
            size = finest >> level
            last = done + size == finest
            h = (until if last else start + total * (done + size) / finest) - state.t
            kept = spent * np.exp(-h / self.horizon)
            share = 1.0 if level == self.max_halvings else np.sqrt(min(h / self.horizon, 1.0))
            allowed = share * (self.tolerance - kept)
            new, report, error = state, None, np.inf
            damping.require_damped(state, level)
            try:
                new, report, error = self._attempt(motion, state, h, gain)
                if error > allowed and error > before / gain:
                    new, report, error = self._halves(motion, state, h, gain, new)
                    before = np.inf
                else:
                    before = error
            except FAILURES as failure:
                failed.add(size)
                if level == self.max_halvings:
                    if isinstance(failure, InvertedElement):
                        raise
                    left = finest - done
                    longer = sorted({min(1 << k, left) for k in range(1, level + 1)} - failed)
                    size, new, report, error = self._longer(
                        motion, state, total / finest, longer, gain, failure
                    )
                    last, h = done + size == finest, size * total / finest
                    kept = spent * np.exp(-h / self.horizon)
                    allowed = self.tolerance - kept
                before = np.inf
            if report is None or not error <= allowed:
                if level == self.max_halvings:
                    raise ToleranceMissed(error, allowed, h, state.t + h)
                level, rejected = level + 1, rejected + 1
                continue
            before, spent = np.inf, kept + report.error
            done += size
            failed.clear()
            aligned = level > 0 and done % (finest >> (level - 1)) == 0
            if aligned and error * 1.5 * gain <= allowed:
                level -= 1
            memory = {**new.memory, STEPS_MEMORY: np.array([level, spent])}
            new = replace(new, t=until if last else new.t, memory=memory)
            if watch is not None:
                watch(state, new)
            state = new
            reports.append(report)
        return state, united(reports, rejected)

    def _longer(
        self,
        motion: Motion,
        state: State,
        unit: float,
        sizes: Sequence[int],
        gain: float,
        failure: Exception,
    ) -> tuple[int, State, StepReport, float]:
        """Shortest step of `sizes` smallest steps `unit` [s] that converges, and its length.

        A very short step may fail by rounding, in which case weaker muscles are no remedy. Raises
        the `failure` of the smallest step if none of the steps converges.
        """
        for size in sizes:
            try:
                return size, *self._attempt(motion, state, size * unit, gain)
            except FAILURES:
                continue
        raise failure

    def _attempt(
        self, motion: Motion, state: State, h: float, gain: float
    ) -> tuple[State, StepReport, float]:
        """Step with its largest error; that of the report is the part that lasts."""
        new, report = motion.step(state, h)
        if report.local_error is not None:
            error, lasting = self._largest(report.local_error, report.input_error)
            return new, replace(report, error=lasting), error
        return self._halves(motion, state, h, gain, new)

    def _halves(
        self, motion: Motion, state: State, h: float, gain: float, new: State
    ) -> tuple[State, StepReport, float]:
        """Step in two halves, with its error from the difference to the whole step."""
        middle, first = motion.step(state, 0.5 * h)
        better, second = motion.step(middle, state.t + h - middle.t)
        error = (new.q - better.q) / (gain - 1.0)
        report = united([first, second], 0)
        largest, lasting = self._largest(error, report.input_error)
        return better, replace(report, local_error=error, error=lasting), largest

    def _largest(self, error: Array, missed: Array | None) -> tuple[float, float]:
        """Largest error of a step at a watched node [m], and the part that decays with the horizon.

        It is the sum of the lengths of the error and of those by `missed` activation.
        """
        lasting = np.linalg.norm(error, axis=1)
        passing = np.zeros_like(lasting)
        if missed is not None:
            more, passing = np.linalg.norm(missed, axis=2)
            lasting = lasting + more
        if self.nodes is not None:
            chosen = indices("ErrorControlledStep", "node", self.nodes, len(error))
            lasting, passing = lasting[chosen], passing[chosen]
        return float((lasting + passing).max()), float(lasting.max())
