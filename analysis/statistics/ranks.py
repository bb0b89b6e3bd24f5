"""Rank tests on the volunteers: Wilcoxon for two strategies, Friedman for all of them."""

import math
from collections import Counter
from itertools import permutations
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import chi2, norm, rankdata

from analysis.statistics.finding import (
    INDEPENDENT,
    Check,
    StatisticalFinding,
    check_level,
    collected,
    judged_tests,
    persons,
    shown_p,
)
from analysis.statistics.paired import Array, Comparison, PairedScores, volunteer_means
from analysis.statistics.sign_flip import TIED

MOST_EXACT_RANKS: Final = 200
"""Largest number of volunteers of the exact distribution of signed ranks; beyond, it is normal."""

MOST_STATES: Final = 20_000
"""Largest number of rank sums of an exact Friedman test; beyond, the chi-square limit is used."""


def wilcoxon(data: Comparison, *, level: float = 0.95) -> xr.Dataset:
    """Wilcoxon signed-rank test of the volunteers' mean differences, exact also with ties.

    Above 200 volunteers, the distribution of the signed ranks is replaced by its normal limit.

    ``estimate`` is the Hodges-Lehmann median of the pairwise averages, ``interval`` its exact
    bounds of the nominal `level`; besides ``statistic`` (sum of the ranks of positive differences),
    ``zeros`` (volunteers without a difference, not ranked) and ``coverage`` (exact level of the
    interval) [1].

    With n volunteers no p lies below 2 / 2^n, which Holm multiplies by the number of contrasts:
    0.094 for six volunteers and three contrasts. Source: Wilcoxon 1945, Biometrics Bulletin 1:80;
    interval: Hollander, Wolfe and Chicken 2014, section 3.3.
    """
    check_level(level)
    symmetric = Check(
        "differences are symmetric about their median",
        "not checked",
        "Required for p and interval; it cannot be verified with few volunteers.",
    )
    return judged_tests(
        data.pairs,
        lambda each: _signed_ranks(each, level, len(data.pairs)),
        lambda _: (INDEPENDENT, symmetric),
        further=("statistic", "zeros", "coverage"),
        method="Wilcoxon signed ranks over volunteers, exact up to 200 of them, Holm over contrasts",
        level=level,
        attrs=data.attrs,
    )


def friedman(data: Comparison) -> xr.Dataset:
    """Friedman test of equal ranks of all strategies, on means of volunteers.

    Only values defined for all strategies are averaged. The result has one contrast, "all
    strategies": ``estimate`` is Kendall's W [1], 0 for no agreement between volunteers and 1 for
    the same order in all; no interval. Besides ``statistic`` (chi-square), ``p_chi2`` (its limit
    for many volunteers) and ``mean_rank`` (strategy), 1 the lowest.

    Exact, by enumeration of all orders within volunteers, while their sums of ranks are few (three
    strategies: up to about 200 volunteers), as stated by ``exact``. Source: Friedman 1937, Journal
    of the American Statistical Association 32:675.
    """
    values = data.values
    complete = values.notnull().all("strategy")
    means = volunteer_means(values.where(complete), "strategy").transpose("volunteer", "strategy")
    table = means.values[np.isfinite(means.values).all(axis=1)]
    kept = int(complete.sum())
    lost = {"pairs": kept, "lost_undefined": complete.size - kept}
    findings = [_friedman(table, lost)] if values.sizes["strategy"] > 1 else []
    method = "Friedman over volunteers (Friedman 1937), on values that all strategies have"
    result = collected(findings, method=method, level=math.nan, attrs=data.attrs | {"units": "1"})
    ranks = table_ranks(table).mean(axis=0) if len(table) else np.full(table.shape[1], np.nan)
    result["mean_rank"] = ("strategy", ranks, {"units": "1"})
    result["strategy"] = values["strategy"].values
    return result


def signed_rank_counts(ranks: Array) -> tuple[NDArray[np.int64], Array]:
    """Return twice each possible sum of positive ranks and its probability under random signs."""
    # Mid-ranks are multiples of one half.
    doubled = np.rint(2.0 * ranks).astype(np.int64)
    chances = np.ones(1)
    for rank in doubled:
        longer = np.zeros(len(chances) + int(rank))
        longer[: len(chances)] += 0.5 * chances
        longer[int(rank) :] += 0.5 * chances
        chances = longer
    return np.arange(len(chances), dtype=np.int64), chances


def tied_levels(values: Array) -> NDArray[np.int64]:
    """Numbers of the different values in ascending order, 0 the lowest; equal but for rounding is equal.

    Means of the same scores in another order or unit would otherwise be ranked by their last bit.
    """
    order = np.argsort(values, kind="stable")
    steps = np.diff(values[order]) > TIED * float(np.abs(values).max(initial=0.0))
    levels = np.zeros(len(values), dtype=np.int64)
    levels[order[1:]] = np.cumsum(steps)
    return levels


def wilcoxon_p(values: Array) -> tuple[float, float]:
    """Return the sum of positive ranks and its exact two-sided p; zeros are not ranked."""
    sizes = tied_levels(np.append(np.abs(values), 0.0))[:-1]  # the level of zero is 0
    moved = values[sizes > 0]
    if not len(moved):
        return 0.0, 1.0
    ranks = np.asarray(rankdata(sizes[sizes > 0]), dtype=np.float64)
    positive = float(ranks[moved > 0].sum())
    if len(moved) > MOST_EXACT_RANKS:
        # Signs are random: the mean of the sum is half of all ranks, its variance a quarter of squares.
        away = abs(positive - float(ranks.sum()) / 2.0) / (0.5 * float(np.sqrt((ranks**2).sum())))
        return positive, 2.0 * float(norm.sf(away))
    sums, chances = signed_rank_counts(ranks)
    observed = round(2.0 * positive)
    tails = float(chances[sums <= observed].sum()), float(chances[sums >= observed].sum())
    return positive, min(1.0, 2.0 * min(tails))


def hodges_lehmann(values: Array, level: float) -> tuple[float, float, float, float]:
    """Return the median of pairwise averages, the bounds of its interval, and the exact level."""
    if len(values) > MOST_EXACT_RANKS:
        return _hodges_lehmann_of_many(np.sort(values), level)
    first, second = np.triu_indices(len(values))
    averages = np.sort((values[first] + values[second]) / 2.0)
    _, chances = signed_rank_counts(np.arange(1.0, len(values) + 1.0))
    below: Array = np.cumsum(chances[::2])
    rank = int(np.searchsorted(below, (1.0 - level) / 2.0 + 1e-12, side="right"))
    middle = float(np.median(averages))
    if rank == 0:
        return middle, -math.inf, math.inf, 1.0
    covered = 1.0 - 2.0 * float(below[rank - 1])
    return middle, float(averages[rank - 1]), float(averages[-rank]), covered


def _hodges_lehmann_of_many(values: Array, level: float) -> tuple[float, float, float, float]:
    """`hodges_lehmann` of sorted values, with the normal limit, without all pairs in memory."""
    n = len(values)
    pairs = n * (n + 1) // 2

    def count(bound: float) -> int:
        """Pairwise averages at or below a bound."""
        partners = np.searchsorted(values, 2.0 * bound - values, side="right")
        return int(np.maximum(partners - np.arange(n, dtype=np.int64), 0).sum())

    def smallest(order: int) -> float:
        """The average of the given order, 1 the smallest, to rounding."""
        low, high = float(values[0]), float(values[-1])
        if count(low) >= order:
            return low
        while low < (middle := low + (high - low) / 2.0) < high:
            low, high = (low, middle) if count(middle) >= order else (middle, high)
        return high

    spread = math.sqrt(n * (n + 1) * (2 * n + 1) / 24.0)
    rank = math.floor(pairs / 2.0 - float(norm.ppf((1.0 + level) / 2.0)) * spread)
    covered = 1.0 - 2.0 * float(norm.sf((pairs / 2.0 - rank) / spread))
    middle = (smallest((pairs + 1) // 2) + smallest(pairs // 2 + 1)) / 2.0
    return middle, smallest(rank), smallest(pairs + 1 - rank), covered


def table_ranks(table: Array) -> Array:
    """Ranks of the strategies in every volunteer, shape (volunteers, strategies), 1 the lowest."""
    rows = [rankdata(tied_levels(row)) for row in table]
    return np.array(rows, dtype=np.float64).reshape(table.shape)


def friedman_p(table: Array) -> tuple[float, float, float, bool]:
    """Friedman's test of a table, shape (volunteers, strategies).

    Returns the chi-square statistic corrected for ties, 0 if all strategies tie in every volunteer;
    p by enumeration if feasible; p by the chi-square limit; and True if the first p is exact.
    """
    n, k = map(int, table.shape)
    ranks = table_ranks(table)
    spread = float(((ranks - (k + 1) / 2.0) ** 2).sum())
    if spread == 0.0:
        return 0.0, 1.0, 1.0, True
    sums: Array = ranks.sum(axis=0)
    statistic = (k - 1) * float(((sums - n * (k + 1) / 2.0) ** 2).sum()) / spread
    p_chi2 = float(chi2.sf(statistic, k - 1))
    # The sum of squares of doubled sums of ranks is an integer and increases with the statistic.
    observed = int((np.rint(2.0 * sums).astype(np.int64) ** 2).sum())
    # Without ties there are about n^(k - 1) / 2 sums or more.
    if k > 5 or n ** (k - 1) > 2 * MOST_STATES:
        return statistic, p_chi2, p_chi2, False
    states: dict[tuple[int, ...], float] = {(0,) * k: 1.0}
    for row in np.rint(2.0 * ranks).astype(np.int64).tolist():
        orders = Counter(permutations(row))
        total = sum(orders.values())
        following: dict[tuple[int, ...], float] = {}
        for state, chance in states.items():
            for order, times in orders.items():
                # The order of the strategies does not matter to the statistic.
                reached = tuple(sorted(a + b for a, b in zip(state, order, strict=True)))
                following[reached] = following.get(reached, 0.0) + chance * times / total
        states = following
        if len(states) > MOST_STATES:
            return statistic, p_chi2, p_chi2, False
    p = sum(chance for state, chance in states.items() if sum(s * s for s in state) >= observed)
    return statistic, min(1.0, float(p)), p_chi2, True


def _signed_ranks(data: PairedScores, level: float, contrasts: int) -> StatisticalFinding:
    values = data.values
    n, zeros = len(values), int((values == 0).sum())
    statistic, p = wilcoxon_p(values)
    estimate, lower, upper, coverage = hodges_lehmann(values, level)
    attained = coverage if math.isfinite(lower) else level  # an unbounded interval has the level 1
    least = min(1.0, 2.0 ** (1 - n))
    reach = min(1.0, least * contrasts)
    sentence = (
        f"median {data.shown(estimate)} over {persons(n)} "
        f"({data.shown_interval(lower, upper, attained)}; Wilcoxon {shown_p(p)}; after Holm over "
        f"{contrasts} contrasts no p below {reach:.2g} is possible)."
    )
    if reach > 1.0 - level:
        sentence += f" This test therefore cannot reach {1.0 - level:.2g}, whatever the data."
    further = {"statistic": statistic, "zeros": float(zeros), "coverage": coverage}
    return StatisticalFinding(estimate, lower, upper, p, least, sentence, further)


def _friedman(table: Array, counts: dict[str, int]) -> StatisticalFinding:
    n, k = table.shape
    gone = counts["lost_undefined"]
    name = "all strategies"
    complete = Check(
        "values are missing at random",
        "doubtful" if gone else "met",
        f"{gone} of {gone + counts['pairs']} values are omitted because they are missing for "
        "a strategy.",
    )
    if n < 2:
        text = f"{name}: {persons(n)} with values of all strategies; there is no ranking."
        further = {"statistic": math.nan, "p_chi2": math.nan, "exact": math.nan}
        return StatisticalFinding(
            sentence=text, further=further, contrast=name, n=n, counts=counts,
            checks=(INDEPENDENT, complete),
        )  # fmt: skip
    statistic, p, p_chi2, exact = friedman_p(table)
    agreement = statistic / (n * (k - 1))
    least = math.factorial(k) ** (1.0 - n)
    sentence = (
        f"{name}: the order agrees among {persons(n)} with Kendall's W = {agreement:.2f} "
        f"(Friedman chi-square {statistic:.2f}, {shown_p(p)} "
        f"{'by enumeration' if exact else 'by the chi-square limit'}). {complete.check}"
    )
    return StatisticalFinding(
        agreement, p=p, smallest_p=least, sentence=sentence,
        further={"statistic": statistic, "p_chi2": p_chi2, "exact": float(exact)},
        contrast=name, n=n, counts=counts, checks=(INDEPENDENT, complete),
    )  # fmt: skip
