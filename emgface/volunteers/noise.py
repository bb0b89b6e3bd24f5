"""Signal-to-noise ratio of EMG, and noise for a given ratio."""

from collections.abc import Iterable
from typing import Final

import numpy as np
import scipy.signal

BAND: Final = (15.0, 500.0)
"""Pass-band of the study [Hz]."""
WINDOW: Final = 0.25
"""Length of the windows in which power is measured [s]."""


def window_power(emg: np.ndarray, sampling_rate: float) -> np.ndarray:
    """Power in the pass-band in consecutive windows.

    Parameters
    ----------
    emg : array, shape (channels, samples) [V]
    sampling_rate : float
        Hertz.

    Returns
    -------
    array, shape (channels, windows) [V^2]
    """
    sos = scipy.signal.butter(4, BAND, "bandpass", fs=sampling_rate, output="sos")
    heard = scipy.signal.sosfiltfilt(sos, emg, axis=1)
    size = round(WINDOW * sampling_rate)
    count = heard.shape[1] // size
    pieces = heard[:, : count * size].reshape(len(heard), count, size)
    return np.square(pieces).mean(axis=2)


def active_power(
    trials: Iterable[np.ndarray], sampling_rate: float, *, runs: int = 1
) -> np.ndarray:
    """Power in the pass-band while active: mean over the windows above a quarter of the highest.

    Parameters
    ----------
    trials : iterable of array, shape (channels, samples) [V]
        All instructions of a person, so that every channel is active in some.
    sampling_rate : float
        Hertz.
    runs : int
        How many times the trials hold the same movements one after the other; the power of a window is
        their mean.

    Returns
    -------
    array, shape (channels,) [V^2]
    """
    power = np.concatenate([window_power(trial, sampling_rate) for trial in trials], axis=1)
    power = power.reshape(len(power), runs, -1).mean(axis=1)
    active = power > 0.25 * power.max(axis=1, keepdims=True)
    return np.where(active, power, 0.0).sum(axis=1) / active.sum(axis=1)


def signal_to_noise(
    trials: Iterable[np.ndarray], rest: np.ndarray, sampling_rate: float, *, runs: int = 1
) -> np.ndarray:
    """Signal-to-noise ratio of every channel, ``10 log10(P_active / P_rest)``.

    Parameters
    ----------
    trials : iterable of array, shape (channels, samples) [V]
        Trials of all instructions; P_active as `active_power`.
    rest : array, shape (channels, samples) [V]
        A rest without movement artefacts; P_rest is its mean power in the pass-band.
    sampling_rate : float
        Hertz.
    runs : int
        As `active_power`.

    Returns
    -------
    array, shape (channels,) [dB]
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
    """White noise for the signal-to-noise ratio of every channel.

    ``P_noise = P_clean / (10^(snr/10) - 1)`` in the pass-band, because the power during activity
    contains signal and noise; hum is part of the noise.

    Parameters
    ----------
    clean : iterable of array, shape (channels, samples) [V]
        Trials of all instructions without noise.
    snr : array, shape (channels,) [dB]
        Above 0.
    mains_hum : float
        Amplitude of the hum [V].
    sampling_rate : float
        Hertz.
    runs : int
        As `active_power`.

    Returns
    -------
    array, shape (channels,) [V]
        Root mean square over all frequencies, 0 where the hum alone is stronger.
    """
    wanted = active_power(clean, sampling_rate, runs=runs) / (
        10.0 ** (np.asarray(snr) / 10.0) - 1.0
    )
    passed = 2.0 * (BAND[1] - BAND[0]) / sampling_rate
    return np.sqrt(np.maximum(wanted - 0.5 * mains_hum**2, 0.0) / passed)
