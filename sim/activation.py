"""Activation as a function of time, and its linear approximation within a step."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.errors import ControlError
from sim.state import Array, Control, Line
from sim.system import System

CHORD_FACTOR = 4.0
"""Factor on the largest deviation from the chord by which the rise of a first-order step is reduced.

With at least 2 the ends of the line remain in the range of the activation. With 4 the whole impulse
of a burst shorter than two steps is applied at any position, and a linear activation is reproduced.
"""

FINE_SAMPLES = 17
"""Number of instants, besides the samples, at which the misfit of a line is integrated over a step."""

CORNER = 1e-9
"""Fraction of a step within which a sample of the activation is assigned to the end of the step."""


@dataclass(frozen=True, eq=False)
class Activation:
    """Activation of all muscles over time: linear between samples, constant before and after them.

    Raises
    ------
    ControlError
        Shapes disagree, times do not ascend, or values are not real numbers.
    """

    time: Array  #: (n,) ascending [s]
    values: Array  #: (n, n_muscles) in 0-1

    def __post_init__(self) -> None:
        for name in ("time", "values"):
            given = np.asarray(getattr(self, name))
            if given.dtype.kind not in "iuf":
                raise ControlError(
                    f"the {name} of the activation are of type {given.dtype}, expected real numbers: "
                    "convert them"
                )
            object.__setattr__(self, name, np.asarray(given, dtype=np.float64))
        if self.values.ndim != 2 or len(self.values) != len(self.time) or len(self.time) == 0:
            raise ControlError(
                f"activation has shape {self.values.shape} for {len(self.time)} times, expected "
                "(time, muscle)"
            )
        if not (np.diff(self.time) > 0.0).all():
            raise ControlError("the times of the activation are not ascending")

    def at(self, t: float) -> Array:
        """Activation (n_muscles,) at time t [s]; the operations of `at_all`, for one number."""
        last = len(self.time) - 1
        i = min(max(int(np.searchsorted(self.time, t)) - 1, 0), max(last - 1, 0))
        after = min(i + 1, last)
        span = float(self.time[after] - self.time[i]) if after > i else np.inf
        s = min(max((t - float(self.time[i])) / span, 0.0), 1.0)
        return (1.0 - s) * self.values[i] + s * self.values[after]

    def at_all(self, t: Array) -> Array:
        """Activations (n, n_muscles) at times (n,) [s]."""
        last = max(len(self.time) - 2, 0)
        i = np.clip(np.searchsorted(self.time, t) - 1, 0, last)
        after = np.minimum(i + 1, len(self.time) - 1)
        span = np.where(after > i, self.time[after] - self.time[i], np.inf)
        s = np.clip((t - self.time[i]) / span, 0.0, 1.0)[:, None]
        return (1.0 - s) * self.values[i] + s * self.values[after]

    def within(self, t0: float, t1: float) -> tuple[Array, Array]:
        """Samples between two instants: relative times c in 0-1 (k,), and values (k, n_muscles)."""
        first = int(np.searchsorted(self.time, t0, side="right"))
        inside = slice(first, max(first, int(np.searchsorted(self.time, t1, side="left"))))
        c = np.concatenate([[0.0], (self.time[inside] - t0) / (t1 - t0), [1.0]])
        return c, np.concatenate([self.at(t0)[None], self.values[inside], self.at(t1)[None]])


def resting(n_muscles: int) -> Activation:
    """Zero activation of all muscles."""
    return Activation(np.zeros(1), np.zeros((1, n_muscles)))


@dataclass(frozen=True, eq=False)
class Driven:
    """Control of a system by an activation; the interface is `sim.state.ControlAt`."""

    system: System
    activation: Activation

    def __call__(self, t: float) -> Control:
        """Return the control at time t [s]."""
        return self.system.control(self.activation.at(t), t)

    def at_ends(self, times: Sequence[float]) -> Array:
        """Activations (n, n_muscles) at the ends of the lines of the steps between times (n + 1,).

        For a step without samples inside it, this is the activation at its end.
        """
        corner, t = self.activation.time, np.asarray(times)
        slack = CORNER * np.diff(t)
        first = np.searchsorted(corner, t[:-1] + slack, side="right")
        bent = np.flatnonzero(first < np.searchsorted(corner, t[1:] - slack, side="left"))
        ends = self.activation.at_all(t[1:])
        for i in bent.tolist():
            ends[i] = self.chord(t[i], t[i + 1] - t[i]).at(1.0).activation
        return ends

    def chord(self, t: float, h: float) -> Line:
        """Line with the mean of the activation, and its slope reduced by the deviation from linearity.

        rise = sign(a1 - a0) max(|a1 - a0| - 4 d, 0), where d is the largest distance from the
        chord.
        """
        c, a = self.activation.within(t, t + h)
        whole = a[-1] - a[0]
        astray = np.abs(a - (a[0] + c[:, None] * whole)).max(axis=0)
        rise = np.sign(whole) * np.maximum(np.abs(whole) - CHORD_FACTOR * astray, 0.0)
        return Line(_mean(c, a), rise, t, h)

    def moments(self, t: float, h: float, places: tuple[float, ...]) -> Line:
        """Line with the mean and first moment of the activation, limited to 0-1.

        rise = 12/h int a (c - 1/2) dt is the projection onto linear functions of c = (time - t)/h.
        It is reduced where the line would leave 0-1 at the `places` c at which it is evaluated; the
        mean is exact.
        """
        c, a = self.activation.within(t, t + h)
        mean, rise = _mean(c, a), _projected_rise(c, a)
        for place in places:
            away = abs(place - 0.5)
            if away > 0.0:
                up = rise if place > 0.5 else -rise
                up = np.clip(up, -mean / away, (1.0 - mean) / away)
                rise = up if place > 0.5 else -up
        return Line(mean, rise, t, h)

    def misfit(self, line: Line) -> tuple[Array, Array]:
        """Two measures of the difference m between activation and line, (n_muscles,) each [1].

        The mean of m over the step is zero, so that the impulse of the step is exact. The first measure
        is the first moment of m, the integral of (1 - c) m over the relative time c. It is not zero
        where the line had to be limited to 0-1, as with a switch or a spike near one end of the step;
        the impulse then acts too early or too late. The second is the integral of |P| over c, where
        P'' = m and P = P' = 0 at the start. It differs from zero wherever the activation is not a
        straight line; for a symmetric spike it is half of its second moment.
        """
        c, a = self.activation.within(line.t, line.t + line.h)
        none = np.zeros_like(line.mean)
        if len(c) == 2 or not none.size:
            return none, none
        fine = np.union1d(c, np.linspace(0.0, 1.0, FINE_SAMPLES))
        columns: list[Array] = [np.interp(fine, c, a[:, k]) for k in range(a.shape[1])]
        m = np.stack(columns, axis=1) - line.mean - (fine[:, None] - 0.5) * line.rise
        d = np.diff(fine)[:, None]
        once = np.concatenate([none[None], np.cumsum(0.5 * d * (m[:-1] + m[1:]), axis=0)])
        more = d * once[:-1] + d * d * (2.0 * m[:-1] + m[1:]) / 6.0
        twice = np.concatenate([none[None], np.cumsum(more, axis=0)])
        return twice[-1], 0.5 * (d * np.abs(twice[:-1] + twice[1:])).sum(axis=0)

    def astray(self, t0: float, t1: float) -> float:
        """Largest distance of the activation from its straight line over an interval [1]."""
        c, a = self.activation.within(t0, t1)
        line = self.moments(t0, t1 - t0, ())
        return float(np.abs(a - line.mean - (c[:, None] - 0.5) * line.rise).max(initial=0.0))


def _projected_rise(c: Array, a: Array) -> Array:
    """Rise 12 int a (c - 1/2) dc of the projection onto linear functions of c in 0-1."""
    x = c[:, None] - 0.5
    first = np.diff(x, axis=0) * (a[:-1] * (2 * x[:-1] + x[1:]) + a[1:] * (x[:-1] + 2 * x[1:]))
    return 2.0 * first.sum(axis=0)


def _mean(c: Array, a: Array) -> Array:
    """Mean over c in 0-1 of a function that is linear between samples."""
    mean = 0.5 * (np.diff(c)[:, None] * (a[1:] + a[:-1])).sum(axis=0)
    return np.clip(mean, 0.0, 1.0)  # rounding may exceed the range
