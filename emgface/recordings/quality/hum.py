"""Measurement of mains hum in a signal, and its removal by a notch filter."""

from typing import NamedTuple

import numpy as np
import scipy.signal
import xarray as xr

from emgface.errors import SignalError
from emgface.signals.filters import TIME_EMG, check_gaps, row_dim, sampling_rate

MAINS = (50.0, 60.0)  #: frequencies of power grids [Hz]
HUM_BAND = (10.0, 500.0)  #: band over which hum is compared with the signal [Hz]
WANDER = 0.2  #: deviation of the mains from their frequency [Hz]
DECISIVE_DURATION = 20.0  #: duration [s] above which the averaged spectrum suffices for a decision
_FINER = 8
LEAST_DURATION = 1.0  #: shortest signal [s] whose spectrum is analysed


class Hum(NamedTuple):
    """Hum of one signal."""

    frequency: float  #: mains frequency that explains most of the power, 50 or 60 [Hz]
    share: float  #: fraction of the power from 10 to 500 Hz in its lines [1]
    rms: float  #: root mean square of these lines [V]
    chance: float  #: probability of a line of this power in a signal without hum [1]


def power_density(values: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Welch's estimate of the power density, with lines of 1 Hz, of signals (..., samples).

    The signals have at least the duration `LEAST_DURATION`. Returns frequencies (lines,) [Hz] and
    one-sided densities (..., lines) [V^2/Hz].
    """
    size = min(values.shape[-1], round(rate))
    # A linear trend would leak into the lines of low frequency.
    frequency, density = scipy.signal.welch(values, rate, nperseg=size, detrend=_detrended)
    return np.asarray(frequency), np.asarray(density)


def _detrended(values: np.ndarray) -> np.ndarray:
    return np.asarray(scipy.signal.detrend(values, axis=-1, type="linear"))


def mains_hum(values: np.ndarray, rate: float) -> Hum:
    """Measure mains hum as lines above the spectrum around 50 or 60 Hz and their harmonics.

    The channel (samples,) [V] has no gaps and lasts at least 1 s. Two lines on either side of the
    harmonic belong to it (the width of the window); the median of the lines 3 to 10 Hz away
    represents the signal below it. In a trial of one or two seconds the spectrum of any muscle has
    high and low lines; ``chance`` is the probability of such a line without hum.
    """
    frequency, density = power_density(values, rate)
    step = float(frequency[1])
    top = min(HUM_BAND[1], 0.49 * rate)
    total = float(density[(frequency >= HUM_BAND[0]) & (frequency <= top)].sum())
    best = Hum(MAINS[0], 0.0, 0.0, 1.0)
    for mains in MAINS:
        power = 0.0
        for line in np.arange(mains, top, mains):
            away = np.abs(frequency - line)
            inside = away <= 2.0 * step + 1e-9
            adjacent = (away >= 3.0 * step) & (away <= 10.0 * step) & (frequency > 0)
            power += float(density[inside].sum() - inside.sum() * np.median(density[adjacent]))
        # Single lines may by chance be below their neighbours; only the sum of all is used.
        power = max(power, 0.0)
        share = power / total if total > 0 else 0.0
        if share > best.share:
            best = Hum(mains, share, float(np.sqrt(power * step)), 1.0)
    return best._replace(
        chance=_chance(values, rate, np.arange(best.frequency, top, best.frequency))
    )


def _chance(values: np.ndarray, rate: float, lines: np.ndarray) -> float:
    """Probability that the strongest of several lines reaches its power by chance.

    Relative to the mean of m neighbouring lines of the same spectrum, the power of a line of noise
    has the F distribution of 2 and 2 m degrees of freedom: ``P(F > x) = (1 + x/m)^-m``; multiplied
    by the number of lines examined (Bonferroni).
    """
    duration = values.size / rate
    if duration > DECISIVE_DURATION or not lines.size:
        return 0.0 if lines.size else 1.0
    window = scipy.signal.windows.hann(values.size, sym=False)
    size = _FINER * values.size
    power = np.abs(np.fft.rfft(_detrended(values) * window, size)) ** 2
    frequency = np.fft.rfftfreq(size, 1.0 / rate)
    best = 1.0
    for line in lines:
        away = np.abs(frequency - line)
        adjacent = power[(away >= 3.0) & (away <= 10.0) & (frequency > 2.0)][:: 2 * _FINER]
        m, level = adjacent.size, float(adjacent.mean())
        if level > 0.0:
            ratio = float(power[away <= WANDER].max()) / level
            best = min(best, float((1.0 + ratio / m) ** -m))
    # The mains frequency varies, and each line within its range is one more comparison.
    return min(1.0, best * lines.size * max(1.0, 2.0 * WANDER * duration))


def remove_hum(
    signal: xr.DataArray, frequency: float, *, harmonics: bool = True, width: float = 2.0
) -> xr.DataArray:
    """Remove mains hum by notch filters, forward and backward, without delay.

    A notch also removes EMG: 2 Hz in every 50 are about 4 % of its power. `mains_hum` shows if it
    is required. `signal` (row, time_emg) [V] is the raw signal; `frequency` [Hz] is 50 or 60, or
    the measured frequency; `harmonics` includes all multiples below half the sampling rate; `width`
    [Hz] is the distance of the points at -6 dB of both passes together. The result has the
    attributes ``notch_frequency``, ``notch_width`` [Hz] and ``notch_lines``. Raises SignalError if
    the frequency is not below half the sampling rate, or the signal has a gap.
    """
    dim, rate = row_dim(signal), sampling_rate(signal[TIME_EMG])
    if not 0.0 < width < frequency < 0.5 * rate:
        raise SignalError(
            f"a notch of {width:g} Hz at {frequency:g} Hz does not fit a signal of {rate:g} Hz: "
            "expected width < frequency < half the sampling rate"
        )
    check_gaps(signal)
    values = np.asarray(signal.transpose(dim, TIME_EMG), dtype=float)
    lines = np.arange(frequency, 0.5 * rate - width, frequency) if harmonics else [frequency]
    for line in lines:
        b, a = scipy.signal.iirnotch(line, line / width, fs=rate)
        padding = min(round(3.0 * rate / width), values.shape[1] - 1)
        values = scipy.signal.filtfilt(b, a, values, axis=1, padlen=padding)
    result = signal.transpose(dim, TIME_EMG).copy(data=values)
    result.attrs |= {
        "notch_frequency": float(frequency),
        "notch_width": float(width),
        "notch_lines": len(lines),
    }
    return result
