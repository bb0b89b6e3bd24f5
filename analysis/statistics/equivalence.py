"""Equivalence of two strategies by two one-sided tests."""

import math

import xarray as xr
from scipy.stats import shapiro, t

from analysis.errors import StatisticsError
from analysis.statistics.finding import (
    INDEPENDENT,
    Check,
    StatisticalFinding,
    check_level,
    judged_tests,
    persons,
    shown_p,
    untestable,
    without_spread,
)
from analysis.statistics.paired import Array, Comparison, PairedScores
from analysis.statistics.scope import LEAST_VOLUNTEERS


def equivalence(data: Comparison, *, margin: float, alpha: float = 0.05) -> xr.Dataset:
    """Test if two strategies differ by less than a margin.

    Two one-sided paired t tests on the volunteers' mean differences: that the difference lies above
    -margin, and that it lies below +margin. p is the larger of both; a small p indicates
    equivalence, and one that is not small shows neither equivalence nor a difference. Besides
    ``p_above`` (of -margin) and ``p_below`` (of +margin).

    `margin` is the largest difference without importance, on the scale of the analysis (Fisher's z
    for rho, else the unit of the variable). It has no default, because it must be chosen before the
    data are seen. `alpha` is the size of each one-sided test [1], below 0.5; the interval has the
    level 1 - 2 alpha. Source: Schuirmann 1987, Journal of Pharmacokinetics and Biopharmaceutics
    15:657.
    """
    if not (math.isfinite(margin) and margin > 0):
        raise StatisticsError(f"the margin of equivalence is {margin}, expected above 0")
    if not 0 < alpha < 0.5:
        raise StatisticsError(f"alpha is {alpha}, expected between 0 and 0.5")
    check_level(1.0 - 2.0 * alpha)
    return judged_tests(
        data.pairs,
        lambda each: _finding(each, margin, alpha),
        lambda each: (INDEPENDENT, normality(each.values)),
        further=("p_above", "p_below"),
        method="two one-sided paired t tests over volunteers (Schuirmann 1987)",
        level=1.0 - 2.0 * alpha,
        attrs=data.attrs | {"margin": margin, "alpha": alpha},
        least=LEAST_VOLUNTEERS,
    )


def normality(values: Array) -> Check:
    """Test the normality of the differences of volunteers (Shapiro and Wilk)."""
    name = "mean differences are normal"
    if len(values) < 3 or without_spread(values):
        return Check(name, "not checked", "There are too few different values for a check.")
    p = float(shapiro(values).pvalue)
    text = f"Shapiro-Wilk {shown_p(p)} over {persons(len(values))}"
    text += ", which would detect only gross departures." if len(values) < 20 else "."
    return Check(name, "doubtful" if p < 0.05 else "met", text)


def _finding(data: PairedScores, margin: float, alpha: float) -> StatisticalFinding:
    values = data.values
    n, estimate = len(values), float(values.mean())
    error = float(values.std(ddof=1)) / math.sqrt(n)
    if without_spread(values, margin):
        return untestable(data)
    above = float(t.sf((estimate + margin) / error, n - 1))
    below = float(t.cdf((estimate - margin) / error, n - 1))
    p = max(above, below)
    reach = float(t.ppf(1.0 - alpha, n - 1)) * error
    verdict = "equivalent within" if p <= alpha else "not significantly equivalent within"
    sentence = (
        f"{verdict} the margin of {margin * data.factor:.2g}{data.unit} "
        f"({data.shown(estimate)}, "
        f"{data.shown_interval(estimate - reach, estimate + reach, 1.0 - 2.0 * alpha)}, "
        f"{shown_p(p)}, {persons(n)})."
    )
    further = {"p_above": above, "p_below": below}
    return StatisticalFinding(
        estimate, estimate - reach, estimate + reach, p, 0.0, sentence, further
    )
