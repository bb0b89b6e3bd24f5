"""Exact sign-flip permutation test over volunteers."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.arguments import generator
from analysis.statistics.finding import (
    INDEPENDENT,
    Check,
    StatisticalFinding,
    check_level,
    judged_tests,
    persons,
    shown_p,
)
from analysis.statistics.paired import Array, Comparison, PairedScores

#: largest number of volunteers for which all sign patterns are enumerated
MOST_EXACT_SIGNS: Final = 16

PATTERNS_AT_ONCE: Final = 1000  #: patterns drawn and multiplied at once, which bounds the memory

Signs = NDArray[np.int8]

TIED: Final = 1e-10
"""Relative difference below which two sums of the same numbers differ only by rounding."""


def sign_flip(
    data: Comparison, *, level: float = 0.95, draws: int = 19_999, seed: int = 0
) -> xr.Dataset:
    """Test by flipping the signs of the volunteers' mean differences.

    Under the null hypothesis, each volunteer's difference has either sign with equal probability. p
    is the fraction of all 2^n sign patterns whose mean is at least as far from zero as the observed
    one; the interval contains the shifts that the test does not reject, and is infinite if n is too
    small for the nominal `level`. For more than 16 volunteers, `draws` random patterns with `seed`
    are used in addition to the observed one. The result is that of `collected`; besides
    ``p_joint``, adjusted over the contrasts by flipping all of a volunteer's differences together
    (single step, largest statistic), ``coverage`` [1], the exact level, and ``standard_deviation``
    between volunteers.

    Exact for n <= 16. With n volunteers no two-sided p lies below 2 / 2^n: 0.031 for six. Source:
    Fisher 1935, The Design of Experiments, section 21; interval: Hartigan 1969, Journal of the
    American Statistical Association 64:1303; joint adjustment: Westfall and Young 1993.
    """
    check_level(level)
    every = joint_p([each.means.values for each in data.pairs], draws, seed)
    joint = {each.label: float(p) for each, p in zip(data.pairs, every, strict=True)}
    symmetric = Check(
        "differences are symmetric about their centre",
        "by design",
        "Follows for one contrast if strategies are exchangeable under the null hypothesis. "
        "The interval and the joint p require it in addition; it cannot be verified with "
        "few volunteers.",
    )
    return judged_tests(
        data.pairs,
        lambda each: _finding(each, joint[each.label], level, draws, seed),
        lambda _: (INDEPENDENT, symmetric),
        further=("p_joint", "coverage", "standard_deviation"),
        method="sign-flip permutation over volunteers (Fisher 1935)",
        level=level,
        attrs={**data.attrs, "seed": seed},
    )


def sign_patterns(n: int, draws: int = 19_999, seed: int = 0) -> Signs:
    """Return sign patterns of n numbers, the observed one (all +1) first.

    For n <= 16 all patterns up to a common sign, 2^(n-1); otherwise random ones.
    """
    if n <= MOST_EXACT_SIGNS:
        # The first sign is fixed, because a pattern and its negative have the same absolute mean.
        pattern = np.arange(2 ** (n - 1), dtype=np.int64)[:, None]
        flipped = (pattern >> np.arange(n - 1, dtype=np.int64)) & 1
        few: Signs = np.ones((len(pattern), n), dtype=np.int8)
        few[:, 1:] -= 2 * flipped.astype(np.int8)
        return few
    signs: Signs = np.ones((draws + 1, n), dtype=np.int8)
    rng = generator(seed)
    for start in range(1, draws + 1, PATTERNS_AT_ONCE):
        rows = signs[start : start + PATTERNS_AT_ONCE]
        rows -= 2 * rng.integers(0, 2, size=rows.shape).astype(np.int8)
    return signs


def signed_sums(values: Array, patterns: Signs) -> Array:
    """Sums of `values`, shape (k, n), with the signs of the patterns, shape (k, m)."""
    sums = np.empty((len(values), len(patterns)))
    for start in range(0, len(patterns), PATTERNS_AT_ONCE):
        rows = slice(start, start + PATTERNS_AT_ONCE)
        sums[:, rows] = values @ patterns[rows].astype(np.float64).T
    return sums


def sign_flip_p(values: Array, patterns: Signs) -> float:
    """Two-sided p of the mean of `values`, shape (n,), over sign patterns, shape (m, n)."""
    size: Array = np.abs(signed_sums(values[None], patterns)[0])
    scale = float(np.abs(values).sum())
    return float(np.mean(size >= float(size[0]) - TIED * scale))


def sign_flip_interval(values: Array, patterns: Signs, level: float) -> tuple[float, float, float]:
    """Return the shifts that the test does not reject, lower and upper, and its exact level.

    A pattern that keeps the set K and flips the set F counts against a shift theta if theta lies
    between the means of K and F, so that the bounds are order statistics of those means.
    """
    total, n = float(values.sum()), len(values)
    count = (n + patterns.sum(axis=1, dtype=np.int64)) // 2
    # A pattern that flips all or none counts against every shift, like the observed one.
    proper = (count > 0) & (count < n)
    always = len(patterns) - int(proper.sum())
    sums, count = signed_sums(values[None], patterns)[0][proper], count[proper]
    of_kept, of_flipped = (total + sums) / (2 * count), (total - sums) / (2 * (n - count))
    rejecting = math.floor((1.0 - level) * len(patterns) + 1e-9)
    rank = rejecting - always + 1
    if rank < 1:
        return -math.inf, math.inf, 1.0
    low = float(np.sort(np.minimum(of_kept, of_flipped))[rank - 1])
    high = float(-np.sort(-np.maximum(of_kept, of_flipped))[rank - 1])
    return low, high, 1.0 - (rank + always - 1) / len(patterns)


def _finding(
    data: PairedScores, joint: float, level: float, draws: int, seed: int
) -> StatisticalFinding:
    """Test one contrast; `joint` is its p over all contrasts."""
    values = data.values
    n, estimate = len(values), float(values.mean())
    patterns = sign_patterns(n, draws, seed)
    p, least = sign_flip_p(values, patterns), max(2.0 ** (1 - n), 1.0 / len(patterns))
    lower, upper, coverage = sign_flip_interval(values, patterns, level)
    attained = coverage if math.isfinite(lower) else level  # an unbounded interval has the level 1
    exact = "all" if n <= MOST_EXACT_SIGNS else f"{draws} random"
    sentence = (
        f"{data.shown(estimate)} over {persons(n)} "
        f"({data.shown_interval(lower, upper, attained)}; {shown_p(p)}, {exact} sign flips, smallest "
        f"p possible {least:.2g}; {shown_p(joint)} over all contrasts jointly)."
    )
    if not values.any():
        sentence = f"no difference in any of {persons(n)}."
    further = {
        "p_joint": joint, "coverage": coverage, "standard_deviation": float(values.std(ddof=1)),
    }  # fmt: skip
    return StatisticalFinding(estimate, lower, upper, p, least, sentence, further)


def joint_p(means: Sequence[Array], draws: int, seed: int) -> Array:
    """Adjust over contrasts: p of the largest |sum| over root sum of squares, flipped together."""
    if not means:
        return np.zeros(0)
    table = np.nan_to_num(np.array(means))
    table = table[:, np.isfinite(np.array(means)).any(axis=0)]
    norm = np.sqrt((table**2).sum(axis=1, keepdims=True))
    table = np.divide(table, norm, out=np.zeros_like(table), where=norm > 0)
    if table.shape[1] < 2:
        return np.full(len(means), np.nan)
    size = np.abs(signed_sums(table, sign_patterns(table.shape[1], draws, seed)))
    largest = size.max(axis=0)
    return np.mean(largest >= size[:, :1] - TIED, axis=1)
