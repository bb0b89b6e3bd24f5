"""Linear envelope and the transfer function from neural to muscle activation.

Source: Buchanan et al. 2004, J Appl Biomech 20:367-395; tried in Eskes et al. 2017, Methods.
"""

from typing import Literal

import numpy as np
import scipy.signal
import xarray as xr

from emgface.errors import SignalError
from emgface.signals.filters import TIME_EMG, check_gaps, labelled_feature, row_dim, sampling_rate


def linear_envelope(
    signal: xr.DataArray,
    *,
    cutoff: float = 6.0,
    order: int = 2,
    phase: Literal["zero", "causal"] = "zero",
) -> xr.DataArray:
    """Full-wave rectified signal after a Butterworth low-pass (Buchanan et al. 2004: 3-10 Hz).

    `signal` (row, time_emg) [V] is filtered already; `cutoff` [Hz] is the edge of the low-pass,
    `order` its design order and `phase` ``"zero"`` (forward and backward) or ``"causal"``. The
    result (row, time) [V] can be slightly negative at steep ends of a burst. Raises SignalError if
    a sample is not finite, the edge reaches half the sampling rate, or the recording is shorter
    than three periods of the edge (zero phase).
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
    return labelled_feature(signal, values, np.asarray(signal[TIME_EMG]), "V", rate, attrs)


def neural_activation(
    envelope: xr.DataArray, *, delay: float = 0.04, C1: float = -0.97, C2: float = -0.97
) -> xr.DataArray:
    """Second-order recursive model of the twitch, after an electromechanical delay.

    u(t) = alpha e(t - d) - beta1 u(t - 1) - beta2 u(t - 2), with beta1 = C1 + C2, beta2 = C1 C2 and
    unit gain, alpha = 1 + beta1 + beta2. Before the first sample e equals its first value.

    `envelope` e (row, time) [V] is a linear envelope, `delay` d [s] is rounded to whole samples,
    and the coefficients per sample fulfil |C1| < 1 and |C2| < 1. The result u (row, time) [V] is
    normalised before `muscle_activation`. Raises SignalError if a coefficient is not stable, a
    sample is not finite, or the delay is negative. Source: Buchanan et al. 2004, J Appl Biomech
    20:367-395.
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

    `u` [1] is normalised to 0-1, as the result; A lies between -3 (strongly curved) and 0 (linear),
    and SignalError is raised otherwise. Source: Buchanan et al. 2004.
    """
    if not -3.0 <= A <= 0.0:
        raise SignalError(f"shape A = {A:g}, expected a value between -3 and 0")
    values = np.asarray(u, dtype=float)
    # The quotient tends to u as A tends to 0.
    shaped = values if A == 0.0 else np.expm1(A * values) / np.expm1(A)
    result = u.copy(data=shaped)
    result.attrs["A"] = A
    return result
