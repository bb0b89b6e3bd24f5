"""Counters of samples among the channels of a recording, and the samples that they show to be lost."""

from typing import Final, NamedTuple

import numpy as np

LEAST_COUNTER_SAMPLES: Final = 50  #: samples from which a counter can be recognised
REGULAR: Final = 0.8  #: least part of the steps that are regular ones
RETURN: Final = 0.9  #: part of its range by which a counter falls when it returns to its beginning
#: part of the modulus from which a step ahead is rather a small step back
WRAPPED_SHARE: Final = 0.75
LARGEST_EXACT_COUNT: Final = 2**53  #: counts above which float64 does not represent every integer
MOST_ABSENT_COUNTS: Final = 0.2  #: largest part of the counts that may be absent
WHOLE_PACKETS: Final = 0.9  #: least part of the packets that have the usual number of samples


class Counter(NamedTuple):
    """Step of a counter, its modulus (0: it does not return), and the samples lost after each.

    `irregular` lists the samples after which it neither continues nor returns to its beginning; the
    samples lost are not known then, and `lost` is 0.
    """

    step: float
    modulus: float
    lost: np.ndarray
    irregular: np.ndarray


def counter_of(
    values: np.ndarray, least: int = LEAST_COUNTER_SAMPLES, *, returns: bool = True
) -> Counter | None:
    """Return the counter that a channel (samples,) is, or None for another signal.

    A counter changes by the same step from sample to sample, or from packet to packet of several
    samples with one count, except where it returns to its beginning (if it `returns`) or samples were
    lost; only integers count, and `least` samples are needed. The samples lost after one are the least
    number: it may be larger by any multiple of the modulus. A loss may contain the return, after
    which the counter falls from the middle of its range. A small step back, a repeated count, and a
    counter that begins again once are irregular: samples were repeated, stored in another order, or
    are those of two recordings.
    """
    finite = np.isfinite(values)
    if values.size < least or finite.mean() < 1.0 - MOST_ABSENT_COUNTS or not finite[0]:
        return None
    known = values[finite]
    if np.abs(known).max() > LARGEST_EXACT_COUNT or known.min() == known.max():
        return None
    if float(np.median(np.diff(known))) < 0:  # it counts down
        values, known = -values, -known
    if not finite.all():
        values = _completed(values, finite)
    ends = np.append(np.flatnonzero(np.diff(values) != 0), values.size - 1)
    sizes = np.diff(ends, prepend=-1)
    size = int(np.median(sizes))
    if size < 2:
        return _counter(values, returns)
    if ends.size * size < least or (sizes[1:-1] == size).sum() <= WHOLE_PACKETS * (ends.size - 2):
        return None
    packets = _counter(values[ends], returns)
    if packets is None:
        return None
    lost = np.zeros(values.size - 1, dtype=np.int64)
    lost[ends[:-1]] = size * packets.lost
    return Counter(packets.step / size, packets.modulus, lost, ends[packets.irregular])


def _counter(values: np.ndarray, returns: bool) -> Counter | None:
    """Counter that finite values are whose usual step is one count, None for another signal."""
    values = _without_damage(values)
    steps = np.diff(values)
    step = float(np.median(steps))
    regular = np.abs(steps - step) <= 1e-3 * abs(step)
    if step <= 0 or regular.mean() < REGULAR or not _whole(values, step):
        return None
    span = float(np.ptp(values))
    falls = steps < 0
    turns = -steps > RETURN * span
    modulus, known = _modulus(span + step, step)
    if not returns or 2 * turns.sum() <= falls.sum() or (turns.sum() < 2 and not known):
        modulus = 0.0
    ahead = np.mod(steps, modulus) if modulus else steps
    irregular = np.flatnonzero(
        (ahead < 0.5 * step) | ((ahead > WRAPPED_SHARE * modulus) & (modulus > 0.0))
    )
    lost = np.rint(ahead / step).astype(np.int64) - 1
    return Counter(step, modulus, np.zeros_like(lost) if irregular.size else lost, irregular)


def _completed(values: np.ndarray, finite: np.ndarray) -> np.ndarray:
    """Counts with absent ones replaced by the count that follows the one before."""
    known = values[finite]
    step, first, last = float(np.median(np.diff(known))), known.min(), known.max()
    result = values.copy()
    for k in np.flatnonzero(~finite):
        following = result[k - 1] + step
        result[k] = following if following <= last else first
    return result


def _without_damage(values: np.ndarray) -> np.ndarray:
    """Counts with single wrong ones replaced, between neighbours that are two steps apart."""
    steps = np.diff(values)
    step = float(np.median(steps))
    away = np.abs(steps[:-1] - step) > 1e-3 * abs(step)
    wrong = np.flatnonzero(away & (np.abs(steps[:-1] + steps[1:] - 2 * step) <= 1e-3 * abs(step)))
    result = values.copy()
    result[wrong + 1] = values[wrong] + step
    return result


def _whole(values: np.ndarray, step: float) -> bool:
    """Return True for counts in whole steps; scaled counts are whole multiples of the step."""
    counts = (values - values[0]) / step
    return bool(np.abs(counts - np.rint(counts)).max() < 1e-3)


def _modulus(span: float, step: float) -> tuple[float, bool]:
    """Modulus of a counter by its range: the next power of 2 or 10 if it is within a tenth of it.

    The second value is False if there is no such power, and the modulus is the range itself.
    """
    counts = span / step
    powers = sorted([2.0**k for k in range(3, 33)] + [10.0**k for k in range(1, 10)])
    near = next((number for number in powers if number >= counts - 0.5), np.inf)
    known = near <= 1.1 * counts
    return step * (near if known else round(counts)), known
