"""Band-pass filters of raw signals.

A signal is a DataArray of two dims, one of them time in seconds and uniformly sampled, the other
naming the rows (channel, muscle, marker). Every check names the row and the instant it failed at.
"""

import warnings
from typing import Any, Final

import numpy as np
import scipy.signal
import xarray as xr

from emgface.errors import FeatureWarning, SignalError
from emgface.signals.parameters import FilterParameters

TIME_EMG = "time_emg"
HELD: Final = 0.9
"""Fraction of half the sampling rate at which a narrowed pass-band ends; anti-aliasing filters of
recorders attenuate above it."""


def sampling_rate(time: np.ndarray | xr.DataArray) -> float:
    """Compute the sampling rate of uniformly spaced instants.

    Parameters
    ----------
    time : array, shape (samples,) [s]
        Instants.

    Returns
    -------
    float [Hz]
        (samples - 1) / duration.

    Raises
    ------
    SignalError
        If there are fewer than two samples, or the spacing varies by more than 10 %.
    """
    t = np.asarray(time, dtype=float)
    if t.ndim != 1 or t.size < 2:
        raise SignalError(
            f"found {t.size} instants, expected at least 2: check the length of the recording"
        )
    spacing = np.diff(t)
    period = (t[-1] - t[0]) / (t.size - 1)
    # Written so that NaN fails too. Rounded text files leave a few per cent of jitter.
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

    Parameters
    ----------
    signal : DataArray, dims (row, time)
        Signal, in any order of dims.
    time_dim : str
        Time dimension.

    Returns
    -------
    str
        The other dimension.

    Raises
    ------
    SignalError
        If the signal has other than two dims or no such time.
    """
    others = [str(dim) for dim in signal.dims if dim != time_dim]
    if time_dim not in signal.dims or len(others) != 1:
        raise SignalError(
            f"found dims {tuple(signal.dims)}, expected one of rows and '{time_dim}': "
            "rename or select dims"
        )
    return others[0]


def first_gap(values: np.ndarray) -> tuple[int, int] | None:
    """First run of non-finite values.

    Parameters
    ----------
    values : ndarray, shape (samples,)
        One row of a signal.

    Returns
    -------
    tuple of int, or None
        First index and length of the run, None if all values are finite.
    """
    bad = ~np.isfinite(values)
    if not bad.any():
        return None
    start = int(np.argmax(bad))
    good = np.isfinite(values[start:])
    length = int(np.argmax(good)) if good.any() else values.size - start
    return start, length


def check_gaps(signal: xr.DataArray, time_dim: str = TIME_EMG) -> None:
    """Require every sample to be finite.

    Parameters
    ----------
    signal : DataArray, dims (row, time)
        Signal.
    time_dim : str
        Time dimension.

    Raises
    ------
    SignalError
        Naming the row, the start and the length of its first gap.
    """
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


def constant_rows(signal: xr.DataArray, time_dim: str = TIME_EMG) -> tuple[str, ...]:
    """Rows that hold one value throughout (electrode off, amplifier railed).

    Parameters
    ----------
    signal : DataArray, dims (row, time)
        Signal.
    time_dim : str
        Time dimension.

    Returns
    -------
    tuple of str
        Names of the constant rows.
    """
    dim = row_dim(signal, time_dim)
    values = np.asarray(signal.transpose(dim, time_dim), dtype=float)
    spread = values.max(axis=1) - values.min(axis=1)
    constant = spread <= 8 * np.finfo(float).eps * np.abs(values).max(axis=1)
    return tuple(str(name) for name in signal[dim].values[constant])


def bandpass(signal: xr.DataArray, parameters: FilterParameters) -> xr.DataArray:
    """Butterworth band-pass as second-order sections, zero-phase or causal.

    The zero-phase filter runs forward and backward over the signal extended at both ends by its
    odd reflection of three periods of the lower edge; the causal one starts in the steady state of
    the first sample, so that an offset leaves no transient.

    Parameters
    ----------
    signal : DataArray, dims (row, time_emg) [V]
        Raw signal.
    parameters : FilterParameters
        Order, edges [Hz], phase.

    Returns
    -------
    DataArray, dims (row, time_emg) [V]
        Filtered signal; attrs ``sampling_rate`` [Hz], ``edge_gain`` [dB] at the lower and upper
        edge, ``filter_order``, ``filter_low``, ``filter_high`` [Hz] as used (see `pass_band`),
        ``filter_phase``.

    Raises
    ------
    SignalError
        If the sampling rate leaves less than an octave of the pass-band, a sample is not finite,
        or the recording is shorter than the extension.

    Warns
    -----
    FeatureWarning
        If the pass-band was narrowed to what the sampling rate can hold.

    Notes
    -----
    Source: Eskes et al. 2017, Methods (fourth order, 15-500 Hz).
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
    """Return the edges of the pass-band at a sampling rate.

    An upper edge that half the sampling rate does not exceed is lowered to 0.9 of it, so that a
    recording of 1000 Hz is filtered to 15-450 Hz.

    Parameters
    ----------
    parameters : FilterParameters
        Edges wanted [Hz].
    rate : float [Hz]
        Sampling rate.

    Returns
    -------
    float, float [Hz]
        Lower and upper edge.

    Raises
    ------
    SignalError
        If less than an octave of the band is left.
    """
    low, nyquist = parameters.low, rate / 2.0
    high = parameters.high if parameters.high < nyquist else HELD * nyquist
    if high < parameters.high and high < 2.0 * low:
        raise SignalError(
            f"the sampling rate of {rate:g} Hz contains nothing above {nyquist:g} Hz, "
            f"expected at least an octave of the pass-band from {low:g} to "
            f"{parameters.high:g} Hz: use a rate above {4.0 * low / HELD:g} Hz or choose "
            "another band"
        )
    return low, high


def edge_gain(
    sos: np.ndarray, rate: float, edges: tuple[float, ...], passes: int = 1
) -> list[float]:
    """Gain of a filter at given frequencies.

    Parameters
    ----------
    sos : ndarray, shape (sections, 6)
        Second-order sections.
    rate : float [Hz]
        Sampling rate.
    edges : tuple of float [Hz]
        Frequencies.
    passes : int
        How often the filter runs over the signal.

    Returns
    -------
    list of float [dB]
        20 log10 |H(f)| times the number of passes.
    """
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
    """Return values computed from a signal with its row names and a new time.

    Parameters
    ----------
    signal : DataArray, dims (row, time_emg)
        Signal the values come from.
    values : ndarray, shape (rows, samples)
        Feature.
    time : ndarray, shape (samples,) [s]
        Its instants.
    units : str
        Its unit.
    rate : float [Hz]
        Sampling rate.
    attrs : dict
        Choices to record.

    Returns
    -------
    DataArray, dims (row, time)
        The feature, with the signal's attrs and the new ones.
    """
    dim = row_dim(signal)
    return xr.DataArray(
        values,
        dims=(dim, "time"),
        coords={dim: signal[dim], "time": ("time", time, {"units": "s"})},
        name="feature",
        attrs={**signal.attrs, "sampling_rate": rate, **attrs, "units": units},
    )
