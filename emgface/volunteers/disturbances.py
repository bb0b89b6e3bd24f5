"""Disturbances of electrodes: movement artefacts and failing contacts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

RAIL = 6.4e-3  #: saturation voltage of the amplifier [V]
_KINDS: tuple[Literal["lost", "hum", "railed"], ...] = ("lost", "hum", "railed")


@dataclass(frozen=True)
class Failure:
    """Failure of the electrode pair of a `channel` from `start` [s] to the end of the recording.

    The `kind` is "lost" (the signal is constant), "hum" (mains hum exceeds the signal) or "railed"
    (the amplifier is saturated).
    """

    channel: int
    start: float
    kind: Literal["lost", "hum", "railed"]


def movement_artefacts(
    time: np.ndarray,
    onsets: Sequence[float],
    n_channels: int,
    *,
    probability: float,
    amplitude: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Movement artefacts, shape (n_channels, samples) [V]: deviations of the baseline at movements.

    An artefact occurs in a channel with `probability` at each movement onset [s]. It is ``A (t/tau)
    exp(1 - t/tau) cos(2 pi f t)``, with f U(1, 6) Hz and tau U(0.1, 0.3) s, below the band of
    muscles (van Boxtel 2001, Psychophysiology 38:22-34: movement artefacts end between 15 and 25
    Hz). `amplitude` is the median of the log-normal peaks [V], with sigma 0.5; `time` is in
    seconds.
    """
    total = np.zeros((n_channels, time.size))
    for onset in onsets:
        for channel in np.flatnonzero(rng.uniform(size=n_channels) < probability):
            size = amplitude * np.exp(rng.normal(0.0, 0.5)) * rng.choice([-1.0, 1.0])
            frequency, tau = rng.uniform(1.0, 6.0), rng.uniform(0.1, 0.3)
            t = np.maximum(time - onset - rng.uniform(0.0, 0.3), 0.0)
            total[channel] += (
                size * (t / tau) * np.exp(1.0 - t / tau) * np.cos(2.0 * np.pi * frequency * t)
            )
    return total


def draw_failures(
    n_channels: int, duration: float, *, probability: float, rng: np.random.Generator
) -> list[Failure]:
    """Draw the electrode pairs that fail during a session of `duration` [s].

    `probability` is that of one channel in one session.
    """
    failing = np.flatnonzero(rng.uniform(size=n_channels) < probability)
    return [
        Failure(int(channel), float(rng.uniform(0.0, duration)), _KINDS[rng.integers(len(_KINDS))])
        for channel in failing
    ]


def fail(
    emg: np.ndarray,
    time: np.ndarray,
    failures: Sequence[Failure],
    *,
    mains_frequency: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return a copy of the signals (channels, samples) [V] with the failures of electrode pairs.

    `mains_frequency` [Hz] is that of the hum at an open contact, with random phase and noise.
    """
    result = emg.copy()
    for failure in failures:
        after = time >= failure.start
        if not after.any():
            continue
        if failure.kind == "lost":
            result[failure.channel, after] = result[failure.channel, np.argmax(after)]
        elif failure.kind == "railed":
            result[failure.channel, after] = RAIL
        else:
            phase = rng.uniform(0.0, 2.0 * np.pi)
            hum = 300e-6 * np.sin(2.0 * np.pi * mains_frequency * time[after] + phase)
            result[failure.channel, after] = hum + 5e-6 * rng.standard_normal(int(after.sum()))
    return result
