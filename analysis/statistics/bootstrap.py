"""Hierarchical bootstrap: volunteers are drawn first, then their repetitions."""

import math
from typing import Final, Literal

import numpy as np
import xarray as xr
from scipy.stats import norm, t

from analysis.arguments import count, generator
from analysis.errors import StatisticsError
from analysis.statistics.finding import (
    Check,
    StatisticalFinding,
    check_level,
    judged_tests,
    persons,
    untestable,
    without_spread,
)
from analysis.statistics.paired import Array, Comparison, PairedScores
from analysis.typed import selected

Statistic = Literal["median", "mean"]
Interval = Literal["expanded", "percentile"]

FEW_VOLUNTEERS: Final = 10  #: number of volunteers below which bootstrap intervals are too short


def hierarchical_bootstrap(
    data: Comparison,
    *,
    statistic: Statistic = "median",
    interval: Interval = "expanded",
    level: float = 0.95,
    draws: int = 2000,
    seed: int = 0,
) -> xr.Dataset:
    """Paired difference of two strategies with a bootstrap interval.

    In each sample, volunteers are drawn with replacement and, for each of their instructions,
    repetitions with replacement. The `statistic` is that of all paired differences (volunteer,
    instruction, repetition, marker); data with scale "raw" give an effect in units of rho. The
    interval ``"expanded"`` widens the quantiles by the t distribution of n - 1 degrees of freedom;
    the plain ``"percentile"`` interval is too short for few volunteers. At least 100 samples are
    drawn. The result has no p; besides ``standard_error``.

    Source: Davison and Hinkley 1997, Bootstrap Methods and their Application, section 3.8;
    expansion: Hesterberg 2015, The American Statistician 69:371, section 3.
    """
    check_level(level)
    if statistic not in ("median", "mean") or interval not in ("expanded", "percentile"):
        raise StatisticsError(
            f"statistic and interval are {statistic!r} and {interval!r}, expected 'median' or "
            "'mean', and 'expanded' or 'percentile'"
        )
    if count("the number of bootstrap samples", draws, least=1) < 100:
        raise StatisticsError(f"{draws} bootstrap samples give no interval, expected 100 or more")
    return judged_tests(
        data.pairs,
        lambda each: _finding(each, statistic, interval, level, draws, seed),
        lambda each: _checks(len(each.values)),
        further=("standard_error",),
        method=f"hierarchical bootstrap (volunteers, repetitions), {interval} percentile interval",
        level=level,
        attrs=data.attrs | {"statistic": statistic, "draws": draws, "seed": seed},
    )


def replicates(differences: Array, statistic: Statistic, draws: int, seed: int) -> Array:
    """Draw bootstrap replicates of a statistic, shape (draws,); NaN for a draw without any pair.

    `differences` has the shape (volunteers, instructions, repetitions, rest), NaN where there is no
    pair.
    """
    rng = generator(seed)
    volunteers, instructions, repetitions, _ = differences.shape
    every = np.arange(instructions, dtype=np.int64)[None, :, None]
    values = np.full(draws, np.nan)
    for draw in range(draws):
        who = rng.integers(0, volunteers, size=(volunteers, 1, 1))
        which = rng.integers(0, repetitions, size=(volunteers, instructions, repetitions))
        sample = differences[who, every, which].ravel()
        sample = sample[np.isfinite(sample)]
        if len(sample):
            values[draw] = np.median(sample) if statistic == "median" else np.mean(sample)
    return values


def tails(n: int, level: float, interval: Interval) -> tuple[float, float]:
    """Return the quantiles that bound an interval from n volunteers."""
    if interval == "percentile":
        return (1.0 - level) / 2.0, (1.0 + level) / 2.0
    wide = float(t.ppf((1.0 + level) / 2.0, n - 1)) * math.sqrt(n / (n - 1.0))
    return float(norm.cdf(-wide)), float(norm.cdf(wide))


def _checks(n: int) -> tuple[Check, ...]:
    few = Check(
        "the volunteers represent the population",
        "doubtful" if n < FEW_VOLUNTEERS else "met",
        f"{persons(n)} are resampled; with fewer than {FEW_VOLUNTEERS}, the coverage is below nominal, "
        "particularly that of the percentile interval.",
    )
    nested = Check(
        "repetitions of a trial are exchangeable",
        "not checked",
        "With fatigue or practice, later repetitions would differ from earlier ones.",
    )
    return few, nested


def _finding(
    data: PairedScores,
    statistic: Statistic,
    interval: Interval,
    level: float,
    draws: int,
    seed: int,
) -> StatisticalFinding:
    n = len(data.values)
    kept = selected(data.differences, {"volunteer": data.volunteers})
    cells = kept.transpose("volunteer", "instruction", "repetition", ...).values
    pairs = cells[np.isfinite(cells)]
    estimate = float(np.median(pairs) if statistic == "median" else np.mean(pairs))
    drawn = replicates(cells, statistic, draws, seed)
    drawn = drawn[np.isfinite(drawn)]
    if without_spread(drawn) and estimate != 0.0:
        return untestable(data)
    lower, upper = (float(np.quantile(drawn, tail)) for tail in tails(n, level, interval))
    sentence = (
        f"{statistic} difference {data.shown(estimate)} over {len(pairs)} pairs of "
        f"{persons(n)} (bootstrap {data.shown_interval(lower, upper, level)})."
    )
    further = {"standard_error": float(np.std(drawn, ddof=1))}
    return StatisticalFinding(estimate, lower, upper, sentence=sentence, further=further)
