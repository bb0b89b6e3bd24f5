"""Size of the tests and coverage of the intervals for a number of volunteers, by simulation."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
import xarray as xr
from scipy.stats import t

from analysis.errors import StatisticsError
from analysis.statistics.bootstrap import hierarchical_bootstrap, replicates, tails
from analysis.statistics.equivalence import equivalence
from analysis.statistics.mixed_model import cell_means, fit_differences, mixed_model
from analysis.statistics.paired import compare, fisher_z, paired
from analysis.statistics.ranks import friedman, wilcoxon
from analysis.statistics.sign_flip import sign_flip
from analysis.statistics.simulated import SIMULATED_STRATEGIES, simulated_scores
from analysis.trajectory import names

Outcome = dict[str, tuple[float, float]]
"""Per test: p of a true null hypothesis, and 1 if the interval contains the true value."""

#: contrast whose size and coverage are counted
PAIR: Final = (SIMULATED_STRATEGIES[1], SIMULATED_STRATEGIES[0])


def _sign_flip(cube: xr.Dataset, seed: int) -> Outcome:
    tested = sign_flip(compare(cube))
    return {
        "sign flip": (float(tested["p"][0]), _holds(tested, 0.0)),
        "sign flip, joint": (float(tested["p_joint"].min()), np.nan),
    }


def _wilcoxon(cube: xr.Dataset, seed: int) -> Outcome:
    tested = wilcoxon(compare(cube))
    return {
        "Wilcoxon": (float(tested["p"][0]), _holds(tested, 0.0)),
        "Wilcoxon, Holm": (float(tested["p_holm"].min()), np.nan),
    }


def _friedman(cube: xr.Dataset, seed: int) -> Outcome:
    tested = friedman(compare(cube))
    return {
        "Friedman": (float(tested["p"][0]), np.nan),
        "Friedman, chi-square limit": (float(tested["p_chi2"][0]), np.nan),
    }


def _mixed_model(cube: xr.Dataset, seed: int) -> Outcome:
    fitted = mixed_model(compare(cube, contrasts=[PAIR]), scope="these instructions")
    wald = abs(float(fitted["estimate"][0])) <= 1.959964 * float(fitted["standard_error"][0])
    return {
        "mixed model": (float(fitted["p"][0]), _holds(fitted, 0.0)),
        "mixed model, Wald": (float(fitted["p_wald"][0]), float(wald)),
    }


def _mixed_model_in_general(cube: xr.Dataset, seed: int) -> Outcome:
    data = compare(cube, contrasts=[PAIR])
    general, fixed = mixed_model(data), mixed_model(data, scope="these instructions")
    return {
        "mixed model, instructions": (float(general["p"][0]), _holds(general, 0.0)),
        "mixed model, misread": (float(fixed["p"][0]), _holds(fixed, 0.0)),
    }


def _bootstrap(cube: xr.Dataset, seed: int) -> Outcome:
    draw = partial(hierarchical_bootstrap, draws=500, seed=seed)
    # If instructions differ, the mean of z is still zero, the median of rho only approximately.
    mean = partial(draw, compare(cube, contrasts=[PAIR]), statistic="mean")
    median = draw(compare(cube, contrasts=[PAIR], scale="raw"))
    return {
        "bootstrap, median of rho": (np.nan, _holds(median, 0.0)),
        "bootstrap, expanded": (np.nan, _holds(mean(), 0.0)),
        "bootstrap, percentile": (np.nan, _holds(mean(interval="percentile"), 0.0)),
    }


def _equivalence(cube: xr.Dataset, seed: int) -> Outcome:
    # The test has its largest size if the true difference equals the margin.
    margin = 0.3
    moved = fisher_z(cube["rho"]) + margin * (cube["strategy"] == PAIR[0])
    cube = cube.assign(rho=moved.copy(data=np.tanh(moved.values)).assign_attrs(units="1"))
    tested = equivalence(compare(cube, contrasts=[PAIR]), margin=margin)
    return {"equivalence": (float(tested["p"][0]), _holds(tested, margin))}


METHODS: Final[dict[str, Callable[[xr.Dataset, int], Outcome]]] = {
    "sign_flip": _sign_flip,
    "wilcoxon": _wilcoxon,
    "friedman": _friedman,
    "mixed_model": _mixed_model,
    "mixed_model_in_general": _mixed_model_in_general,
    "bootstrap": _bootstrap,
    "equivalence": _equivalence,
}
IN_GENERAL: Final = ("mixed_model_in_general",)
"""Methods whose null hypothesis concerns instructions in general instead of those drawn."""


def calibration(
    *,
    methods: Sequence[str] = tuple(METHODS),
    alpha: float = 0.05,
    simulations: int = 200,
    seed: int = 0,
    **model: Any,
) -> xr.Dataset:
    """Measure how often each test rejects a true null hypothesis, and the coverage of each interval.

    `methods` are keys of `METHODS`, `alpha` is the nominal size [1] and `simulations` the number of
    cubes; the Monte Carlo error of a size of 0.05 is 0.22 / sqrt(simulations). Cubes are drawn with
    the seeds seed, seed + 1, and so on; `model` contains sizes and terms of `simulated_scores`,
    whose effects are zero.

    The result has the dim test: ``size`` [1], fraction of p <= alpha (over all contrasts for joint
    and Holm, one contrast otherwise); ``coverage`` [1] of the interval, nominal 0.95 (equivalence
    0.90); their Monte Carlo errors ``size_error`` and ``coverage_error``; NaN if a method has no p
    or no interval. The truth is that of the instructions drawn, except for "mixed model,
    instructions" and "mixed model, misread", of instructions in general; the latter is the test of
    these instructions interpreted as one of instructions in general. Raises StatisticsError for an
    unknown method or no simulation.
    """
    wrong = [name for name in methods if name not in METHODS]
    if wrong or simulations < 1:
        raise StatisticsError(
            f"cannot measure {names(wrong) or 'without simulations'}, expected "
            f"{names([*METHODS], 9)}"
        )
    outcomes: list[Outcome] = []
    for index in range(simulations):
        cubes = [simulated_scores(seed + index, these=these, **model) for these in (True, False)]
        outcome: Outcome = {}
        for name in methods:
            outcome |= METHODS[name](cubes[name in IN_GENERAL], seed + index)
        outcomes.append(outcome)
    attrs = {"alpha": alpha, "simulations": simulations, "seed": seed, **model}
    return _shares(outcomes, alpha).assign_attrs(attrs)


def interval_coverage(*, simulations: int = 200, seed: int = 0, **model: Any) -> xr.Dataset:
    """Measure the coverage of every kind of interval, also with fewer volunteers than required.

    The options are those of `calibration`. Dim test: ``coverage`` [1], nominal 0.95, and
    ``coverage_error``, of the difference of two strategies in Fisher's z: "paired t" (that of
    equivalence and sensitivity), "mixed model", "mixed model, instructions" and "bootstrap,
    expanded".
    """
    outcomes: list[Outcome] = []
    for index in range(simulations):
        outcome: Outcome = {}
        for these in (True, False):
            cube = simulated_scores(seed + index, these=these, **model)
            data = paired(cube, *PAIR)
            table = cell_means(data)
            label = "mixed model" if these else "mixed model, instructions"
            scope = "these instructions" if these else "instructions"
            fitted = fit_differences(table, scope, least=(2, 2))
            if not isinstance(fitted, str):
                reach = float(t.ppf(0.975, fitted.freedom)) * fitted.error
                outcome[label] = (np.nan, float(abs(fitted.estimate) <= reach))
            if not these:
                continue
            n, values = len(data.values), data.values
            reach = float(t.ppf(0.975, n - 1)) * float(values.std(ddof=1)) / math.sqrt(n)
            outcome["paired t"] = (np.nan, float(abs(values.mean()) <= reach))
            cells = data.differences.transpose("volunteer", "instruction", "repetition", ...)
            drawn = replicates(cells.values, "mean", 500, seed + index)
            low, high = np.nanquantile(drawn, tails(n, 0.95, "expanded"))
            outcome["bootstrap, expanded"] = (np.nan, float(low <= 0.0 <= high))
        outcomes.append(outcome)
    attrs = {"simulations": simulations, "seed": seed, **model}
    return _shares(outcomes, 0.05).assign_attrs(attrs)


def _shares(outcomes: Sequence[Outcome], alpha: float) -> xr.Dataset:
    """Fractions of cubes with p at most alpha, and with the true value in the interval."""
    labels = list(outcomes[0])
    absent = (np.nan, np.nan)
    both = np.array([[outcome.get(label, absent) for label in labels] for outcome in outcomes])
    result = xr.Dataset(coords={"test": labels})
    for index, name in enumerate(("size", "coverage")):
        known = np.isfinite(both[:, :, index])
        hit = both[:, :, index] <= alpha * (1 + 1e-9) if name == "size" else both[:, :, index] > 0
        count = known.sum(axis=0)
        share = np.where(count > 0, (hit & known).sum(axis=0) / np.maximum(count, 1), np.nan)
        error = np.sqrt(share * (1.0 - share) / np.maximum(count, 1))
        result[name] = ("test", share, {"units": "1"})
        result[f"{name}_error"] = ("test", error, {"units": "1"})
    return result


def _holds(tested: xr.Dataset, truth: float) -> float:
    lower, upper = tested["interval"].values[0]
    return math.nan if math.isnan(lower) else float(lower <= truth <= upper)
