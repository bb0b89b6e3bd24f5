"""Blocks of samples that a recording contains twice, bit for bit, in all channels or markers."""

from typing import Final, NamedTuple

import numpy as np

SHORTEST_BLOCK: Final = 0.1  #: duration of a block [s] that is not stored twice by chance
LEAST_CHANGES: Final = 50  #: least number of samples of a block that differ from the one before
BEYOND_CHANCE: Final = 4.0
"""Changes of a block over those of the longest agreement at other lags, from which it is no chance.

The longest agreement over all pairs of samples is about twice that over the pairs of one lag.
"""
SOME_LAGS: Final = 64  #: lags from which agreement by chance is estimated
PERIODIC_SHARE: Final = 0.5  #: share of repeated samples above which a signal may be periodic
LONGEST_PERIOD: Final = 0.5  #: longest period [s] of a signal that is no block stored twice


class StoredTwice(NamedTuple):
    """Samples that are stored twice: index of the second time, its number, and that of the first."""

    start: int
    samples: int
    first: int


def blocks_stored_twice(values: np.ndarray, rate: float) -> list[StoredTwice]:
    """Return the blocks of a recording (signals, samples) at a rate [Hz] that occur twice.

    All signals of a block are equal bit for bit. Samples that equal the one before, such as those of
    constant signals and gaps, do not count: a block has at least `LEAST_CHANGES` others, and
    `BEYOND_CHANCE` times as many as agree at other lags, which signals of few levels do by chance. A
    signal that repeats itself throughout within `LONGEST_PERIOD` is periodic, as that of a generator.
    """
    codes, changes = _codes(values)
    size = max(round(SHORTEST_BLOCK * rate), 8)
    if codes.size < 2 * size or changes.sum() < 2 * LEAST_CHANGES:
        return []
    lags = _lags(codes, size)
    if not lags:
        return []
    counted = np.concatenate(([0], np.cumsum(changes)))
    runs = {lag: _runs(codes[lag:] == codes[:-lag]) for lag in lags}
    weights = {
        lag: [float(counted[stop + lag] - counted[start + lag]) for start, stop in of_lag]
        for lag, of_lag in runs.items()
    }
    least = max(LEAST_CHANGES, BEYOND_CHANCE * _by_chance(codes, counted, lags))
    blocks: list[StoredTwice] = []
    repeated = np.zeros(codes.size, dtype=bool)
    for lag in lags:
        for (start, stop), weight in zip(runs[lag], weights[lag], strict=True):
            own = slice(start + lag, stop + lag)
            if stop - start < size or weight < least or repeated[own].all():
                continue
            repeated[own] = True
            blocks.append(StoredTwice(start + lag, stop - start, start))
    shortest = min((block.start - block.first for block in blocks), default=0)
    if repeated.mean() > PERIODIC_SHARE and shortest < LONGEST_PERIOD * rate:
        return []
    return sorted(blocks)


def _codes(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Hash of each sample, equal for equal ones, and the samples that differ from the one before."""
    codes = np.zeros(values.shape[1], dtype=np.uint64)
    for row in values:
        numbers = np.where(np.isnan(row), np.nan, row + 0.0)  # one NaN, one zero
        codes = _mixed(codes ^ numbers.astype(np.float64).view(np.uint64))
    return codes, np.concatenate(([False], codes[1:] != codes[:-1]))


def _mixed(numbers: np.ndarray) -> np.ndarray:
    """Hash of 64-bit numbers (splitmix64, Steele et al. 2014, doi:10.1145/2660193.2660195)."""
    mixed = numbers + np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return mixed ^ (mixed >> np.uint64(31))


def _lags(codes: np.ndarray, size: int) -> list[int]:
    """Lags at which `size` successive samples occur again, the most frequent ones first."""
    # Sums of hashes over a window, which the comparison of its samples confirms.
    total = np.concatenate((np.zeros(1, np.uint64), np.cumsum(_mixed(codes))))
    windows = total[size:] - total[:-size]
    order = np.argsort(windows, kind="stable")
    same = windows[order[1:]] == windows[order[:-1]]
    lags, counts = np.unique((order[1:] - order[:-1])[same], return_counts=True)
    return lags[np.argsort(-counts, kind="stable")][:SOME_LAGS].tolist()


def _by_chance(codes: np.ndarray, counted: np.ndarray, lags: list[int]) -> float:
    """Most changes within samples that agree at lags at which no block was found."""
    others = np.unique(np.linspace(1, codes.size - 1, SOME_LAGS + 2).astype(int)[1:-1])
    most = [0.0]
    for lag in (int(one) for one in others if one not in lags):
        agreeing = _runs(codes[lag:] == codes[:-lag])
        most += [float(counted[stop + lag] - counted[start + lag]) for start, stop in agreeing]
    return max(most)


def _runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Begins and ends of the runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
