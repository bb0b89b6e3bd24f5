"""Counters of samples among the channels of a recording, and the samples that they show to be lost."""

from typing import Final, NamedTuple

import numpy as np

LEAST: Final = 50  #: samples from which a counter can be recognised
REGULAR: Final = 0.8  #: least part of the steps that are regular ones
LARGEST: Final = 2**53  #: counts above which float64 does not represent every integer


class Counter(NamedTuple):
    """Step of a counter, its modulus (0: it does not return), and the samples lost after each."""

    step: float
    modulus: float
    lost: np.ndarray


def counter_of(values: np.ndarray, least: int = LEAST) -> Counter | None:
    """Return the counter that a channel (samples,) is, or None for another signal.

    A counter increases by the same step from sample to sample, except where it returns to its
    beginning or samples were lost; only integers count, and `least` samples are needed. The samples
    lost after one are the least number: it may be larger by any multiple of the modulus. A counter
    that repeats a value, or returns at irregular places, is no sample counter.
    """
    if values.size < least or not np.isfinite(values).all() or np.abs(values).max() > LARGEST:
        return None
    steps = np.diff(values)
    step = float(np.median(steps))
    regular = np.abs(steps - step) <= 1e-3 * abs(step)
    if step <= 0 or regular.mean() < REGULAR or not _whole(values, step):
        return None
    falls = steps < 0
    modulus = 0.0
    if falls.any() and float(-steps[falls].max()) < 0.5 * float(np.ptp(values)):
        return None  # it returns from the middle of its range
    if falls.any():
        modulus = _modulus(float(values.max() - values.min()) + step, step)
    steps = np.where(falls, steps + modulus, steps)
    lost = np.rint(steps / step).astype(np.int64) - 1
    if (lost < 0).any():
        return None
    return Counter(step, modulus, lost)


def _whole(values: np.ndarray, step: float) -> bool:
    """Return True for counts in whole steps; scaled counts are whole multiples of the step."""
    counts = (values - values[0]) / step
    return bool(np.abs(counts - np.rint(counts)).max() < 1e-3)


def _modulus(held: float, step: float) -> float:
    """Modulus of a counter by its range: the next power of 2 or 10 if it is within a tenth of it."""
    counts = held / step
    known = sorted([2.0**k for k in range(3, 33)] + [10.0**k for k in range(1, 10)])
    near = next((number for number in known if number >= counts - 0.5), counts)
    return step * (near if near <= 1.1 * counts else round(counts))
