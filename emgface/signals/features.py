"""Amplitude features of filtered signals.

The sliding windows advance by one sample. A window of N samples is labelled with its start, centre
or end (`label`); the time of the feature extends from the first full window to the last. Signals
have the dims (row, time_emg) [V], features (row, time). Every feature raises SignalError if a
sample is not finite or the recording is shorter than the window.
"""

import warnings
from collections.abc import Callable
from typing import Literal

import numpy as np
import xarray as xr

from emgface.errors import FeatureWarning, SignalError
from emgface.signals.doubtful import rest_rms
from emgface.signals.envelope import linear_envelope, neural_activation
from emgface.signals.filters import TIME_EMG, check_gaps, labelled_feature, row_dim, sampling_rate
from emgface.signals.parameters import FeatureParameters
from emgface.signals.running import running_sum, running_willison

Label = Literal["centre", "start", "end"]


def feature_of(
    signal: xr.DataArray,
    parameters: FeatureParameters,
    *,
    phase: Literal["zero", "causal"] = "zero",
) -> xr.DataArray:
    """Compute the feature specified by the parameters: counts [1] for wamp, [V] otherwise.

    `phase` is that of the envelope's low-pass; windowed features have a label instead. The
    attributes of the result record every choice. Warns as `willison_amplitude`.
    """
    if parameters.kind == "wamp":
        if parameters.threshold_rest is not None:
            rate = sampling_rate(np.asarray(signal[TIME_EMG], dtype=float))
            check_gaps(signal)
            threshold: float | xr.DataArray = parameters.threshold_rest * rest_rms(
                signal, parameters.window, rate
            )
        elif parameters.threshold_baseline is None:
            assert parameters.threshold is not None
            threshold = parameters.threshold
        else:
            assert parameters.baseline_start is not None and parameters.baseline_stop is not None
            interval = (parameters.baseline_start, parameters.baseline_stop)
            threshold = parameters.threshold_baseline * baseline_rms(signal, interval)
        return willison_amplitude(
            signal,
            window=parameters.window,
            threshold=threshold,
            comparison=parameters.comparison,
            label=parameters.label,
        )
    if parameters.kind == "rms":
        return root_mean_square(signal, window=parameters.window, label=parameters.label)
    if parameters.kind == "mav":
        return mean_absolute_value(signal, window=parameters.window, label=parameters.label)
    envelope = linear_envelope(
        signal,
        cutoff=parameters.envelope_cutoff,
        order=parameters.envelope_order,
        phase=phase,
    )
    return neural_activation(envelope, delay=parameters.delay, C1=parameters.C1, C2=parameters.C2)


def willison_amplitude(
    signal: xr.DataArray,
    *,
    window: float = 0.2,
    threshold: float | xr.DataArray = 10e-6,
    comparison: Literal[">=", ">"] = ">=",
    label: Label = "centre",
) -> xr.DataArray:
    """Willison amplitude, the number of steps that reach a threshold within a window.

    g(t) = sum over n = 1..N-1 of [|s(t+n-1) - s(t+n)| >= s_lim], between 0 and N - 1.

    `window` [s] is rounded to N samples, at least two; `threshold` s_lim [V] is one number or an
    array over rows; `comparison` is ``">="`` as printed, or ``">"``; `label` ``"start"`` is as
    printed. The count depends on the sampling rate also, because steps between samples decrease
    with a higher rate. FeatureWarning is issued for a row that counts no step, or every step, in
    every window, with a threshold to try. Source: Eskes et al. 2017, Eq. 7.
    """
    dim = row_dim(signal)
    limits = np.broadcast_to(
        threshold.sel({dim: signal[dim]}).values
        if isinstance(threshold, xr.DataArray)
        else np.float64(threshold),
        signal.sizes[dim],
    )
    inclusive = comparison == ">="

    def count(row: np.ndarray, n: int, out: np.ndarray, k: int) -> None:
        out[:] = running_willison(row, n, float(limits[k]), inclusive=inclusive)

    feature = _slide(signal, window, label, count, name="wamp", units="1", least=2)
    feature.attrs["comparison"] = comparison
    feature.attrs["threshold"] = [float(limit) for limit in np.unique(limits)]
    _warn_if_mute(feature, signal.transpose(dim, TIME_EMG), limits)
    return feature


def root_mean_square(
    signal: xr.DataArray, *, window: float = 0.2, label: Label = "centre"
) -> xr.DataArray:
    """Root mean square [V] of a sliding window of `window` seconds, sqrt(sum s^2 / N)."""

    def rms(row: np.ndarray, n: int, out: np.ndarray, k: int) -> None:
        np.sqrt(running_sum(np.square(row), n) / n, out=out)

    return _slide(signal, window, label, rms, name="rms", units="V", least=1)


def mean_absolute_value(
    signal: xr.DataArray, *, window: float = 0.2, label: Label = "centre"
) -> xr.DataArray:
    """Mean absolute value [V] of a sliding window of `window` seconds, sum |s| / N."""

    def mav(row: np.ndarray, n: int, out: np.ndarray, k: int) -> None:
        np.divide(running_sum(np.abs(row), n), n, out=out)

    return _slide(signal, window, label, mav, name="mav", units="V", least=1)


def baseline_rms(signal: xr.DataArray, interval: tuple[float, float]) -> xr.DataArray:
    """Root mean square of each row over a rest interval from start to end [s], dims (row) [V].

    Raises SignalError if the interval is not within the recording, or a row is zero there.
    """
    dim = row_dim(signal)
    check_gaps(signal)
    time = np.asarray(signal[TIME_EMG], dtype=float)
    start, stop = interval
    inside = (time >= start) & (time <= stop)
    tolerance = 1.5 / sampling_rate(time)
    if start < time[0] - tolerance or stop > time[-1] + tolerance or inside.sum() < 2:
        raise SignalError(
            f"baseline from {start:g} to {stop:g} s is not within the recording from {time[0]:.4g} "
            f"to {time[-1]:.4g} s: change baseline_start and baseline_stop"
        )
    values = np.asarray(signal.transpose(dim, TIME_EMG), dtype=float)[:, inside]
    rms = np.sqrt(np.mean(values**2, axis=1))
    for name, value in zip(signal[dim].values, rms, strict=True):
        if value == 0.0:
            raise SignalError(
                f"{dim} {name} is exactly zero over the baseline from {start:g} to {stop:g} s, "
                "expected some noise: specify a threshold in volts instead of threshold_baseline"
            )
    return xr.DataArray(rms, dims=dim, coords={dim: signal[dim]}, attrs={"units": "V"})


def _slide(
    signal: xr.DataArray,
    window: float,
    label: Label,
    one_row: Callable[[np.ndarray, int, np.ndarray, int], None],
    *,
    name: str,
    units: str,
    least: int,
) -> xr.DataArray:
    """Apply a function to every row and label its windows."""
    dim = row_dim(signal)
    check_gaps(signal)
    time = np.asarray(signal[TIME_EMG], dtype=float)
    rate = sampling_rate(time)
    n = round(window * rate)
    if n < least:
        raise SignalError(
            f"window of {window:g} s contains {n} samples at {rate:g} Hz, expected at least {least}: "
            "choose a longer window"
        )
    if n > time.size:
        raise SignalError(
            f"recording of {time.size / rate:.4g} s ({time.size} samples) is shorter than the "
            f"window of {window:g} s ({n} samples at {rate:g} Hz): record longer or choose a "
            "shorter window"
        )
    values = np.ascontiguousarray(signal.transpose(dim, TIME_EMG), dtype=float)
    out = np.empty((values.shape[0], time.size - n + 1))
    for k, row in enumerate(values):
        one_row(row, n, out[k], k)
    first, last = time[: out.shape[1]], time[n - 1 :]
    instants = {"start": first, "end": last, "centre": 0.5 * (first + last)}[label]
    attrs = {
        "feature": name,
        "label": label,
        "window": window,
        "window_samples": n,
        "window_used": n / rate,
    }
    return labelled_feature(signal, out, instants, units, rate, attrs)


def _warn_if_mute(feature: xr.DataArray, signal: xr.DataArray, limits: np.ndarray) -> None:
    """Warn of rows whose count is 0 or N - 1 throughout, with a threshold to try."""
    dim = row_dim(feature, "time")
    for name, text in mute_rows(feature, signal, limits):
        warnings.warn(MuteFeature(dim, name, text), stacklevel=3)


class MuteFeature(FeatureWarning):
    """Warning of a muscle or channel whose Willison amplitude never changes, with a threshold to try."""

    def __init__(self, dim: str, name: str, state: str) -> None:
        super().__init__(f"Willison amplitude of {dim} {name} is {state}")
        self.dim, self.name, self.state = dim, name, state


def mute_rows(
    feature: xr.DataArray, signal: xr.DataArray, limits: np.ndarray
) -> list[tuple[str, str]]:
    """Rows whose count is 0 or N - 1 throughout, each with its state and a threshold to try."""
    dim, counts, mute = row_dim(feature, "time"), feature.values, list[tuple[str, str]]()
    most = feature.attrs["window_samples"] - 1
    for k, name in enumerate(feature[dim].values):
        low, high = counts[k].min(), counts[k].max()
        if 0 < high and low < most:
            continue
        state = "zero" if high == 0 else f"saturated at {most}"
        median_step = float(np.median(np.abs(np.diff(signal.values[k]))))
        remedy = (
            f"try a threshold near {median_step:.2g} V, the median step between samples"
            if median_step > 0
            else "the signal hardly changes, check the electrode"
        )
        text = f"{state} in every window at a threshold of {limits[k]:.3g} V: {remedy}"
        mute.append((str(name), text))
    return mute
