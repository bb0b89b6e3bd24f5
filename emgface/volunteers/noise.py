"""Signal-to-noise ratio of EMG, and noise for a given ratio."""

from collections.abc import Iterable
from typing import Final

import numpy as np
import scipy.signal

#: pass-band of the amplifier, of synthesised EMG and of the study [Hz]
RECORDING_BAND: Final = (15.0, 500.0)
POWER_WINDOW: Final = 0.25  #: length of the windows in which power is measured [s]


def window_power(emg: np.ndarray, sampling_rate: float) -> np.ndarray:
    """Power in the pass-band in consecutive windows, (channels, windows) [V^2]."""
    sos = scipy.signal.butter(4, RECORDING_BAND, "bandpass", fs=sampling_rate, output="sos")
    heard = scipy.signal.sosfiltfilt(sos, emg, axis=1)
    size = round(POWER_WINDOW * sampling_rate)
    count = heard.shape[1] // size
    pieces = heard[:, : count * size].reshape(len(heard), count, size)
    return np.square(pieces).mean(axis=2)


def active_power(
    trials: Iterable[np.ndarray], sampling_rate: float, *, runs: int = 1
) -> np.ndarray:
    """Power (channels,) [V^2] in the pass-band during activity.

    It is the mean over the windows with more than a quarter of the highest power. `trials` are the
    signals (channels, samples) [V] of all instructions of a person, so that every channel is active
    in some. If the same movements are repeated `runs` times, the power of a window is the mean of
    the repetitions.
    """
    power = np.concatenate([window_power(trial, sampling_rate) for trial in trials], axis=1)
    power = power.reshape(len(power), runs, -1).mean(axis=1)
    active = power > 0.25 * power.max(axis=1, keepdims=True)
    return np.where(active, power, 0.0).sum(axis=1) / active.sum(axis=1)


def signal_to_noise(
    trials: Iterable[np.ndarray], rest: np.ndarray, sampling_rate: float, *, runs: int = 1
) -> np.ndarray:
    """Signal-to-noise ratio (channels,) [dB] of every channel, ``10 log10(P_active / P_rest)``.

    `trials` and `runs` are as for `active_power`; `rest` (channels, samples) [V] is a rest without
    movement artefacts, and P_rest its mean power in the pass-band.
    """
    quiet = window_power(rest, sampling_rate).mean(axis=1)
    return 10.0 * np.log10(active_power(trials, sampling_rate, runs=runs) / quiet)


def noise_for(
    clean: Iterable[np.ndarray],
    snr: np.ndarray,
    *,
    mains_hum: float,
    sampling_rate: float,
    runs: int = 1,
) -> np.ndarray:
    """White noise (channels,) [V RMS] for signal-to-noise ratios `snr` [dB] above 0.

    ``P_noise = P_clean / (10^(snr/10) - 1)`` in the pass-band, because the power during activity
    contains signal and noise; hum of amplitude `mains_hum` [V] is part of the noise, and the result
    is 0 if the hum alone exceeds it. `clean` are the trials without noise, as for `active_power`.
    """
    wanted = active_power(clean, sampling_rate, runs=runs) / (
        10.0 ** (np.asarray(snr) / 10.0) - 1.0
    )
    passed = 2.0 * (RECORDING_BAND[1] - RECORDING_BAND[0]) / sampling_rate
    return np.sqrt(np.maximum(wanted - 0.5 * mains_hum**2, 0.0) / passed)
