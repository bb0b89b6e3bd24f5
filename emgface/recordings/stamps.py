"""Period of samples, and their places among uniform instants, from times with jitter and gaps."""

import re
from typing import Final

import numpy as np

TIME_LABELS: Final = re.compile(
    r"(?:(?:[a-z]+[ _])?(?:times?|zeit|tijd|temps|tiempo|tempo|time ?stamps?)|t|secs?|seconds|elapsed"
    r"|x(?= ?[\[(]))(?:(?:\b|_).*)?",
    re.IGNORECASE,
)
"""Labels of columns of times in the languages of programs, with a unit or another word behind them."""

#: excess of an interval, in periods, from which samples may be missing
LOST_SAMPLE_PERIODS: Final = 0.6
BEYOND_JITTER: Final = 1.5  #: excess of a gap over the largest shortening of an interval by jitter


def usual_period(times: np.ndarray) -> float:
    """Usual interval of ascending times [s], not affected by jitter, rounding and a few gaps.

    The mean of (t[i + m] - t[i]) / m between the quartiles, over which rounding averages out, is
    taken for the m whose values scatter least.
    """
    best = (np.inf, float("nan"))
    for lag in (1, 4, 16, 64, 256, 1024):
        if lag > 1 and lag > times.size // 20:
            break
        slopes = (times[lag:] - times[:-lag]) / lag
        low, high = np.percentile(slopes, [25, 75])
        middle = float(slopes[(slopes >= low) & (slopes <= high)].mean())
        if middle > 0 and (high - low) / middle < 0.5 * best[0]:
            best = ((high - low) / middle, middle)
    return best[1]


def places_of(times: np.ndarray, period: float) -> np.ndarray:
    """Index of each instant among uniform ones, with lost samples between them.

    Jitter delays a sample and hence shortens a later interval; a loss does not. Rounding to a step
    longer than the period lengthens an interval by at most that step.
    """
    excess = np.diff(times) - period
    jitter = max(float(-excess.min()), 0.0)
    step = resolution_of(times)
    least = max(
        LOST_SAMPLE_PERIODS * period, BEYOND_JITTER * jitter, 1.001 * step if step > period else 0.0
    )
    candidates = np.flatnonzero(excess > least)
    lost = np.zeros(excess.size, dtype=np.int64)
    if step > period and candidates.size:
        period = _longest(times, candidates)
    lag = times - period * np.arange(times.size)
    edges = np.concatenate(([-1], candidates, [excess.size]))
    around = max(1, round(0.5 / period))
    for number, k in enumerate(candidates, start=1):
        before = lag[max(edges[number - 1] + 1, k + 1 - around) : k + 1]
        after = lag[k + 1 : min(edges[number + 1] + 1, k + 1 + around)]
        longer = float(excess[k])
        if jitter > 0.1 * period:
            longer = float(np.median(after) - np.median(before))
        lost[k] = max(round(longer / period), 0)
    return np.concatenate(([0], np.cumsum(1 + lost)))


def _longest(times: np.ndarray, gaps: np.ndarray) -> float:
    """Period of the longest part of rounded times without a gap after one of its samples."""
    ends = np.concatenate(([0], gaps + 1, [times.size]))
    k = int(np.argmax(np.diff(ends)))
    part = times[ends[k] : ends[k + 1]]
    return line_through(np.arange(part.size), part)[0]


def line_through(places: np.ndarray, times: np.ndarray) -> tuple[float, float]:
    """Slope and value at zero of the line through instants in the least-squares sense."""
    middle, centre = float(places.mean()), float(times.mean())
    away = places - middle
    slope = float(away @ (times - centre) / (away @ away))
    return slope, centre - slope * middle


def resolution_of(times: np.ndarray) -> float:
    """Step to which ascending times were rounded [s], 0 if they were not."""
    steps = np.diff(times)
    shortest = float(np.min(steps, where=steps > 1e-9, initial=np.inf))
    for step in (shortest, 0.1, 0.01, 0.001, 1e-4, 1e-5):
        counts = times / step
        if float(np.abs(counts - np.rint(counts)).max()) < 1e-3:
            return step
    return 0.0
