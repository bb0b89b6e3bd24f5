"""Motor units under the electrodes: recruitment, firing rates and recorded signals."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.signal

from emgface.volunteers.action_potentials import action_potentials, draw_geometry
from emgface.volunteers.noise import RECORDING_BAND

UNITS_PER_ELECTRODE: Final = 100  #: motor units within reach of one electrode pair
RECRUITMENT_RANGE: Final = 30.0  #: ratio of the largest to the smallest recruitment threshold
SIZE_RANGE: Final = 10.0
"""Ratio of the largest to the smallest action potential, small for facial muscles."""
LOWEST_RATE: Final = 8.0  #: firing rate at recruitment [1/s]
HIGHEST_RATE: Final = 40.0  #: largest firing rate of the first unit [1/s]
RATE_DIFFERENCE: Final = 10.0
"""Decrease of the largest firing rate from the first to the last unit [1/s]."""
RATE_GAIN: Final = 1.0  #: increase of the firing rate per unit of excitation [1/s]
INTERVAL_VARIATION: Final = 0.2  #: coefficient of variation of the intervals between discharges
#: number of positions between two samples at which a potential may begin
POTENTIAL_PHASES: Final = 4


@dataclass(frozen=True)
class MotorUnitPool:
    """Motor units of one muscle within reach of one electrode pair."""

    #: (units,) excitation at which a unit begins to fire, about 1 for the first
    threshold: np.ndarray
    peak_rate: np.ndarray  #: (units,) highest firing rate [1/s]
    full: float  #: excitation at activation 1, where the last unit reaches its highest rate
    #: (units, PHASES, samples) action potential of each unit, delayed by a fraction of a sample
    #: from phase to phase; scaled to a root mean square of the signal of 1 at activation 1
    potential: np.ndarray
    sampling_rate: float  #: sampling rate of the potentials [Hz]
    lead: int  #: samples of each potential before the discharge, required by the filter

    def rates(self, activation: np.ndarray) -> np.ndarray:
        """Firing rate (units, times) [1/s] of every unit at activations (times,) of 0 to 1.

        It is 0 below the threshold, then ``LOWEST_RATE + RATE_GAIN (E - threshold)`` up to the
        highest rate (Fuglevand et al. 1993, Eqs 1-5).
        """
        excitation = self.full * np.asarray(activation)
        by_unit = np.zeros((self.threshold.size, excitation.size))
        fires = self.threshold <= excitation.max(initial=-np.inf)  # often a small part
        above = excitation - self.threshold[fires, None]
        rate = np.minimum(LOWEST_RATE + RATE_GAIN * above, self.peak_rate[fires, None])
        by_unit[fires] = np.where(above >= 0.0, rate, 0.0)
        return by_unit

    def rms(self, activation: np.ndarray) -> np.ndarray:
        """Root mean square of the signal at constant activations (times,), 1 at activation 1.

        By Campbell's theorem the variance for independent Poisson trains is the sum over units of
        rate times the integral of the squared potential. It approximates that of more regular
        trains if the potentials are shorter than the intervals and have zero mean.
        """
        energy = np.square(self.potential[:, 0]).sum(axis=1) / self.sampling_rate
        return np.sqrt(energy @ self.rates(activation))


def draw_pool(rng: np.random.Generator, sampling_rate: float) -> MotorUnitPool:
    """Draw the motor units of one muscle under one electrode pair.

    Thresholds ``exp(ln(RR) i / n)`` and sizes ``exp(ln(RP) i / n)`` increase exponentially (the
    size principle): Fuglevand, Winter and Patla 1993, J Neurophysiol 70:2470-2488, Eqs 1 and 7; the
    highest rates decrease with the threshold, Eqs 4-5. Facial units fire faster than those of
    limbs: discharges of the corrugator cause a peak of its spectrum near 31 Hz (van Boxtel 2001,
    Psychophysiology 38:22-34), hence a highest rate of 40 instead of 35 per second.
    """
    number = np.arange(1, UNITS_PER_ELECTRODE + 1)
    threshold = np.exp(np.log(RECRUITMENT_RANGE) * number / UNITS_PER_ELECTRODE)
    size = np.exp(np.log(SIZE_RANGE) * number / UNITS_PER_ELECTRODE)
    span = max(float(threshold[-1] - threshold[0]), 1e-12)
    peak = HIGHEST_RATE - RATE_DIFFERENCE * (threshold - threshold[0]) / span
    full = float(threshold[-1] + (peak[-1] - LOWEST_RATE) / RATE_GAIN)
    fine = action_potentials(draw_geometry(rng, size), POTENTIAL_PHASES * sampling_rate)
    sos = scipy.signal.butter(
        2, RECORDING_BAND, "bandpass", fs=POTENTIAL_PHASES * sampling_rate, output="sos"
    )
    room = round(0.02 * POTENTIAL_PHASES * sampling_rate) // POTENTIAL_PHASES * POTENTIAL_PHASES
    fine = scipy.signal.sosfiltfilt(sos, np.pad(fine, ((0, 0), (room, room))), padlen=0)
    # Sample k of phase p is at the time k - p / PHASES.
    shifted = [np.roll(fine, p, axis=1)[:, ::POTENTIAL_PHASES] for p in range(POTENTIAL_PHASES)]
    potential = size[:, None, None] * np.stack(shifted, axis=1)
    pool = MotorUnitPool(threshold, peak, full, potential, sampling_rate, room // POTENTIAL_PHASES)
    potential /= float(pool.rms(np.ones(1))[0])
    return pool


def discharges(
    rate: np.ndarray, sampling_rate: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Unit (index) and time [s] of every discharge, from the firing rates (units, times) [1/s].

    Intervals are normally distributed with mean 1 in units of the integral of the rate, so that the
    rate may change within an interval. Times are in ascending order for each unit.
    """
    units, times = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    fires: np.ndarray = np.any(rate, axis=1)
    totals = iter(np.cumsum(rate[fires], axis=1) / sampling_rate)
    for unit in range(len(rate)):
        if not fires[unit]:
            # Silent units draw also, so that the others do not depend on them.
            rng.standard_normal(10)
            rng.uniform()
            continue
        total = next(totals)
        interval = np.maximum(rng.normal(1.0, INTERVAL_VARIATION, int(total[-1] * 1.2 + 10)), 0.1)
        interval[0] *= rng.uniform()
        at = np.cumsum(interval)
        at = at[at < total[-1]]
        # The sample in which the integral reaches the value, and the fraction of that sample.
        sample = np.searchsorted(total, at)
        left = (total[sample] - at) / rate[unit, sample]
        times.append((sample + 1) / sampling_rate - left)
        units.append(np.full(at.size, unit))
    return np.concatenate(units), np.concatenate(times)


def pool_signal(
    pool: MotorUnitPool, activation: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Sum (samples,) of the action potentials of all units, RMS 1 at constant activation 1.

    `activation` (samples,) is sampled at the rate of the pool.
    """
    activation = np.asarray(activation)
    unit, time = discharges(pool.rates(activation), pool.sampling_rate, rng)
    n, length = activation.size, pool.potential.shape[2]
    place = np.ceil(time * pool.sampling_rate * POTENTIAL_PHASES).astype(np.int64)
    start, phase = place // POTENTIAL_PHASES, place % POTENTIAL_PHASES
    index = start[:, None] + np.arange(length)
    total = np.bincount(index.ravel(), pool.potential[unit, phase].ravel(), minlength=n + pool.lead)
    return total[pool.lead : pool.lead + n]


Pools = Mapping[tuple[str, str], MotorUnitPool]
"""Motor units by channel and muscle, both with side."""
