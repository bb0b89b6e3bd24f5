"""Single samples of EMG far from both neighbours, as a damaged number or a discharge leaves them."""

from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d

HALF_COMPARED_TIME: Final = 0.05  #: half of the time [s] with which a sample is compared
TOWERS: Final = 8.0
"""Distance of a sample from the mean of its neighbours, over the largest other one within
`HALF_COMPARED_TIME`.

Normally distributed samples that are independent exceed 2 in less than one of a million, and those of
surface EMG less often, since an action potential lasts several samples.
"""
USUAL: Final = 3.0
"""The same distance over the largest but those of `RARE` samples of the whole channel.

Single steps of the resolution in an otherwise constant signal are thereby no spikes.
"""
RARE: Final = 0.002  #: fraction of the samples that may be spikes
#: largest distance of its neighbours over that of a spike, which is 0.5 + noise
NEIGHBOUR_RATIO: Final = 0.75
LEAST_SPIKE_SAMPLES: Final = 100  #: samples from which a channel can be judged


class Spikes(NamedTuple):
    """Indices of the samples, and their distances from the mean of both neighbours [V]."""

    at: np.ndarray
    distance: np.ndarray


def spikes(values: np.ndarray, rate: float) -> Spikes:
    """Find single samples far from their neighbours in a channel (samples,) [V] at `rate` [Hz].

    With d[i] = x[i] - (x[i-1] + x[i+1]) / 2, sample i is a spike if |d[i]| exceeds `TOWERS` times the
    largest |d| within `HALF_COMPARED_TIME` that does not contain x[i] (j < i - 1 or j > i + 1), and
    `USUAL` times the quantile 1 - `RARE` of all |d|. Samples next to a gap (NaN) are not judged,
    and two spikes within `HALF_COMPARED_TIME` hide each other.
    """
    none = Spikes(np.zeros(0, dtype=int), np.zeros(0))
    if values.size < LEAST_SPIKE_SAMPLES:
        return none
    distance = np.zeros(values.size)
    distance[1:-1] = np.abs(values[1:-1] - 0.5 * (values[:-2] + values[2:]))
    distance = np.nan_to_num(distance, nan=0.0, posinf=0.0, neginf=0.0)
    usual = np.quantile(distance, 1.0 - RARE)
    width = max(
        4, 2 * round(0.5 * HALF_COMPARED_TIME * rate)
    )  # even, so that both windows are centred
    # Largest distance in [i - width, i - 2] and in [i + 2, i + width].
    side = maximum_filter1d(distance, width - 1, mode="constant")
    reach = (width - 1) // 2 + 2
    shifted = np.zeros((2, values.size))
    shifted[0, reach:] = side[:-reach]
    shifted[1, :-reach] = side[reach:]
    around = shifted.max(axis=0)
    at = np.flatnonzero((distance > TOWERS * around) & (distance > USUAL * usual))
    # The neighbours of a spike have half its distance; at a step of the baseline, both sides are equal.
    at = at[NEIGHBOUR_RATIO * distance[at] > np.maximum(distance[at - 1], distance[at + 1])]
    return Spikes(at, distance[at]) if at.size else none
