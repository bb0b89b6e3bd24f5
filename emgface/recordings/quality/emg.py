"""Measures of each channel of EMG."""

import numpy as np
import pandas as pd
import scipy.signal
import xarray as xr
from scipy.ndimage import uniform_filter1d

from emgface.recordings.labels import constant_value
from emgface.recordings.quality.hum import LEAST_DURATION, mains_hum, power_density
from emgface.signals.filters import TIME_EMG, sampling_rate

ARTEFACT = (2.0, 15.0)
"""Band of movement artefacts [Hz], between the drift of electrodes and the band of muscles."""
MUSCLE = (15.0, 500.0)
"""Band of surface EMG [Hz] (Eskes et al. 2017; van Boxtel 2001, Psychophysiology 38:22-34)."""
RMS_WINDOW = 0.1  #: window of the moving root mean square [s]
DRIFT_WINDOW = 0.5  #: length of the windows whose means define the drift [s]
OCTAVE_RATE = 2.0 * MUSCLE[0] / 0.45
"""Sampling rate [Hz] above which a recording contains at least an octave of this band."""
NOISE_FREQUENCY = 500.0
"""Frequency [Hz] above which a recording contains the noise of the amplifier and no muscle."""
LEAST_FLOOR_RATE = 1500.0  #: sampling rate [Hz] that leaves a band above `NOISE_FREQUENCY`
EMG_QUALITY_COLUMNS = (
    "hum", "hum_frequency", "hum_rms", "hum_chance", "artefact", "drift", "stuck", "saturated",
    "baseline", "snr", "median_frequency", "floor",
)  # fmt: skip


def emg_quality(emg: xr.DataArray) -> pd.DataFrame:
    """Measure hum, artefact, drift, saturation, dropouts and noise of every channel.

    `emg` (channel, time_emg) [V] is the raw signal. The table (index: channel) has the columns
    ``hum`` (fraction of the power from 10 to 500 Hz in the lines of the mains), ``hum_frequency``
    [Hz], ``hum_rms`` [V], ``hum_chance`` (probability of such lines without hum); ``artefact``
    (fraction below 15 Hz of the power above 2 Hz); ``drift`` [V] (spread of the means of half
    seconds); ``stuck`` [s] (longest run of one value); ``saturated`` (fraction of samples in runs
    of three or more at the least or greatest value); ``baseline`` [V] and ``snr`` [dB] (10th
    percentile of the root mean square in 100 ms from 15 to 500 Hz, and the 95th over it);
    ``median_frequency`` [Hz] of that band; ``floor`` [V], 10th percentile of the root mean square
    in 100 ms above `NOISE_FREQUENCY` (NaN below `LEAST_FLOOR_RATE`). Values are NaN unless
    `can_be_judged`. Raises SignalError if the clock is not uniform.
    """
    rate = sampling_rate(emg[TIME_EMG])
    rows = [_measures(values, rate) for values in emg.transpose("channel", TIME_EMG).values]
    index = [str(name) for name in emg["channel"].values]
    return pd.DataFrame(rows, index=index, columns=list(EMG_QUALITY_COLUMNS))


def _measures(values: np.ndarray, rate: float) -> dict[str, float]:
    measures: dict[str, float] = {name: np.nan for name in EMG_QUALITY_COLUMNS}
    if not can_be_judged(values, rate):
        return measures
    hum = mains_hum(values, rate)
    frequency, density = power_density(values, rate)
    above = density[frequency >= ARTEFACT[0]].sum()
    slow = density[(frequency >= ARTEFACT[0]) & (frequency < ARTEFACT[1])].sum()
    size = round(DRIFT_WINDOW * rate)
    means = values[: values.size // size * size].reshape(-1, size).mean(axis=1)
    heard = in_muscle_band(values, rate)
    strength = np.sqrt(uniform_filter1d(heard**2, round(RMS_WINDOW * rate), mode="nearest"))
    low, high = np.percentile(strength, [10, 95])
    inside = (frequency >= MUSCLE[0]) & (frequency <= MUSCLE[1])
    running = np.cumsum(density[inside])
    return {
        "hum": hum.share,
        "hum_frequency": hum.frequency,
        "hum_rms": hum.rms,
        "hum_chance": hum.chance,
        "artefact": float(slow / above),
        "drift": float(np.ptp(means)),
        "stuck": longest_run(values) / rate,
        "saturated": _saturated(values),
        "baseline": float(low),
        "snr": float(20.0 * np.log10(high / low)) if low > 0 else np.inf,
        "median_frequency": float(frequency[inside][np.searchsorted(running, 0.5 * running[-1])]),
        "floor": _floor(values, rate),
    }


def _floor(values: np.ndarray, rate: float) -> float:
    """Noise of the amplifier above the band of muscles [V]."""
    if rate < LEAST_FLOOR_RATE:
        return float("nan")
    sos = scipy.signal.butter(4, (NOISE_FREQUENCY, 0.45 * rate), "bandpass", fs=rate, output="sos")
    heard = scipy.signal.sosfiltfilt(sos, values)
    strength = uniform_filter1d(heard**2, round(RMS_WINDOW * rate), mode="nearest")
    return float(np.sqrt(max(np.percentile(strength, 10), 0.0)))


def can_be_judged(values: np.ndarray, rate: float) -> bool:
    """Return True for a finite, varying channel of at least 1 s and `OCTAVE_RATE`."""
    return bool(
        rate >= OCTAVE_RATE
        and values.size >= LEAST_DURATION * rate
        and np.isfinite(values).all()
        and constant_value(values) is None
    )


def in_muscle_band(values: np.ndarray, rate: float) -> np.ndarray:
    """Filter signals (..., samples) without gaps to the band of surface EMG, without delay.

    The sampling rate is at least `OCTAVE_RATE`; if it is too low for 500 Hz, the band ends at 0.45
    of it.
    """
    edges = (MUSCLE[0], min(MUSCLE[1], 0.45 * rate))
    sos = scipy.signal.butter(4, edges, "bandpass", fs=rate, output="sos")
    padding = min(round(3.0 * rate / edges[0]), values.shape[-1] - 1)
    return np.asarray(scipy.signal.sosfiltfilt(sos, values, axis=-1, padlen=padding))


def _runs(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Starts and lengths of runs of one value."""
    starts = np.flatnonzero(np.concatenate(([True], np.diff(values) != 0)))
    return starts, np.diff(np.append(starts, values.size))


def longest_run(values: np.ndarray) -> int:
    """Return the number of samples in the longest run of one value."""
    return int(_runs(values)[1].max())


def _saturated(values: np.ndarray) -> float:
    starts, lengths = _runs(values)
    extreme = (values[starts] == values.min()) | (values[starts] == values.max())
    return float(lengths[extreme & (lengths >= 3)].sum() / values.size)
