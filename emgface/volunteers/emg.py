"""Surface EMG synthesised from known activations.

Each channel is ``gain * source(t)``. The source is the sum of action potentials of motor units
(`emgface.volunteers.motor_units`) or, computed faster, ``drive(t) * noise(t)`` with stationary
Gaussian noise of the power spectrum of surface EMG and an amplitude proportional to the activation
of the muscles under the electrode. Cross-talk between neighbouring channels, baseline noise of the
amplifier and mains hum are added. With a `emgface.volunteers.conduction.Conduction`, every muscle
is one source, recorded by all electrodes and filtered by the tissue.
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Final

import numpy as np
import xarray as xr

from emgface.errors import SignalError
from emgface.muscles import CHANNELS, CHANNELS_AT_MIDLINE, MUSCLES, NEIGHBOURS, SIDES
from emgface.volunteers.conduction import ELECTRODES, Conduction
from emgface.volunteers.motor_units import Pools, draw_pool, pool_signal
from emgface.volunteers.noise import RECORDING_BAND

FACE_PICKUP: Final[Mapping[str, Mapping[str, float]]] = {
    "OOS": {"OOP": 0.8, "OOM": 1.0},
    "OOI": {"OOP": 0.8, "OOM": 1.0},
    "RIS": {"RIS": 1.0},
    "ZYG": {"ZYG": 1.0},
    "LLSAN": {"LLSAN": 0.8, "LAO": 0.2 / 0.75},
    "DAO": {"DAO": 0.8, "DLI": 0.2 / 0.75},
    "MEN": {"MEN": 1.0},
}
"""Pick-up of the ten muscles of a side by the electrode pair over a muscle.

With the mapping M of Eqs 2-6 (ten muscles from seven channels) this pick-up P is a generalised
inverse, M P M = M: activations that obey the mapping are drive that the mapping returns exactly.
"""


def power_spectrum(frequency: np.ndarray) -> np.ndarray:
    """Power spectral density of surface EMG at frequencies in Hz, up to a factor [1/Hz^2].

    ``S(f) = high^4 f^2 / ((f^2 + low^2) (f^2 + high^2)^2)``; the corner frequencies 60 and 120 Hz
    result in most power between 50 and 200 Hz. Source: Shwedyk, Balasubramanian and Scott 1977,
    IEEE Trans Biomed Eng 24:417-424. Facial muscles: significant power from 15 to 500 Hz, van
    Boxtel 2001, Psychophysiology 38:22-34.
    """
    square, low, high = np.square(frequency), 60.0, 120.0
    return high**4 * square / ((square + low**2) * np.square(square + high**2))


def band_limited_noise(
    n_signals: int, n_samples: int, sampling_rate: float, rng: np.random.Generator
) -> np.ndarray:
    """Gaussian noise of unit variance with `power_spectrum` within `RECORDING_BAND`, (signals, samples).

    Raises SignalError if the sampling rate [Hz] is too low for the band or the signal too short for
    its lower edge.
    """
    if sampling_rate <= 2.0 * RECORDING_BAND[1]:
        raise SignalError(
            f"a sampling rate of {sampling_rate:g} Hz cannot represent sEMG up to "
            f"{RECORDING_BAND[1]:g} Hz: choose more than {2 * RECORDING_BAND[1]:g} Hz"
        )
    frequency = np.fft.rfftfreq(n_samples, 1.0 / sampling_rate)
    inside = (frequency >= RECORDING_BAND[0]) & (frequency <= RECORDING_BAND[1])
    if n_samples < sampling_rate / RECORDING_BAND[0]:
        raise SignalError(
            f"{n_samples} samples at {sampling_rate:g} Hz are shorter than one period of "
            f"{RECORDING_BAND[0]:g} Hz: use a longer trial"
        )
    density = np.where(inside, power_spectrum(frequency), 0.0)
    shape = (n_signals, frequency.size)
    spectrum = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
    # Parseval for a real signal: variance = (2 / n^2) sum |X_k|^2, and here E|X_k|^2 = 2 density
    spectrum *= np.sqrt(density) * n_samples / np.sqrt(4.0 * density.sum())
    return np.fft.irfft(spectrum, n_samples)


def pickup_matrix() -> np.ndarray:
    """Matrix of `FACE_PICKUP` for both sides, shape (14 channels, 20 muscles)."""
    matrix = np.zeros((len(CHANNELS), len(MUSCLES)))
    for row, channel in enumerate(CHANNELS):
        name, side = channel.split("_")
        for muscle, weight in FACE_PICKUP[name].items():
            matrix[row, MUSCLES.index(f"{muscle}_{side}")] = weight
    return matrix


def cross_talk_matrix(share: float) -> np.ndarray:
    """Symmetric mixing (14, 14) of channels: 1 on the diagonal, `share` between neighbours."""
    matrix = np.eye(len(CHANNELS))
    pairs = [(f"{a}_{side}", f"{b}_{side}") for a, b in NEIGHBOURS for side in ("L", "R")]
    pairs += [(f"{name}_L", f"{name}_R") for name in CHANNELS_AT_MIDLINE]
    for a, b in pairs:
        i, j = CHANNELS.index(a), CHANNELS.index(b)
        matrix[i, j] = matrix[j, i] = share
    return matrix


def synthesise_emg(
    activation: xr.DataArray,
    *,
    gain: Sequence[float] | np.ndarray,
    cross_talk: float,
    baseline_noise: float | np.ndarray,
    mains_hum: float,
    rng: np.random.Generator,
    sampling_rate: float = 2048.0,
    mains_frequency: float = 50.0,
    pools: Pools | None = None,
    conduction: Conduction | None = None,
) -> xr.DataArray:
    """Bipolar sEMG (channel, time_emg) [V] of the fourteen channels during one trial.

    `activation` is the neural excitation ``(muscle, time_true)`` [1]. `gain` (14,) is the
    root-mean-square amplitude of each channel at full activation [V]; with `conduction`, at full
    activation of the muscle under the electrodes. `cross_talk` is the fraction of a neighbour's
    amplitude (`cross_talk_matrix`), `baseline_noise` the root mean square of the white noise of the
    amplifier [V], one value or (14,), and `mains_hum` the amplitude of the sinusoidal hum [V].
    Frequencies are in Hz; a `sampling_rate` too low for the band of sEMG raises SignalError.
    `pools` are the motor units of `draw_pools`, at the sampling rate; the default is noise.
    `conduction` contains the paths of all muscles to all electrodes, instead of `FACE_PICKUP` and
    `cross_talk`.
    """
    true_time = activation["time_true"].values
    duration = float(true_time[-1] - true_time[0])
    time = np.arange(round(duration * sampling_rate) + 1) / sampling_rate
    active = activation.sel(muscle=list(MUSCLES)).values
    if conduction is not None:
        mixed = _conducted(conduction, active, time, true_time - true_time[0], pools, rng)
        emg = np.asarray(gain)[:, None] * mixed
    elif pools is None:
        drive = pickup_matrix() @ active
        envelope = np.stack([np.interp(time, true_time - true_time[0], row) for row in drive])
        source = envelope * band_limited_noise(len(CHANNELS), time.size, sampling_rate, rng)
        emg = cross_talk_matrix(cross_talk) @ (np.asarray(gain)[:, None] * source)
    else:
        envelope = np.stack([np.interp(time, true_time - true_time[0], row) for row in active])
        source = _unit_sources(pools, envelope, rng)
        emg = cross_talk_matrix(cross_talk) @ (np.asarray(gain)[:, None] * source)
    noise = np.broadcast_to(np.asarray(baseline_noise), (len(CHANNELS),))
    emg += noise[:, None] * rng.standard_normal(emg.shape)
    phase = rng.uniform(0.0, 2.0 * np.pi, size=(len(CHANNELS), 1))
    emg += mains_hum * np.sin(2.0 * np.pi * mains_frequency * time + phase)
    return xr.DataArray(
        emg,
        coords={
            "channel": list(CHANNELS),
            "time_emg": ("time_emg", time, {"units": "s"}),
        },
        dims=("channel", "time_emg"),
        attrs={"units": "V", "long_name": "bipolar surface EMG, simulated"},
    )


def draw_pools(rng: np.random.Generator, sampling_rate: float = 2048.0) -> Pools:
    """Draw the motor units within reach of the fourteen electrode pairs of a person, 24 pools.

    Each muscle under a pair (`FACE_PICKUP`) has a separate pool there: upper and lower lip are driven by
    different units of the orbicularis oris. The buccinator, which lies under no pair and is
    recorded only through the tissue, also has one. `sampling_rate` is in Hz.
    """
    pools = {
        (channel, f"{muscle}_{channel[-1]}"): draw_pool(rng, sampling_rate)
        for channel in CHANNELS
        for muscle in FACE_PICKUP[channel[:-2]]
    }
    for side in SIDES:
        pools[f"RIS_{side}", f"BUC_{side}"] = draw_pool(rng, sampling_rate)
    return pools


def _unit_sources(pools: Pools, activation: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Sum of the units at each pair, shape (14, samples), 1 at full activation."""
    weight = pickup_matrix()
    source = np.zeros((len(CHANNELS), activation.shape[1]))
    for (channel, muscle), pool in pools.items():
        if muscle[:-2] not in FACE_PICKUP[channel[:-2]]:
            continue
        row, column = CHANNELS.index(channel), MUSCLES.index(muscle)
        # As for noise, the gain refers to full activation of all muscles under a pair.
        source[row] += weight[row, column] * pool_signal(pool, activation[column], rng)
    return source


_ROOM = 0.1  #: duration of the zero padding before filtering, which avoids wrap-around [s]


def _conducted(
    conduction: Conduction,
    active: np.ndarray,
    time: np.ndarray,
    true_time: np.ndarray,
    pools: Pools | None,
    rng: np.random.Generator,
) -> np.ndarray:
    """Filtered mixture of all sources (14, samples); RMS 1 at full activation of the own muscle."""
    rate = (time.size - 1) / float(time[-1] - time[0])
    envelope = np.stack([np.interp(time, true_time, row) for row in active])
    rows = [MUSCLES.index(source.muscle) for source in conduction.sources]
    if pools is None:
        signal = envelope[rows] * band_limited_noise(len(rows), time.size, rate, rng)
    else:
        signal = np.stack(
            [
                pool_signal(pools[source.home, source.muscle], envelope[row], rng)
                for source, row in zip(conduction.sources, rows, strict=True)
            ]
        )
    length = time.size + round(_ROOM * rate)
    spectrum = np.fft.rfft(signal, length, axis=1)
    mixed = np.einsum("csf,sf->cf", _transfer(conduction, length, rate), spectrum)
    return np.fft.irfft(mixed, length, axis=1)[:, : time.size]


@lru_cache(maxsize=2)  # the noise of a person requires many signals of the same length
def _transfer(conduction: Conduction, length: int, rate: float) -> np.ndarray:
    """Transfer (14, sources, frequencies) of signals of this length, scaled by `_own_amplitude`."""
    frequency = np.fft.rfftfreq(length, 1.0 / rate)
    return conduction.transfer(frequency) / _own_amplitude(conduction)[:, None, None]


def _own_amplitude(conduction: Conduction) -> np.ndarray:
    """Root mean square (14,) of each channel with full activation of the muscle under it only."""
    frequency = np.arange(RECORDING_BAND[0], RECORDING_BAND[1])
    density = power_spectrum(frequency)
    passed = np.square(np.abs(conduction.transfer(frequency))) @ density / density.sum()
    homes = [(source.muscle, source.home) for source in conduction.sources]
    own = [
        homes.index((f"{ELECTRODES[channel[:-2]][0]}{channel[-2:]}", channel))
        for channel in CHANNELS
    ]
    return np.sqrt(passed[np.arange(len(CHANNELS)), own])
