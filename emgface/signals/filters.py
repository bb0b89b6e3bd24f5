"""Band-pass filters of raw signals.

A signal is a DataArray of two dims, of which one is time in seconds, uniformly sampled, and the
other labels the rows (channel, muscle, marker). Error messages contain the row and the instant.
"""

import warnings
from typing import Any, Final

import numpy as np
import scipy.signal
import xarray as xr

from emgface.errors import FeatureWarning, SignalError
from emgface.signals.parameters import FilterParameters

LARGEST_VARIATION = 10e-3
"""Standard deviation [V] above which surface EMG is suspect: amplified, or in another unit."""
TIME_EMG = "time_emg"
NYQUIST_FRACTION: Final = 0.9
"""Fraction of half the sampling rate at which a narrowed pass-band ends; anti-aliasing filters of
recorders attenuate above it."""


def sampling_rate(time: np.ndarray | xr.DataArray) -> float:
    """Sampling rate [Hz] of uniformly spaced instants [s], (samples - 1) / duration.

    Raises SignalError if there are fewer than two samples, or the spacing varies by more than 10 %.
    """
    t = np.asarray(time, dtype=float)
    if t.ndim != 1 or t.size < 2:
        raise SignalError(
            f"found {t.size} instants, expected at least 2: check the length of the recording"
        )
    spacing = np.diff(t)
    period = (t[-1] - t[0]) / (t.size - 1)
    if period < 0:
        raise SignalError(
            f"time runs from {t[0]:.6g} s back to {t[-1]:.6g} s, expected ascending times: sort the "
            "samples of the recording"
        )
    # NaN fails this comparison also. Rounded times of text files vary by a few per cent.
    uniform = np.abs(spacing - period) <= 0.1 * abs(period)
    if not period > 0 or not uniform.all():
        k = int(np.argmin(uniform))
        raise SignalError(
            f"sampling is not uniform at t = {t[k]:.6g} s: found a spacing of {spacing[k]:.6g} s, "
            f"expected {period:.6g} s; resample to a uniform rate or cut the recording there"
        )
    return float(1.0 / period)


def row_dim(signal: xr.DataArray, time_dim: str = TIME_EMG) -> str:
    """Name of the dimension of a two-dimensional signal that is not time.

    Raises SignalError if the signal has other than two dims, no such time, times other than numbers of
    seconds, or samples that are not real numbers.
    """
    others = [str(dim) for dim in signal.dims if dim != time_dim]
    if time_dim not in signal.dims or len(others) != 1:
        raise SignalError(
            f"found dims {tuple(signal.dims)}, expected one of rows and '{time_dim}': "
            "rename or select dims"
        )
    if time_dim not in signal.coords:
        raise SignalError(f"found no times of the samples, expected seconds: assign '{time_dim}'")
    for what, array in (("times", signal[time_dim]), ("samples", signal)):
        if array.dtype.kind not in "fiu":
            raise SignalError(
                f"the {what} are of type {array.dtype}, expected real numbers"
                f"{' of seconds' if what == 'times' else ''}: convert them"
            )
    return others[0]


def first_gap(values: np.ndarray) -> tuple[int, int] | None:
    """Return first index and length of the first run of non-finite values, or None without one."""
    bad = ~np.isfinite(values)
    if not bad.any():
        return None
    start = int(np.argmax(bad))
    good = np.isfinite(values[start:])
    length = int(np.argmax(good)) if good.any() else values.size - start
    return start, length


def check_gaps(signal: xr.DataArray, time_dim: str = TIME_EMG) -> None:
    """Raise SignalError, with row, start and length of its first gap, unless all samples are finite."""
    dim = row_dim(signal, time_dim)
    time = np.asarray(signal[time_dim], dtype=float)
    rate = sampling_rate(time)
    values = np.asarray(signal.transpose(dim, time_dim), dtype=float)
    for name, row in zip(signal[dim].values, values, strict=True):
        gap = first_gap(row)
        if gap is not None:
            raise SignalError(
                f"{dim} {name} has a gap of {gap[1] / rate:.4g} s ({gap[1]} samples without "
                f"a finite value) at t = {time[gap[0]]:.6g} s, expected a continuous signal: "
                "cut the trial there or omit it"
            )


def constant_rows(signal: xr.DataArray) -> tuple[str, ...]:
    """Names of rows with one value throughout (electrode off, amplifier saturated)."""
    dim = row_dim(signal, TIME_EMG)
    values = np.asarray(signal.transpose(dim, TIME_EMG), dtype=float)
    with np.errstate(invalid="ignore"):
        spread = values.max(axis=1) - values.min(axis=1)
    # An infinite sample is a gap and no constant; infinity would be within its own tolerance.
    constant = np.isfinite(spread) & (
        spread <= 8 * np.finfo(float).eps * np.abs(values).max(axis=1)
    )
    return tuple(str(name) for name in signal[dim].values[constant])


def too_large_for_semg(filtered: xr.DataArray) -> str:
    """Sentence on the channel that varies most, if by more than `LARGEST_VARIATION`, else empty.

    `filtered` (channel, time_emg) [V] is sEMG after the band-pass, as with mV declared for uV.
    """
    spread = filtered.std(TIME_EMG).values
    k = int(np.argmax(np.nan_to_num(spread)))
    if not spread[k] > LARGEST_VARIATION:
        return ""
    return (
        f"channel {filtered['channel'].values[k]} varies by {spread[k]:.3g} V after the filter, "
        f"expected sEMG of at most {LARGEST_VARIATION:g} V: check the unit of the recording or "
        "its sidecar"
    )


def bandpass(signal: xr.DataArray, parameters: FilterParameters) -> xr.DataArray:
    """Butterworth band-pass as second-order sections, zero-phase or causal.

    The zero-phase filter runs forward and backward over the signal extended at both ends by its odd
    reflection of three periods of the lower edge; the causal one starts in the steady state of the
    first sample, so that an offset causes no transient.

    Signal and result have the dims (row, time_emg) [V]. The attributes of the result are
    ``sampling_rate`` [Hz], ``edge_gain`` [dB] at the lower and upper edge, ``filter_order``,
    ``filter_low`` and ``filter_high`` [Hz] as used (see `pass_band`), and ``filter_phase``. Raises
    SignalError if the sampling rate contains less than an octave of the pass-band, a sample is not
    finite, or the recording is shorter than the extension; warns (FeatureWarning) if the sampling
    rate narrows the pass-band. Source: Eskes et al. 2017, Methods (fourth order, 15-500 Hz).
    """
    dim = row_dim(signal)
    rate = sampling_rate(signal[TIME_EMG])
    low, high = pass_band(parameters, rate)
    if high < parameters.high:
        warnings.warn(
            f"the pass-band ends at {high:g} Hz instead of {parameters.high:g} Hz, because "
            f"the recording is sampled at {rate:g} Hz: amplitudes are smaller than those of "
            "recordings with a higher rate and should not be compared with them",
            FeatureWarning,
            stacklevel=2,
        )
    sos = np.asarray(
        scipy.signal.butter(parameters.order, (low, high), "bandpass", fs=rate, output="sos")
    )
    check_gaps(signal)
    values = np.asarray(signal.transpose(dim, TIME_EMG), dtype=float)
    if parameters.phase == "zero":
        padding = int(np.ceil(3.0 * rate / parameters.low))
        if values.shape[1] <= padding:
            raise SignalError(
                f"recording of {values.shape[1] / rate:.4g} s ({values.shape[1]} samples) is "
                f"shorter than the filter's extension of {padding / rate:.4g} s ({padding} "
                f"samples at {rate:g} Hz): record longer, raise low above {parameters.low:g} Hz or "
                "use phase = 'causal'"
            )
        filtered = scipy.signal.sosfiltfilt(sos, values, axis=1, padtype="odd", padlen=padding)
    else:
        state = scipy.signal.sosfilt_zi(sos)[:, None, :] * values[None, :, :1]
        filtered, _ = scipy.signal.sosfilt(sos, values, axis=1, zi=state)
    result = signal.transpose(dim, TIME_EMG).copy(data=filtered)
    passes = 2 if parameters.phase == "zero" else 1
    result.attrs |= {
        "sampling_rate": rate,
        "edge_gain": edge_gain(sos, rate, (low, high), passes),
        "filter_order": parameters.order,
        "filter_low": low,
        "filter_high": high,
        "filter_phase": parameters.phase,
    }
    return result


def pass_band(parameters: FilterParameters, rate: float) -> tuple[float, float]:
    """Return lower and upper edge of the pass-band [Hz] at a sampling rate [Hz].

    An upper edge above half the sampling rate, or less than 0.1 % below it, is lowered to 0.9 of half
    the rate, so that a recording of 1000 Hz is filtered to 15-450 Hz, also if its rate is 1000 Hz
    only up to the rounding of its times. Raises SignalError if less than an octave of the
    band remains.
    """
    low, nyquist = parameters.low, rate / 2.0
    high = parameters.high if parameters.high < 0.999 * nyquist else NYQUIST_FRACTION * nyquist
    if high < parameters.high and high < 2.0 * low:
        raise SignalError(
            f"the sampling rate of {rate:g} Hz contains nothing above {nyquist:g} Hz, "
            f"expected at least an octave of the pass-band from {low:g} to "
            f"{parameters.high:g} Hz: use a rate above {4.0 * low / NYQUIST_FRACTION:g} Hz or choose "
            "another band"
        )
    return low, high


def edge_gain(
    sos: np.ndarray, rate: float, edges: tuple[float, ...], passes: int = 1
) -> list[float]:
    """Gain of a filter at frequencies `edges` [Hz], passes times 20 log10 |H(f)| [dB]."""
    _, response = scipy.signal.sosfreqz(sos, worN=np.asarray(edges, dtype=float), fs=rate)
    return [float(gain) for gain in 20.0 * passes * np.log10(np.abs(response))]


def labelled_feature(
    signal: xr.DataArray,
    values: np.ndarray,
    time: np.ndarray,
    units: str,
    rate: float,
    attrs: dict[str, Any],
) -> xr.DataArray:
    """Return values (row, samples) computed from a signal with its row names and a new time [s].

    The result (row, time) has the attributes of the signal, unit and sampling rate [Hz], and
    `attrs`.
    """
    dim = row_dim(signal)
    return xr.DataArray(
        values,
        dims=(dim, "time"),
        coords={dim: signal[dim], "time": ("time", time, {"units": "s"})},
        name="feature",
        attrs={**signal.attrs, "sampling_rate": rate, **attrs, "units": units},
    )
