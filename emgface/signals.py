"""From raw to filtered signals, and from one sampling to another.

A signal is a DataArray of two dims, one of them time in seconds and uniformly sampled, the other
naming the rows (channel, muscle, marker). Every check names the row and the instant it failed at.
"""

import numpy as np
import scipy.signal
import xarray as xr
from scipy.interpolate import CubicSpline

from emgface.errors import SignalError
from emgface.parameters import FilterParameters, ResamplingParameters

TIME_EMG = "time_emg"


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
                f"{dim} {name} has a gap of {gap[1] / rate:.4g} s ({gap[1]} samples without a "
                f"finite value) at t = {time[gap[0]]:.6g} s, expected a continuous signal: cut the "
                "trial there or leave it out"
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
        edge, ``filter_order``, ``filter_low``, ``filter_high`` [Hz], ``filter_phase``.

    Raises
    ------
    SignalError
        If an edge reaches half the sampling rate, a sample is not finite, or the recording is
        shorter than the extension.

    Notes
    -----
    Source: Eskes et al. 2017, Methods (fourth order, 15-500 Hz).
    """
    dim = row_dim(signal)
    rate = sampling_rate(signal[TIME_EMG])
    sos = _design(parameters, rate)
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
        "edge_gain": edge_gain(sos, rate, (parameters.low, parameters.high), passes),
        "filter_order": parameters.order,
        "filter_low": parameters.low,
        "filter_high": parameters.high,
        "filter_phase": parameters.phase,
    }
    return result


def _design(parameters: FilterParameters, rate: float) -> np.ndarray:
    """Second-order sections of the band-pass at a sampling rate."""
    nyquist = rate / 2.0
    for name, edge in (("low", parameters.low), ("high", parameters.high)):
        if edge >= nyquist:
            remedy = (
                f"lower high below {nyquist:g} Hz or"
                if name == "high" and parameters.low < 0.9 * nyquist
                else "the recording cannot hold this pass-band,"
            )
            raise SignalError(
                f"pass-band edge {name} = {edge:g} Hz is not below half the sampling rate of "
                f"{rate:g} Hz: {remedy} record faster than {2 * parameters.high:g} Hz"
            )
    edges = (parameters.low, parameters.high)
    sos = scipy.signal.butter(parameters.order, edges, "bandpass", fs=rate, output="sos")
    return np.asarray(sos)


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


def simulation_times(start: float, stop: float, parameters: ResamplingParameters) -> np.ndarray:
    """Instants at which a simulation reads its activation.

    Parameters
    ----------
    start, stop : float [s]
        Interval that holds data.
    parameters : ResamplingParameters
        Number of steps, or sampling period [s].

    Returns
    -------
    ndarray, shape (steps + 1,) [s]
        Equally spaced instants from `start`, up to `stop` (steps) or at most `stop` (period).

    Raises
    ------
    SignalError
        If the interval is empty or shorter than one period.
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
    """Sample data at other equally spaced instants, with anti-aliasing where this decimates.

    Where the new period P is longer than the old one, each new sample is a weighted mean of the
    old ones: for bounded quantities with a Hann kernel of half width P, which is positive and
    cannot leave the range of the data (half amplitude at 1/(2P)); otherwise with a
    Blackman-windowed sinc of half width 4 P cut off at 0.4/P, flat in the pass-band, the data
    extended by their odd reflection. Where the new period is not longer, linear interpolation
    (bounded) or a cubic spline.

    Parameters
    ----------
    data : DataArray, dims (..., dim)
        Data on uniform instants [s].
    times : ndarray, shape (samples,) [s]
        Instants wanted, within those of the data.
    dim : str
        Time dimension of the data.
    bounded : bool
        Whether the result must stay within the range of the data (activations).

    Returns
    -------
    DataArray, dims (..., time)
        Resampled data; attr ``antialias`` names the kernel.

    Raises
    ------
    SignalError
        If the data are not finite, too short, or do not cover `times`.
    """
    old = np.asarray(data[dim], dtype=float)
    times = np.asarray(times, dtype=float)
    rate, new_rate = sampling_rate(old), sampling_rate(times)
    moved = data.transpose(..., dim)
    values = np.asarray(moved, dtype=float)
    if not np.isfinite(values).all():
        raise SignalError(
            "data to resample hold values that are not finite, expected none: bridge the gaps first"
        )
    slack = 1e-9 / rate + 1e-12 * np.abs(old).max()
    if times[0] < old[0] - slack or times[-1] > old[-1] + slack:
        raise SignalError(
            f"times from {times[0]:.6g} to {times[-1]:.6g} s are not covered by data from "
            f"{old[0]:.6g} to {old[-1]:.6g} s: choose times within the data"
        )
    # Instants relative to the first: the grid then is k / rate to full precision.
    wanted = np.clip(times - old[0], 0.0, (old.size - 1) / rate)
    if new_rate >= rate * (1.0 - 1e-6):
        kernel = "linear" if bounded else "cubic spline"
        sampled = _interpolate(values, np.arange(old.size) / rate, wanted, bounded)
    elif bounded:
        kernel = f"hann, half width {1 / new_rate:.6g} s"
        sampled = _decimate(values, rate, wanted, 1.0 / new_rate, _hann, reflect=False)
        low, high = values.min(-1, keepdims=True), values.max(-1, keepdims=True)
        sampled = np.clip(sampled, low, high)  # a mean exceeds its terms by rounding at most
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
    """Hann kernel on -1..1."""
    return 0.5 * (1.0 + np.cos(np.pi * x))


def _blackman_sinc(x: np.ndarray) -> np.ndarray:
    """Sinc of half width 4 periods, cut off at 0.4 / period, on -1..1, Blackman-windowed."""
    blackman = 0.42 + 0.5 * np.cos(np.pi * x) + 0.08 * np.cos(2.0 * np.pi * x)
    return np.sinc(0.8 * 4.0 * x) * blackman


def _decimate(
    values: np.ndarray, rate: float, wanted: np.ndarray, half_width: float, kernel, *, reflect: bool
) -> np.ndarray:
    """Weighted means of the samples within half_width of each wanted instant."""
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
