"""Regression of an activation on the delayed sEMG of its muscle: gain, delay and error."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from emgface.inverse.calibration_trial import DELAY, ERROR, GAIN, PRIOR_SAMPLES
from sim.state import Array

DELAYS = np.arange(0.0, 0.1201, 0.005)
"""Delays compared [s]."""
SMALLEST_EMG_ERROR = 0.02
"""Smallest error of the sEMG [1]."""


@dataclass(frozen=True)
class Profile:
    """Regression of an activation on the sEMG of one muscle, for each of `DELAYS`.

    ``cost`` is twice the negative logarithm of the likelihood times the density of the gain;
    ``squares`` is the sum of squared differences in the mean over the posterior.
    """

    cost: Array
    gain: Array
    squares: Array


def profile(
    e: Callable[[float], Array], a: Array, variance: Array, error: float, per: float
) -> Profile:
    """Most probable gain for every delay, given the activation and its posterior variance.

    `e` is the normalised sEMG, with a given delay, at the times of a; `error` is that of the
    previous iteration, and `per` samples count as one, because the error is correlated.
    """
    shifted = np.array([e(d) for d in DELAYS.tolist()])
    hold = per * error**2 / GAIN[1] ** 2
    gain = np.maximum((shifted @ a + hold * GAIN[0]) / ((shifted**2).sum(axis=1) + hold), 0.0)
    squares = ((a - gain[:, None] * shifted) ** 2).sum(axis=1) + variance.sum()
    cost = squares / (per * error**2) + ((gain - GAIN[0]) / GAIN[1]) ** 2
    return Profile(cost, gain, squares)


def common_delay(costs: Sequence[Array]) -> float:
    """Most probable delay of a person [s], from the costs of all muscles with electrodes."""
    total = ((DELAYS - DELAY[0]) / DELAY[1]) ** 2 + sum(costs, 0.0 * DELAYS)
    return float(DELAYS[int(np.argmin(total))])


def regressed(
    one: Profile, about: tuple[float, float], n: int, per: float
) -> tuple[float, float, float]:
    """Gain, delay [s] and error of one muscle, from `n` samples.

    They maximise the likelihood times the density of the delay, normal with mean and standard deviation
    `about`; the error has `PRIOR_SAMPLES` samples of `ERROR` more.
    """
    k = int(np.argmin(one.cost + ((DELAYS - about[0]) / about[1]) ** 2))
    counted = (one.squares[k] / per + PRIOR_SAMPLES * ERROR**2) / (n / per + PRIOR_SAMPLES)
    return float(one.gain[k]), float(DELAYS[k]), max(float(np.sqrt(counted)), SMALLEST_EMG_ERROR)
