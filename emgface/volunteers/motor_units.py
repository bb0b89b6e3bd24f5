"""Motor units under the electrodes: recruitment, firing rates and recorded signals."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.signal

from emgface.volunteers.action_potentials import action_potentials, draw_geometry

UNITS: Final = 100
"""Motor units within reach of one electrode pair."""
RECRUITMENT_RANGE: Final = 30.0
"""Ratio of the largest to the smallest recruitment threshold."""
SIZE_RANGE: Final = 10.0
"""Ratio of the largest to the smallest action potential, small for facial muscles."""
LOWEST_RATE: Final = 8.0
"""Firing rate at recruitment [1/s]."""
HIGHEST_RATE: Final = 40.0
"""Largest firing rate of the first unit [1/s]."""
RATE_DIFFERENCE: Final = 10.0
"""Decrease of the largest firing rate from the first to the last unit [1/s]."""
RATE_GAIN: Final = 1.0
"""Increase of the firing rate per unit of excitation [1/s]."""
INTERVAL_VARIATION: Final = 0.2
"""Coefficient of variation of the intervals between discharges."""
PHASES: Final = 4
"""Number of positions between two samples at which a potential may begin."""
BAND: Final = (15.0, 500.0)
"""Pass-band of the amplifier [Hz]."""


@dataclass(frozen=True)
class MotorUnitPool:
    """Motor units of one muscle within reach of one electrode pair.

    Attributes
    ----------
    threshold : array, shape (units,)
        Excitation at which a unit begins, 1 for the first at about the least excitation.
    peak_rate : array, shape (units,) [1/s]
        Highest rate of discharge.
    full : float
        Excitation at activation 1, where the last unit fires at its highest rate.
    potential : array, shape (units, PHASES, samples)
        Action potential of each unit, later by a part of a sample from phase to phase; scaled so
        that activation 1 has a root mean square of 1.
    sampling_rate : float [Hz]
        Of the potentials.
    lead : int
        Samples of each potential before the discharge, which the filter needs.
    """

    threshold: np.ndarray
    peak_rate: np.ndarray
    full: float
    potential: np.ndarray
    sampling_rate: float
    lead: int

    def rates(self, activation: np.ndarray) -> np.ndarray:
        """Firing rate of every unit [1/s].

        Parameters
        ----------
        activation : array, shape (times,)
            0 to 1.

        Returns
        -------
        array, shape (units, times)
            0 below the threshold, then ``LOWEST_RATE + RATE_GAIN (E - threshold)`` up to the
            highest rate (Fuglevand et al. 1993, Eqs 1-5).
        """
        above = self.full * np.asarray(activation) - self.threshold[:, None]
        rate = np.minimum(LOWEST_RATE + RATE_GAIN * above, self.peak_rate[:, None])
        return np.where(above >= 0.0, rate, 0.0)

    def rms(self, activation: np.ndarray) -> np.ndarray:
        """Root mean square of the signal at constant activation, by Campbell's theorem.

        For independent Poisson trains the variance is the sum over units of rate times the
        integral of the squared potential; trains of more regular intervals come close to it where
        the potentials are short against the intervals and hold no steady part.

        Parameters
        ----------
        activation : array, shape (times,)
            0 to 1.

        Returns
        -------
        array, shape (times,)
            1 at activation 1.
        """
        energy = np.square(self.potential[:, 0]).sum(axis=1) / self.sampling_rate
        return np.sqrt(energy @ self.rates(activation))


def draw_pool(
    rng: np.random.Generator, sampling_rate: float, *, units: int = UNITS
) -> MotorUnitPool:
    """Draw the motor units of one muscle under one electrode pair.

    Parameters
    ----------
    rng : Generator
        Source of the fibres' places.
    sampling_rate : float
        Hertz.
    units : int
        Number of units.

    Returns
    -------
    MotorUnitPool

    Notes
    -----
    Thresholds ``exp(ln(RR) i / n)`` and sizes ``exp(ln(RP) i / n)`` rise exponentially (the size
    principle): Fuglevand, Winter and Patla 1993, J Neurophysiol 70:2470-2488, Eqs 1 and 7; highest
    rates fall with the threshold, Eqs 4-5. Facial units fire faster than those of limbs:
    discharges of the corrugator give its spectrum a peak near 31 Hz (van Boxtel 2001,
    Psychophysiology 38:22-34), hence a highest rate of 40 in place of 35 per second.
    """
    number = np.arange(1, units + 1)
    threshold = np.exp(np.log(RECRUITMENT_RANGE) * number / units)
    size = np.exp(np.log(SIZE_RANGE) * number / units)
    span = max(float(threshold[-1] - threshold[0]), 1e-12)
    peak = HIGHEST_RATE - RATE_DIFFERENCE * (threshold - threshold[0]) / span
    full = float(threshold[-1] + (peak[-1] - LOWEST_RATE) / RATE_GAIN)
    fine = action_potentials(draw_geometry(rng, size), PHASES * sampling_rate)
    sos = scipy.signal.butter(2, BAND, "bandpass", fs=PHASES * sampling_rate, output="sos")
    room = round(0.02 * PHASES * sampling_rate) // PHASES * PHASES
    fine = scipy.signal.sosfiltfilt(sos, np.pad(fine, ((0, 0), (room, room))), padlen=0)
    # Sample k of phase p lies at k - p / PHASES: the potential that began p parts later.
    shifted = [np.roll(fine, p, axis=1)[:, ::PHASES] for p in range(PHASES)]
    potential = size[:, None, None] * np.stack(shifted, axis=1)
    pool = MotorUnitPool(threshold, peak, full, potential, sampling_rate, room // PHASES)
    potential /= float(pool.rms(np.ones(1))[0])
    return pool


def discharges(
    rate: np.ndarray, sampling_rate: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Times of discharge of every unit, from its rate.

    Intervals are drawn normal with mean 1 and the stated variation and laid out along the integral
    of the rate, so that the rate may change within an interval.

    Parameters
    ----------
    rate : array, shape (units, times) [1/s]
        Rate of discharge, at `sampling_rate`.
    sampling_rate : float
        Hertz.
    rng : Generator
        Source of intervals.

    Returns
    -------
    unit : array of int
        Which one fires.
    time : array [s]
        When, in order for each unit.
    """
    expected = np.cumsum(rate, axis=1) / sampling_rate
    units: list[np.ndarray] = []
    times: list[np.ndarray] = []
    for unit, total in enumerate(expected):
        count = int(total[-1] * 1.2 + 10)
        interval = np.maximum(rng.normal(1.0, INTERVAL_VARIATION, count), 0.1)
        interval[0] *= rng.uniform()
        at = np.cumsum(interval)
        at = at[at < total[-1]]
        # The sample in which the integral reaches the value, and where in it.
        sample = np.searchsorted(total, at)
        left = (total[sample] - at) / rate[unit, sample]
        times.append((sample + 1) / sampling_rate - left)
        units.append(np.full(at.size, unit))
    return np.concatenate(units), np.concatenate(times)


def pool_signal(
    pool: MotorUnitPool, activation: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Sum of the action potentials of all units of a pool.

    Parameters
    ----------
    pool : MotorUnitPool
        The units.
    activation : array, shape (samples,)
        0 to 1, at the sampling rate of the pool.
    rng : Generator
        Source of the discharges.

    Returns
    -------
    array, shape (samples,)
        Signal; root mean square 1 at steady activation 1.
    """
    activation = np.asarray(activation)
    unit, time = discharges(pool.rates(activation), pool.sampling_rate, rng)
    n, length = activation.size, pool.potential.shape[2]
    place = np.ceil(time * pool.sampling_rate * PHASES).astype(np.int64)
    start, phase = place // PHASES, place % PHASES
    index = start[:, None] + np.arange(length)
    total = np.bincount(index.ravel(), pool.potential[unit, phase].ravel(), minlength=n + pool.lead)
    return total[pool.lead : pool.lead + n]


Pools = Mapping[tuple[str, str], MotorUnitPool]
"""Motor units by channel and muscle, both with side."""
