"""Resampling of features and positions at the times of the simulation.

Source: Eskes et al. 2017, Synchronisation; each instruction is 160 steps.
"""

from collections.abc import Callable

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from emgface.errors import SignalError
from emgface.signals.filters import sampling_rate
from emgface.signals.parameters import ResamplingParameters


def simulation_times(start: float, stop: float, parameters: ResamplingParameters) -> np.ndarray:
    """Equally spaced sampling times [s] of the activation, from `start` to (at most) `stop` [s].

    Their number follows from the number of steps or the sampling period. Raises SignalError if the
    interval is empty or shorter than one period.
    """
    if not stop > start:
        raise SignalError(
            f"no data between {start:.6g} s and {stop:.6g} s, expected an interval: check that "
            "sEMG and markers were recorded at the same time"
        )
    if parameters.steps is not None:
        return np.linspace(start, stop, parameters.steps + 1)
    assert parameters.period is not None
    steps = int(np.floor((stop - start) / parameters.period * (1 + 1e-12)))
    if steps < 1:
        raise SignalError(
            f"interval of {stop - start:.4g} s is shorter than the sampling period of "
            f"{parameters.period:.4g} s: choose a shorter period"
        )
    return start + parameters.period * np.arange(steps + 1)


def resample(
    data: xr.DataArray, times: np.ndarray, *, dim: str = "time", bounded: bool = False
) -> xr.DataArray:
    """Sample data (..., dim) at other equally spaced instants [s], with anti-aliasing if this decimates.

    If the new period P is longer than the old one, each new sample is a weighted mean of the old
    ones: for bounded quantities (activations) with a Hann kernel of half width P, which is
    positive, so that the result stays within the range of the data (half amplitude at 1/(2P));
    otherwise with a Blackman-windowed sinc of half width 4 P cut off at 0.4/P, flat in the
    pass-band, the data extended by their odd reflection. If the new period is not longer, the data
    are interpolated linearly (bounded) or by a cubic spline. The attribute ``antialias`` of the
    result states the kernel. Raises SignalError if the data are not finite, too short, or do not
    cover `times`.
    """
    old = np.asarray(data[dim], dtype=float)
    times = np.asarray(times, dtype=float)
    rate, new_rate = sampling_rate(old), sampling_rate(times)
    moved = data.transpose(..., dim)
    values = np.asarray(moved, dtype=float)
    if not np.isfinite(values).all():
        raise SignalError(
            "the data to resample contain values that are not finite, expected none: "
            "interpolate the gaps first"
        )
    slack = 1e-9 / rate + 1e-12 * np.abs(old).max()
    if times[0] < old[0] - slack or times[-1] > old[-1] + slack:
        raise SignalError(
            f"times from {times[0]:.6g} to {times[-1]:.6g} s are not covered by data from "
            f"{old[0]:.6g} to {old[-1]:.6g} s: choose times within the data"
        )
    # Relative to the first instant the grid is k / rate to full precision.
    wanted = np.clip(times - old[0], 0.0, (old.size - 1) / rate)
    if new_rate >= rate * (1.0 - 1e-6):
        kernel = "linear" if bounded else "cubic spline"
        sampled = _interpolate(values, np.arange(old.size) / rate, wanted, bounded)
    elif bounded:
        kernel = f"hann, half width {1 / new_rate:.6g} s"
        sampled = _decimate(values, rate, wanted, 1.0 / new_rate, _hann, reflect=False)
        low, high = values.min(-1, keepdims=True), values.max(-1, keepdims=True)
        sampled = np.clip(sampled, low, high)  # removes rounding errors beyond the range
    else:
        kernel = f"blackman sinc, cut-off {0.4 * new_rate:.6g} Hz"
        sampled = _decimate(values, rate, wanted, 4.0 / new_rate, _blackman_sinc, reflect=True)
    dims = [str(d) for d in moved.dims[:-1]] + ["time"]
    coords = {name: data[name] for name in dims[:-1] if name in data.coords}
    result = xr.DataArray(sampled, dims=dims, coords=coords, name=data.name, attrs=dict(data.attrs))
    result = result.assign_coords(time=("time", times, {"units": "s"}))
    result.attrs["antialias"] = kernel
    return result


def _interpolate(
    values: np.ndarray, old: np.ndarray, wanted: np.ndarray, linear: bool
) -> np.ndarray:
    if not linear:
        return CubicSpline(old, values, axis=-1)(wanted)
    rows = values.reshape(-1, old.size)
    sampled = np.stack([np.interp(wanted, old, row) for row in rows])
    return sampled.reshape(*values.shape[:-1], wanted.size)


def _hann(x: np.ndarray) -> np.ndarray:
    """Hann kernel on the interval -1 to 1."""
    return 0.5 * (1.0 + np.cos(np.pi * x))


def _blackman_sinc(x: np.ndarray) -> np.ndarray:
    """Blackman-windowed sinc of half width 4 periods, cut off at 0.4 / period, on -1 to 1."""
    blackman = 0.42 + 0.5 * np.cos(np.pi * x) + 0.08 * np.cos(2.0 * np.pi * x)
    return np.sinc(0.8 * 4.0 * x) * blackman


def _decimate(
    values: np.ndarray,
    rate: float,
    wanted: np.ndarray,
    half_width: float,
    kernel: Callable[[np.ndarray], np.ndarray],
    *,
    reflect: bool,
) -> np.ndarray:
    """Weighted means of the samples within half_width of each new instant."""
    n = values.shape[-1]
    reach = int(np.ceil(half_width * rate)) + 1
    if reflect:
        if n <= reach:
            raise SignalError(
                f"data of {n / rate:.4g} s are shorter than the anti-aliasing kernel's "
                f"{reach / rate:.4g} s: use more steps or a longer recording"
            )
        first, last = values[..., :1], values[..., -1:]
        head = 2.0 * first - values[..., reach:0:-1]
        tail = 2.0 * last - values[..., -2 : -reach - 2 : -1]
        values = np.concatenate([head, values, tail], axis=-1)
        wanted = wanted + reach / rate
        n = values.shape[-1]
    sampled = np.empty((*values.shape[:-1], wanted.size))
    for k, t in enumerate(wanted):
        centre = round(t * rate)
        index = np.arange(max(centre - reach, 0), min(centre + reach + 1, n))
        x = (index / rate - t) / half_width
        weight = np.where(np.abs(x) < 1.0, kernel(x), 0.0)
        sampled[..., k] = values[..., index] @ (weight / weight.sum())
    return sampled
