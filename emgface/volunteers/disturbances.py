"""Disturbances of electrodes: movement artefacts and failing contacts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

RAIL = 6.4e-3
"""Saturation voltage of the amplifier [V]."""
_KINDS: tuple[Literal["lost", "hum", "railed"], ...] = ("lost", "hum", "railed")


@dataclass(frozen=True)
class Failure:
    """Failure of an electrode pair.

    Attributes
    ----------
    channel : int
        Which one.
    start : float
        When [s]; it stays so until the end.
    kind : {"lost", "hum", "railed"}
        The signal stands still, is drowned by the mains, or sits on the rail.
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
    """Movement artefacts: excursions of the baseline when the skin moves under an electrode.

    Parameters
    ----------
    time : array, shape (samples,)
        Seconds.
    onsets : sequence of float
        When movements begin [s].
    n_channels : int
        Number of channels.
    probability : float
        Of an artefact in one channel at one movement.
    amplitude : float
        Median of the peaks [V]; log-normal with sigma 0.5.
    rng : Generator
        Source of randomness.

    Returns
    -------
    array, shape (n_channels, samples) [V]
        Sums of ``A (t/tau) exp(1 - t/tau) cos(2 pi f t)``, f U(1, 6) Hz, tau U(0.1, 0.3) s: below
        the band of muscles, as movement artefacts are (van Boxtel 2001, Psychophysiology
        38:22-34: they end between 15 and 25 Hz).
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
    """Draw the electrode pairs that fail during a session.

    Parameters
    ----------
    n_channels : int
        Number of channels.
    duration : float
        Of the session [s].
    probability : float
        Of one channel in one session.
    rng : Generator
        Source of randomness.

    Returns
    -------
    list of Failure
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
    """Apply failures of electrode pairs.

    Parameters
    ----------
    emg : array, shape (channels, samples) [V]
        Signals.
    time : array, shape (samples,) [s]
        Their times.
    failures : sequence of Failure
        Which ones, when and how.
    mains_frequency : float [Hz]
        Of the hum that an open contact picks up.
    rng : Generator
        Source of its phase and noise.

    Returns
    -------
    array, shape (channels, samples) [V]
        A copy.
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
