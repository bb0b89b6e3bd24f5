"""Equivalence of two strategies by two one-sided tests."""

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr
from scipy.stats import shapiro, t

from analysis.errors import StatisticsError
from analysis.statistics.finding import (
    INDEPENDENT,
    Check,
    Finding,
    check_level,
    collected,
    left_out,
    lost,
    persons,
    shown_p,
    too_few,
)
from analysis.statistics.paired import LIMIT, Array, Paired, Scale, all_paired
from analysis.statistics.scope import LEAST_VOLUNTEERS


def equivalence(
    cube: xr.Dataset,
    *,
    margin: float,
    contrasts: Sequence[tuple[str, str]] | None = None,
    variable: str = "rho",
    scale: Scale | None = None,
    alpha: float = 0.05,
    limit: float = LIMIT,
) -> xr.Dataset:
    """Test whether two strategies differ by less than a margin.

    Two one-sided paired t tests on the volunteers' mean differences: that the difference lies
    above -margin, and that it lies below +margin. p is the larger of both.

    Parameters
    ----------
    cube, contrasts, variable, scale, limit
        As in `analysis.statistics.sign_flip.sign_flip`.
    margin : float
        Greatest difference that does not matter, on the scale of the analysis (Fisher's z for
        rho, else the unit of the variable). There is no default: it must come from what matters
        to a reader, before the data are seen.
    alpha : float
        Size of each one-sided test [1]; the interval has the level 1 - 2 alpha.

    Returns
    -------
    xarray.Dataset
        See `analysis.statistics.finding.collected`; a small p speaks for equivalence. Besides
        ``p_above`` (of -margin) and ``p_below`` (of +margin), and attribute ``margin``.

    Raises
    ------
    StatisticsError
        Unknown strategy or variable, further dims, a margin that is not positive, or alpha
        outside 0-0.5.

    Notes
    -----
    A p that is not small shows neither equivalence nor a difference. Source: Schuirmann 1987,
    Journal of Pharmacokinetics and Biopharmaceutics 15:657.
    """
    if not (math.isfinite(margin) and margin > 0):
        raise StatisticsError(f"the margin of equivalence is {margin}, expected above 0")
    if not 0 < alpha < 0.5:
        raise StatisticsError(f"alpha is {alpha}, expected between 0 and 0.5")
    check_level(1.0 - 2.0 * alpha)
    data, attrs = all_paired(cube, contrasts, variable, scale, limit)
    findings = [_finding(each, margin, alpha) for each in data]
    method = "two one-sided paired t tests over volunteers (Schuirmann 1987)"
    attrs |= {"margin": margin, "alpha": alpha}
    return collected(findings, method=method, level=1.0 - 2.0 * alpha, attrs=attrs)


def normality(values: Array) -> Check:
    """Check whether the differences of volunteers could be normal (Shapiro and Wilk)."""
    name = "mean differences are normal"
    if len(values) < 3 or np.ptp(values) == 0:
        return Check(name, "not checked", "Too few different values to check.")
    p = float(shapiro(values).pvalue)
    text = f"Shapiro-Wilk {shown_p(p)} over {persons(len(values))}"
    text += ", which would miss all but gross departures." if len(values) < 20 else "."
    return Check(name, "doubtful" if p < 0.05 else "met", text)


def _finding(data: Paired, margin: float, alpha: float) -> Finding:
    values = data.values
    checks = (INDEPENDENT, normality(values), left_out(data))
    few = too_few(data, checks, ("p_above", "p_below"), least=LEAST_VOLUNTEERS)
    if few is not None:
        return few
    n, estimate = len(values), float(values.mean())
    error = float(values.std(ddof=1)) / math.sqrt(n)
    if error <= 1e-12 * max(margin, abs(estimate)):
        text = (
            f"{data.label}: {data.shown(estimate)} in each of {persons(n)}; without any variation "
            f"between them there is no test of equivalence.{lost(data.counts)}"
        )
        return Finding(
            data.label, estimate, n=n, sentence=text, counts=data.counts, checks=checks,
            further={"p_above": math.nan, "p_below": math.nan},
        )  # fmt: skip
    above = float(t.sf((estimate + margin) / error, n - 1))
    below = float(t.cdf((estimate - margin) / error, n - 1))
    p = max(above, below)
    reach = float(t.ppf(1.0 - alpha, n - 1)) * error
    verdict = "equivalent within" if p <= alpha else "not shown to be equivalent within"
    sentence = (
        f"{data.label}: {verdict} the margin of {margin * data.factor:.2g}{data.unit} "
        f"({data.shown(estimate)}, "
        f"{data.shown_interval(estimate - reach, estimate + reach, 1.0 - 2.0 * alpha)}, "
        f"{shown_p(p)}, {persons(n)}).{lost(data.counts)}"
    )
    return Finding(
        data.label, estimate, estimate - reach, estimate + reach, p, 0.0, n, sentence,
        data.counts, checks, {"p_above": above, "p_below": below},
    )  # fmt: skip
