"""Correlation of two coefficient vectors as a function of shift and stretch of time."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from scipy.signal import butter, correlate, correlation_lags, sosfiltfilt

Array = NDArray[np.float64]

LEAST_MOTION: Final = 0.5
"""Smallest fraction of the sum of squares of each vector within an overlap.

Without it, two segments with little motion that match by chance could be selected.
"""
LEAST_OVERLAP: Final = 0.5
"""Smallest overlap, as a fraction of the shorter vector, of shifts beyond the bound that are
examined for a better peak."""


@dataclass(frozen=True)
class Match:
    """Candidate: correlation at a shift [s] and a scale [1].

    `r` is the correlation over the overlap. `unexplained` is (1 - r |r|) max(1, v), where v is the
    measured variance inside the overlap divided by that of the whole; v compensates the increase of
    r if a segment without motion, which contains only noise, is left out. With r < 0, which a sign
    that is prescribed may leave as the best, it exceeds 1, so that the largest r is still preferred.
    `at_bound`: no peak lies inside the allowed shifts, or a clearly better one outside.
    """

    shift: float
    scale: float
    r: float
    unexplained: float
    at_bound: bool = False


def overlap_correlation(x: Array, y: Array) -> tuple[NDArray[np.int64], Array, Array, Array, Array]:
    """Pearson correlation of x[i] with y[i - lag] over the samples that overlap, at every lag.

    `x` (n,) and `y` (m,) have the same sampling period. Returns, each of shape (n + m - 1,): the
    lags, samples by which y is delayed; the correlation over the overlap, 0 if either is constant;
    the number of samples that overlap; the smaller of the two fractions of the sum of squares
    inside the overlap; and the variance of y there.
    """
    x, y = x - x.mean(), y - y.mean()
    n, m = len(x), len(y)
    lags = np.asarray(correlation_lags(n, m), dtype=np.int64)
    first, last = np.maximum(0, lags), np.minimum(n, m + lags)
    overlap = (last - first).astype(np.float64)

    def over(v: Array, shifted: bool) -> tuple[Array, Array]:
        start = first - lags if shifted else first
        sums = np.concatenate([[0.0], np.cumsum(v)])
        squares = np.concatenate([[0.0], np.cumsum(v**2)])
        stop = start + (last - first)
        total = sums[stop] - sums[start]
        return total, np.maximum(0.0, squares[stop] - squares[start] - total**2 / overlap)

    sum_x, square_x = over(x, shifted=False)
    sum_y, square_y = over(y, shifted=True)
    product = np.asarray(correlate(x, y, mode="full")) - sum_x * sum_y / overlap
    fraction = np.minimum(
        square_x / max(float((x**2).sum()), np.finfo(float).tiny),
        square_y / max(float((y**2).sum()), np.finfo(float).tiny),
    )
    r = np.zeros(len(lags))
    # Below this fraction the sums of squares have lost their digits to cancellation.
    moving = fraction > 1e-10
    r[moving] = product[moving] / np.sqrt(square_x[moving] * square_y[moving])
    return lags, np.clip(r, -1.0, 1.0), overlap, fraction, square_y / overlap


class Search:
    """Agreement of two coefficient vectors as a function of shift and scale.

    Both vectors are first low-pass filtered in the same way: interpolation between noisy samples
    averages the noise, so that without the filter fractional shifts would be preferred. The
    measured vector may begin `offset` seconds after the instant from which a shift is counted.
    """

    def __init__(
        self,
        measured: tuple[Array, Array],
        simulated: tuple[Array, Array],
        *,
        nominal: float,
        sign: int | None,
        cutoff: float | None,
        max_shift: float | None,
        least_overlap: float,
        least_gain: float,
        offset: float = 0.0,
    ) -> None:
        self.sign, self.max_shift, self.offset = sign, max_shift, offset
        self.least_overlap, self.least_gain = least_overlap, least_gain
        # The lags require a uniform grid; a simulation with halved steps has none.
        self.grid, self.x = _uniform(*simulated)
        self.period = float(self.grid[1])
        t_m, y = _uniform(*measured)
        if cutoff is not None:
            slower = max(self.period, nominal * float(t_m[1]))
            cutoff = min(cutoff, 0.2 / slower)
            self.x = _low_pass(self.x, cutoff * self.period)
            y = _low_pass(y, cutoff * nominal * float(t_m[1]))
        self.t_m = t_m
        self.spline = CubicSpline(t_m, y)
        self.variance = float(np.var(y))

    def at_scale(self, scale: float, *, subsample: bool) -> Match | None:
        """Find the best shift at one scale; None where no shift is allowed."""
        count = int(np.floor(scale * float(self.t_m[-1]) / self.period + 1e-9)) + 1
        if count < 2:
            return None
        source = np.minimum(self.period * np.arange(count) / scale, self.t_m[-1])
        lags, r, overlap, moved, variance = overlap_correlation(self.x, self.spline(source))
        shifts = lags * self.period - scale * self.offset
        shorter = min(len(self.grid), count)
        allowed = (overlap >= self.least_overlap * shorter * (1 - 1e-12)) & (moved >= LEAST_MOTION)
        if self.max_shift is not None:
            allowed &= np.abs(shifts) <= self.max_shift * (1 + 1e-12)
        if not allowed.any():
            return None
        anywhere = self._unexplained(r, variance)
        loss = np.where(allowed, anywhere, np.inf)
        best = int(np.argmin(loss))
        # At the edge of the allowed shifts, a low value may belong to a peak outside.
        inner, peak = _peaks(loss)
        peak[best] = True
        peak &= loss * (1.0 - self.least_gain) <= loss[best] + 1e-12
        index = np.flatnonzero(peak)
        chosen = int(index[np.argmin(np.abs(shifts[index]))])
        # There may be a better peak outside the bound than the one inside.
        seen = (overlap >= LEAST_OVERLAP * shorter) & (moved >= LEAST_MOTION)
        _, hidden = _peaks(np.where(seen | allowed, anywhere, np.inf))
        hidden &= ~allowed & (anywhere < (1.0 - self.least_gain) * loss[chosen] - 1e-12)
        at_bound = bool(not inner[chosen] or hidden.any())
        whole = self.at(float(shifts[chosen]), scale, at_bound)
        return self._climbed(whole, self.period) if subsample else whole

    def over_scales(
        self, nominal: float, least: float, most: float, step: float, *, subsample: bool
    ) -> Match | None:
        """Find the best shift and scale between two bounds, tried in relative steps."""
        low, high = np.log(least / nominal) / step, np.log(most / nominal) / step
        powers = range(int(np.ceil(low - 1e-9)), int(np.floor(high + 1e-9)) + 1)
        factors = np.exp(step * np.array(powers, dtype=np.float64))
        tried = [self.at_scale(nominal * float(k), subsample=subsample) for k in factors]
        matches = [match for match in tried if match is not None]
        best = min(matches, key=lambda match: match.unexplained, default=None)
        if best is None or not subsample:
            return best
        # A stretch by one step moves the end of the trajectory; a shift can offset that.
        reach = self.period + step * float(self.grid[-1])

        def loss(scale: float) -> float:
            return self._climbed(self.at(best.shift, scale), reach).unexplained

        low, high = max(best.scale * (1 - step), least), min(best.scale * (1 + step), most)
        scale = _minimum(loss, low, high, 1e-3 * step)
        finer = self._climbed(self.at(best.shift, scale, best.at_bound), reach)
        return finer if finer.unexplained < best.unexplained else best

    def at(self, shift: float, scale: float, at_bound: bool = False) -> Match:
        """Return the agreement at any shift and scale, over the covered simulated samples."""
        inside, source = within_lags((self.grid - shift) / scale - self.offset, self.t_m)
        if inside.sum() < 2:
            return Match(shift, scale, 0.0, 1.0, at_bound)
        x = self.x[inside] - self.x[inside].mean()
        y = np.asarray(self.spline(source[inside]), dtype=np.float64)
        y -= y.mean()
        xx, yy = float(x @ x), float(y @ y)
        r = float(np.clip(x @ y / np.sqrt(xx * yy), -1.0, 1.0)) if xx * yy > 0 else 0.0
        variance = np.asarray(yy / len(y))
        return Match(shift, scale, r, float(self._unexplained(np.asarray(r), variance)), at_bound)

    def _climbed(self, start: Match, reach: float) -> Match:
        """Find the peak within `reach` [s] of a shift, at one scale."""
        bound = np.inf if self.max_shift is None else self.max_shift
        low, high = max(start.shift - reach, -bound), min(start.shift + reach, bound)
        if not low < high:
            return start

        def loss(shift: float) -> float:
            return self.at(shift, start.scale).unexplained

        shift = _minimum(loss, low, high, 1e-4 * self.period)
        finer = self.at(shift, start.scale, start.at_bound)
        # An optimum at a whole sample, such as that of two equal trajectories, is kept.
        return finer if finer.unexplained < start.unexplained - 1e-12 else start

    def _unexplained(self, r: Array, variance: Array) -> Array:
        good = np.abs(r) if self.sign is None else self.sign * r
        growth = np.maximum(1.0, variance / self.variance)
        return (1.0 - good * np.abs(good)) * growth


def _peaks(loss: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Samples with two finite neighbours, and the local minima among them."""
    padded = np.concatenate([[np.inf], loss, [np.inf]])
    inner = np.isfinite(padded[:-2]) & np.isfinite(padded[2:])
    return inner, np.isfinite(loss) & inner & (loss <= padded[:-2]) & (loss <= padded[2:])


def within_lags(source: Array, t_m: Array) -> tuple[NDArray[np.bool_], Array]:
    """Find the instants within the measured time, with rounding removed."""
    slack = 1e-9 * float(t_m[-1] - t_m[0])
    inside = (source >= t_m[0] - slack) & (source <= t_m[-1] + slack)
    return inside, np.clip(source, t_m[0], t_m[-1])


def _minimum(loss: Callable[[float], float], low: float, high: float, width: float) -> float:
    """Find a minimum between two bounds, to `width`."""
    optimum = minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": width})
    return float(optimum.x)


def _uniform(time: Array, values: Array) -> tuple[Array, Array]:
    """Interpolate a vector on a uniform grid of the same size that starts at zero."""
    start, period = time[0], (time[-1] - time[0]) / (len(time) - 1)
    grid = period * np.arange(len(time))
    if np.allclose(time - start, grid, rtol=0.0, atol=1e-6 * period):
        return grid, values
    return grid, np.asarray(CubicSpline(time - start, values)(grid), dtype=np.float64)


def _low_pass(values: Array, cutoff: float) -> Array:
    """Second-order Butterworth low-pass, forward and backward; `cutoff` in cycles per sample."""
    padlen = min(15, len(values) - 1)
    return np.asarray(sosfiltfilt(_sections(cutoff), values, padlen=padlen))


@lru_cache(maxsize=64)
def _sections(cutoff: float) -> Array:
    """Coefficients of the low-pass, whose design takes longer than its use."""
    return np.asarray(butter(2, 2.0 * cutoff, output="sos"))
