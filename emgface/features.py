"""From filtered signals to features: what a muscle does, as a slowly varying number.

The sliding windows hop by one sample. A window of N samples starting at sample t is labelled with
its start, centre or end; the feature's time runs from the first full window to the last.
"""

import warnings
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import scipy.signal
import xarray as xr

from emgface._kernels import running_sum, running_willison
from emgface.errors import FeatureWarning, SignalError
from emgface.parameters import FeatureParameters
from emgface.signals import TIME_EMG, check_gaps, row_dim, sampling_rate

Label = Literal["centre", "start", "end"]


def feature_of(
    signal: xr.DataArray,
    parameters: FeatureParameters,
    *,
    phase: Literal["zero", "causal"] = "zero",
) -> xr.DataArray:
    """Compute the feature that the parameters name.

    Parameters
    ----------
    signal : DataArray, dims (row, time_emg) [V]
        Filtered signal.
    parameters : FeatureParameters
        Kind of feature and its values.
    phase : str
        Phase of the envelope's low-pass; the windowed features have their label instead.

    Returns
    -------
    DataArray, dims (row, time)
        Feature: counts [1] for wamp, [V] otherwise. Attrs record every choice.

    Raises
    ------
    SignalError
        If a sample is not finite or the recording is shorter than the window.

    Warns
    -----
    FeatureWarning
        If a whole feature is zero or saturated.
    """
    if parameters.kind == "wamp":
        if parameters.threshold_baseline is None:
            assert parameters.threshold is not None
            threshold: float | xr.DataArray = parameters.threshold
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

    g(t) = sum over n = 1..N-1 of [|s(t+n-1) - s(t+n)| >= s_lim].

    Parameters
    ----------
    signal : DataArray, dims (row, time_emg) [V]
        Filtered signal.
    window : float [s]
        Window length, rounded to N samples.
    threshold : float, or DataArray with dims (row) [V]
        Threshold s_lim, one for all rows or one per row.
    comparison : str
        ``">="`` as printed, or ``">"``.
    label : str
        Instant of the window: ``"centre"``, ``"start"`` (as printed) or ``"end"``.

    Returns
    -------
    DataArray, dims (row, time) [1]
        Counts between 0 and N - 1.

    Raises
    ------
    SignalError
        If a sample is not finite, the window holds fewer than two samples, or the recording is
        shorter than the window.

    Warns
    -----
    FeatureWarning
        If a row counts no step, or every step, in every window; with the threshold to try.

    Notes
    -----
    Source: Eskes et al. 2017, Eq. 7. The count depends on the sampling rate as well as on the
    threshold, for the steps between samples shrink as the rate grows.
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
        running_willison(row, n, float(limits[k]), inclusive, out)

    feature = _slide(signal, window, label, count, name="wamp", units="1", least=2)
    feature.attrs["comparison"] = comparison
    feature.attrs["threshold"] = [float(limit) for limit in np.unique(limits)]
    _warn_if_mute(feature, signal.transpose(dim, TIME_EMG), limits)
    return feature


def root_mean_square(
    signal: xr.DataArray, *, window: float = 0.2, label: Label = "centre"
) -> xr.DataArray:
    """Root mean square of a sliding window, sqrt(sum s^2 / N).

    Parameters
    ----------
    signal : DataArray, dims (row, time_emg) [V]
        Filtered signal.
    window : float [s]
        Window length, rounded to N samples.
    label : str
        Instant of the window: ``"centre"``, ``"start"`` or ``"end"``.

    Returns
    -------
    DataArray, dims (row, time) [V]
        Root mean square.

    Raises
    ------
    SignalError
        If a sample is not finite or the recording is shorter than the window.
    """

    def rms(row: np.ndarray, n: int, out: np.ndarray, k: int) -> None:
        running_sum(np.square(row), n, out)
        np.sqrt(out / n, out=out)

    return _slide(signal, window, label, rms, name="rms", units="V", least=1)


def mean_absolute_value(
    signal: xr.DataArray, *, window: float = 0.2, label: Label = "centre"
) -> xr.DataArray:
    """Mean absolute value of a sliding window, sum |s| / N.

    Parameters
    ----------
    signal : DataArray, dims (row, time_emg) [V]
        Filtered signal.
    window : float [s]
        Window length, rounded to N samples.
    label : str
        Instant of the window: ``"centre"``, ``"start"`` or ``"end"``.

    Returns
    -------
    DataArray, dims (row, time) [V]
        Mean absolute value.

    Raises
    ------
    SignalError
        If a sample is not finite or the recording is shorter than the window.
    """

    def mav(row: np.ndarray, n: int, out: np.ndarray, k: int) -> None:
        running_sum(np.abs(row), n, out)
        out /= n

    return _slide(signal, window, label, mav, name="mav", units="V", least=1)


def linear_envelope(
    signal: xr.DataArray,
    *,
    cutoff: float = 6.0,
    order: int = 2,
    phase: Literal["zero", "causal"] = "zero",
) -> xr.DataArray:
    """Full-wave rectified signal after a Butterworth low-pass.

    Parameters
    ----------
    signal : DataArray, dims (row, time_emg) [V]
        Filtered signal.
    cutoff : float [Hz]
        Low-pass edge.
    order : int
        Design order.
    phase : str
        ``"zero"`` (forward and backward) or ``"causal"``.

    Returns
    -------
    DataArray, dims (row, time) [V]
        Envelope. It can undershoot zero slightly at steep ends of a burst.

    Raises
    ------
    SignalError
        If a sample is not finite, the edge reaches half the sampling rate, or the recording is
        shorter than three periods of the edge (zero phase).

    Notes
    -----
    Source: Buchanan et al. 2004 (3-10 Hz).
    """
    dim = row_dim(signal)
    check_gaps(signal)
    rate = sampling_rate(signal[TIME_EMG])
    if cutoff >= rate / 2.0:
        raise SignalError(
            f"envelope edge of {cutoff:g} Hz is not below half the sampling rate of {rate:g} Hz: "
            "lower envelope_cutoff"
        )
    rectified = np.abs(np.asarray(signal.transpose(dim, TIME_EMG), dtype=float))
    sos = scipy.signal.butter(order, cutoff, "lowpass", fs=rate, output="sos")
    if phase == "zero":
        padding = int(np.ceil(3.0 * rate / cutoff))
        if rectified.shape[1] <= padding:
            raise SignalError(
                f"recording of {rectified.shape[1] / rate:.4g} s is shorter than the envelope "
                f"filter's extension of {padding / rate:.4g} s: record longer, raise "
                f"envelope_cutoff above {cutoff:g} Hz or use phase = 'causal'"
            )
        # Even reflection keeps the extension non-negative.
        values = scipy.signal.sosfiltfilt(sos, rectified, axis=1, padtype="even", padlen=padding)
    else:
        state = scipy.signal.sosfilt_zi(sos)[:, None, :] * rectified[None, :, :1]
        values, _ = scipy.signal.sosfilt(sos, rectified, axis=1, zi=state)
    attrs = {
        "feature": "envelope",
        "envelope_cutoff": cutoff,
        "envelope_order": order,
        "envelope_phase": phase,
    }
    return _labelled(signal, values, np.asarray(signal[TIME_EMG]), "V", rate, attrs)


def neural_activation(
    envelope: xr.DataArray, *, delay: float = 0.04, C1: float = -0.97, C2: float = -0.97
) -> xr.DataArray:
    """Second-order recursive model of the twitch, after an electromechanical delay.

    u(t) = alpha e(t - d) - beta1 u(t - 1) - beta2 u(t - 2), with beta1 = C1 + C2, beta2 = C1 C2
    and unit gain, alpha = 1 + beta1 + beta2. Before the first sample e is its first value.

    Parameters
    ----------
    envelope : DataArray, dims (row, time) [V]
        Linear envelope e.
    delay : float [s]
        Electromechanical delay d, rounded to whole samples.
    C1, C2 : float
        Recursive coefficients per sample, |C1| < 1 and |C2| < 1.

    Returns
    -------
    DataArray, dims (row, time) [V]
        Neural activation u; normalise before `muscle_activation`.

    Raises
    ------
    SignalError
        If a coefficient is not stable, a sample is not finite, or the delay is negative.

    Notes
    -----
    Source: Buchanan et al. 2004, J Appl Biomech 20:367-395.
    """
    if not (abs(C1) < 1 and abs(C2) < 1):
        raise SignalError(
            f"recursive coefficients C1 = {C1:g}, C2 = {C2:g} are not stable: expected |C1| < 1 "
            "and |C2| < 1"
        )
    if not delay >= 0:
        raise SignalError(f"electromechanical delay is {delay:g} s, expected 0 s or more")
    dim = row_dim(envelope, "time")
    check_gaps(envelope, "time")
    rate = sampling_rate(envelope["time"])
    values = np.asarray(envelope.transpose(dim, "time"), dtype=float)
    lag = round(delay * rate)
    n = values.shape[1]
    delayed = np.concatenate([np.repeat(values[:, :1], min(lag, n), axis=1), values], axis=1)[:, :n]
    beta1, beta2 = C1 + C2, C1 * C2
    alpha = 1.0 + beta1 + beta2
    numerator, denominator = np.array([alpha]), np.array([1.0, beta1, beta2])
    state = scipy.signal.lfiltic(numerator, denominator, [1.0, 1.0]) * values[:, :1]
    u, _ = scipy.signal.lfilter(numerator, denominator, delayed, axis=1, zi=state)
    result = envelope.transpose(dim, "time").copy(data=u)
    result.attrs |= {"delay_samples": lag, "delay": lag / rate, "C1": C1, "C2": C2}
    return result


def muscle_activation(u: xr.DataArray, A: float = -1.5) -> xr.DataArray:
    """Nonlinear shape from neural to muscle activation, (exp(A u) - 1) / (exp(A) - 1).

    Parameters
    ----------
    u : DataArray [1]
        Normalised neural activation, 0-1.
    A : float
        Shape, between -3 (strongly curved) and 0 (linear).

    Returns
    -------
    DataArray [1]
        Muscle activation, 0-1.

    Raises
    ------
    SignalError
        If A is outside -3..0.

    Notes
    -----
    Source: Buchanan et al. 2004.
    """
    if not -3.0 <= A <= 0.0:
        raise SignalError(f"shape A = {A:g}, expected a value between -3 and 0")
    values = np.asarray(u, dtype=float)
    # At A -> 0 the quotient tends to u.
    shaped = values if A == 0.0 else np.expm1(A * values) / np.expm1(A)
    result = u.copy(data=shaped)
    result.attrs["A"] = A
    return result


def baseline_rms(signal: xr.DataArray, interval: tuple[float, float]) -> xr.DataArray:
    """Root mean square of each row over a rest interval.

    Parameters
    ----------
    signal : DataArray, dims (row, time_emg) [V]
        Filtered signal.
    interval : tuple of float [s]
        Start and end of the rest.

    Returns
    -------
    DataArray, dims (row) [V]
        Root mean square, above 0.

    Raises
    ------
    SignalError
        If the interval is not within the recording, or a row is silent there.
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
                "expected some noise: give a threshold in volts instead of threshold_baseline"
            )
    return xr.DataArray(rms, dims=dim, coords={dim: signal[dim]}, attrs={"units": "V"})


def _slide(
    signal: xr.DataArray,
    window: float,
    label: Label,
    kernel: Callable[[np.ndarray, int, np.ndarray, int], None],
    *,
    name: str,
    units: str,
    least: int,
) -> xr.DataArray:
    """Run a kernel over every row and label its windows."""
    dim = row_dim(signal)
    check_gaps(signal)
    time = np.asarray(signal[TIME_EMG], dtype=float)
    rate = sampling_rate(time)
    n = round(window * rate)
    if n < least:
        raise SignalError(
            f"window of {window:g} s holds {n} samples at {rate:g} Hz, expected at least {least}: "
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
        kernel(row, n, out[k], k)
    first, last = time[: out.shape[1]], time[n - 1 :]
    instants = {"start": first, "end": last, "centre": 0.5 * (first + last)}[label]
    attrs = {
        "feature": name,
        "label": label,
        "window": window,
        "window_samples": n,
        "window_used": n / rate,
    }
    return _labelled(signal, out, instants, units, rate, attrs)


def _labelled(
    signal: xr.DataArray,
    values: np.ndarray,
    time: np.ndarray,
    units: str,
    rate: float,
    attrs: dict[str, Any],
) -> xr.DataArray:
    dim = row_dim(signal)
    return xr.DataArray(
        values,
        dims=(dim, "time"),
        coords={dim: signal[dim], "time": ("time", time, {"units": "s"})},
        name="feature",
        attrs={**signal.attrs, "sampling_rate": rate, **attrs, "units": units},
    )


def _warn_if_mute(feature: xr.DataArray, signal: xr.DataArray, limits: np.ndarray) -> None:
    """Warn of rows whose count is 0 or N - 1 throughout, with the threshold to try."""
    dim = row_dim(feature, "time")
    counts = feature.values
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
        warnings.warn(
            f"Willison amplitude of {dim} {name} is {state} in every window at a threshold of "
            f"{limits[k]:.3g} V: {remedy}",
            FeatureWarning,
            stacklevel=3,
        )
