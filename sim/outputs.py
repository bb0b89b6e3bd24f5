"""States at the times of output, at the ends of steps or interpolated within them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from sim.errors import ControlError
from sim.kinematics import rotations
from sim.state import Array, State, StepReport
from sim.steps.contract import Watch

LEAST_J_SHARE = (
    0.5  #: least det F of states inside an interval, relative to the smallest at its ends
)

STRAIGHT_ACTIVATION = 0.02
"""Deviation of an activation from a straight line up to which states are interpolated [1].

The tissue responds with the time constant beta of the damping: a burst that deviates by a from the
line within a step h moves it by about a h/(4 beta) of the displacement under constant activation,
1/500 for beta = 55 ms and h = 20 ms.
"""

Advance = Callable[[State, float, Watch | None], tuple[State, StepReport]]
"""Function that advances a state to a time [s] with a step control and an observer."""


def between(before: State, after: State, t: float) -> State:
    """State inside a step, by cubic interpolation of positions and velocities at its ends.

    The error of positions is of fourth order in the step and that of velocities of third, so that
    an integrator of second order keeps its order. History variables are not interpolated.

    Dense output by Hermite interpolation: Hairer, Norsett and Wanner, Solving Ordinary Differential
    Equations I, II.6.
    """
    h = after.t - before.t
    s = (t - before.t) / h
    turn = after.q - before.q

    def along(w0: float, w1: float, slope: float) -> Array:
        return slope * turn / h + w0 * before.v + w1 * after.v

    here = (s * (1.0 - s) ** 2, s**2 * (s - 1.0), s**2 * (3.0 - 2.0 * s))
    rate = (1.0 - 4.0 * s + 3.0 * s**2, 3.0 * s**2 - 2.0 * s, 6.0 * s * (1.0 - s))
    q, v = before.q + h * along(*here), along(*rate)
    if not len(before.frames):
        return State(t, q, v)
    return State(t, q, v, {}, *_bodies_between(before, after, here, rate))


def _bodies_between(
    before: State, after: State, here: tuple[float, float, float], rate: tuple[float, float, float]
) -> tuple[Array, Array]:
    """Frames and twists by the same cubic, applied to rotation vectors from the start of the step."""
    h = after.t - before.t
    way = after.frames[:, :3] - before.frames[:, :3]
    theta = rotations.difference(before.frames[:, 3:], after.frames[:, 3:])
    ends = before.twists, after.twists.copy()
    ends[1][:, 3:] = rotations.vector_rate(theta, ends[1][:, 3:])
    turn = np.concatenate([way, theta], axis=1)
    d = h * (here[2] * turn / h + here[0] * ends[0] + here[1] * ends[1])
    twists = rate[2] * turn / h + rate[0] * ends[0] + rate[1] * ends[1]
    # dexp(theta) is the transpose of dexp(-theta).
    twists[:, 3:] = rotations.vector_gradient(-d[:, 3:], twists[:, 3:])
    frames = before.frames.copy()
    frames[:, :3] += d[:, :3]
    frames[:, 3:] = rotations.turned(frames[:, 3:], d[:, 3:])
    return frames, twists


@dataclass(frozen=True)
class Interval:
    """Largest step, and the outputs within it."""

    until: float  #: end of the interval [s]
    inside: tuple[float, ...]  #: instants of output before the end [s]
    ends_output: bool  #: True if the end is an output


def intervals(start: float, duration: float, h: float, every: float) -> list[Interval]:
    """Divide a duration into steps of at most h [s] and outputs every `every` [s].

    The last step may be shorter.

    Raises ControlError if neither h nor `every` is a whole multiple of the other, or the duration is no
    whole number of outputs.
    """
    if _per_output(duration, h, every) > 1:
        groups = steps_to_outputs(start, duration, h, every)
        return [Interval(end, (), end == group[-1]) for group in groups for end in group]
    outputs, per_step = round(duration / every), max(round(h / every), 1)
    unit = every if per_step > 1 else h
    result: list[Interval] = []
    for first in range(0, outputs, per_step):
        last = min(first + per_step, outputs)
        inside = tuple(start + k * every for k in range(first + 1, last))
        # If every step is an output, both times are the same product and round equally.
        end = start + last * unit
        result.append(Interval(end, inside, True))
    return result


def steps_to_outputs(start: float, duration: float, h: float, every: float) -> list[list[float]]:
    """Ends [s] of the steps to each output, as of `intervals`, if no output is inside a step."""
    outputs, per_output = round(duration / every), _per_output(duration, h, every)
    count = np.arange(1, outputs * per_output + 1)
    return (start + count * h).reshape(outputs, per_output).tolist()


def _per_output(duration: float, h: float, every: float) -> int:
    """Whole steps to an output, at least 1; ControlError if the times do not fit each other."""
    times = every > 0.0 and np.isfinite([duration, every]).all()
    outputs = round(duration / every) if times else 0
    if outputs < 1 or abs(outputs * every - duration) > 1e-9 * max(duration, every):
        raise ControlError(
            f"duration {duration:g} s is not a whole number of outputs, one every {every:g} s"
        )
    per_step, per_output = max(round(h / every), 1), max(round(every / h), 1)
    if abs(per_step * every - per_output * h) > 1e-9 * max(h, every):
        raise ControlError(
            f"steps of {h:g} s and outputs every {every:g} s: expected one to be a whole multiple of "
            "the other"
        )
    return per_output


@dataclass
class Between:
    """Collector of the states at given instants."""

    wanted: tuple[float, ...]  #: instants, ascending [s]
    states: list[State] = field(default_factory=list[State])  #: states collected so far

    def __call__(self, before: State, after: State) -> None:
        """Interpolate the instants within one accepted step."""
        self.states += [between(before, after, t) for t in self._within(before.t, after.t)]

    def _within(self, t0: float, t1: float) -> Iterator[float]:
        return (t for t in self.wanted[len(self.states) :] if t0 < t <= t1)


def outputs_of(
    advance: Advance,
    state: State,
    interval: Interval,
    smallest_J: Callable[[Array], float],
    astray: float = 0.0,
) -> list[tuple[State, StepReport | None]]:
    """States at all instants of an interval, its end last; no report for instants inside a step.

    A cubic may invert an element that is not inverted at the ends, and does not contain the
    response to the activation within the step. The interval is therefore computed with steps that
    end at its outputs if the smallest det F of an interpolated state is below `LEAST_J_SHARE` times that
    of the ends, or if the activation deviates by more than `STRAIGHT_ACTIVATION` from its straight line.

    Raises InvertedElement, NotConverged, SingularSystem as `advance`.

    `smallest_J` is the smallest det F at positions (n_nodes, 3) [m], and `astray` the largest distance
    of the activation from its straight line over the interval [1].
    """
    if not interval.inside:
        return [advance(state, interval.until, None)]
    if astray > STRAIGHT_ACTIVATION:
        return list(_to_each(advance, state, interval))
    inner = Between(interval.inside)
    end, report = advance(state, interval.until, inner)
    least = LEAST_J_SHARE * min(smallest_J(state.q), smallest_J(end.q))
    if all(smallest_J(passed.q) >= least for passed in inner.states):
        return [*((passed, None) for passed in inner.states), (end, report)]
    (first, again), *others = _to_each(advance, state, interval)
    return [(first, _after(report, again)), *others]


def _to_each(
    advance: Advance, state: State, interval: Interval
) -> Iterator[tuple[State, StepReport]]:
    """States at all instants of an interval by steps that end there."""
    for t in (*interval.inside, interval.until):
        state, report = advance(state, t, None)
        yield state, report


def _after(refused: StepReport, report: StepReport) -> StepReport:
    """Return the report with the cost of a rejected attempt added."""
    return replace(
        report,
        rejected=report.rejected + refused.rejected + refused.steps,
        iterations=report.iterations + refused.iterations,
        factorisations=report.factorisations + refused.factorisations,
        shifts=report.shifts + refused.shifts,
    )
