"""Mixed model of Fisher's z with crossed random effects."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import levene, norm, shapiro, t

from analysis.statistics.crossed import Fit, fit_crossed
from analysis.statistics.finding import (
    Check,
    Finding,
    check_level,
    collected,
    left_out,
    lost,
    persons,
    shown_p,
)
from analysis.statistics.paired import (
    LIMIT,
    Paired,
    Scale,
    all_paired,
    analysed,
    chosen_contrasts,
)

RANDOM: Final = ("volunteer", "instruction", "marker", "volunteer x strategy")
MANY: Final = 30
"""Volunteers from which the normal distribution stands for t."""
MOST_CHECKED: Final = 5000
"""Residuals up to which the Shapiro-Wilk probability is defined."""


def mixed_model(
    cube: xr.Dataset,
    *,
    contrasts: Sequence[tuple[str, str]] | None = None,
    variable: str = "rho",
    scale: Scale | None = None,
    level: float = 0.95,
    limit: float = LIMIT,
) -> xr.Dataset:
    """Compare strategies by a linear mixed model of values averaged over repetitions.

    z = strategy + volunteer + instruction + marker + volunteer x strategy + residual

    with all but the strategy random and crossed, by restricted maximum likelihood. p and interval
    use the t distribution with (volunteers - 1)(strategies - 1) degrees of freedom, exact for
    complete data while the variance of volunteer x strategy is above zero.

    Parameters
    ----------
    cube, contrasts, variable, scale, level, limit
        As in `analysis.statistics.sign_flip.sign_flip`.

    Returns
    -------
    xarray.Dataset
        See `analysis.statistics.finding.collected`; besides ``standard_error``,
        ``degrees_of_freedom`` and ``p_wald`` (normal distribution; too small for few volunteers);
        ``mean`` (strategy) and its ``mean_error``; ``variance`` (random) of each random effect
        and the residual; attributes ``converged`` and ``criterion`` (-2 restricted log-likelihood).

    Raises
    ------
    StatisticsError
        Unknown strategy or variable, further dims, or a level outside 0-1.

    Notes
    -----
    All values defined are used, also those without a partner; the counts say how many pairs are
    complete. Source: Baayen, Davidson and Bates 2008, Journal of Memory and Language 59:390;
    degrees of freedom: Winer, Brown and Michels 1991, Statistical Principles in Experimental
    Design, chapter 7.
    """
    check_level(level)
    data, used, attrs = analysed(cube, variable, scale, limit)
    pairs, _ = all_paired(cube, contrasts, variable, used, limit)
    labels = [str(label) for label in data["strategy"].values]
    mean = data.mean("repetition", skipna=True)
    mean = mean.transpose("volunteer", "instruction", "strategy", "marker")
    cells = np.nonzero(np.isfinite(mean.values))
    y = mean.values[cells]
    v, i, s, m = (np.asarray(index, dtype=np.int64) for index in cells)
    seen = np.unique(s)
    people = len(np.unique(v))
    strategies = len(labels)
    method = "linear mixed model, crossed random effects, restricted maximum likelihood"
    fit: Fit | None = None
    why = ""
    if not pairs:
        why = ""
    elif people < 2:
        why = f"{persons(people)} with scored trials, so the model cannot be fitted"
    elif len(seen) < 2:
        why = "fewer than two strategies have scored trials, so the model cannot be fitted"
    elif np.ptp(y) == 0:
        why = "all values are the same, so the model cannot be fitted"
    elif len(y) <= people * len(seen) + 1:
        why = "there is no more than one value per volunteer and strategy, so the model cannot be fitted"
    else:
        X = (s[:, None] == seen[None, :]).astype(np.float64)
        fit = fit_crossed(y, X, dict(zip(RANDOM, (v, i, m, v * strategies + s), strict=True)))
    freedom = (people - 1) * (len(seen) - 1)
    checks = _checks(fit, s, people)
    place = {labels[int(index)]: k for k, index in enumerate(seen)}
    chosen = chosen_contrasts(labels, contrasts)
    findings = [
        _finding(each, first, second, fit, place, people, freedom, level, why, checks)
        for each, (first, second) in zip(pairs, chosen, strict=True)
    ]
    result = collected(findings, method=method, level=level, attrs=attrs)
    means, errors = np.full(strategies, np.nan), np.full(strategies, np.nan)
    variances = np.full(len(RANDOM) + 1, np.nan)
    if fit is not None:
        means[seen], errors[seen] = fit.beta, np.sqrt(np.diag(fit.covariance))
        variances = np.array(list(fit.variances.values()))
        result.attrs |= {"converged": int(fit.converged), "criterion": fit.criterion}
    units = {"units": attrs["units"]}
    result["mean"] = ("strategy", means, units)
    result["mean_error"] = ("strategy", errors, units)
    squared = {"units": "1" if attrs["units"] == "1" else f"{attrs['units']}^2"}
    result["variance"] = ("random", variances, squared)
    result["strategy"], result["random"] = labels, [*RANDOM, "residual"]
    return result


def _finding(
    data: Paired,
    first: str,
    second: str,
    fit: Fit | None,
    place: dict[str, int],
    people: int,
    freedom: int,
    level: float,
    why: str,
    checks: tuple[Check, ...],
) -> Finding:
    further = {"standard_error": math.nan, "degrees_of_freedom": math.nan, "p_wald": math.nan}
    checks = (*checks, left_out(data))
    if fit is None or first not in place or second not in place:
        why = why or "one of the two has no scored trial"
        return Finding(
            data.label, n=people, sentence=f"{data.label}: {why}.{lost(data.counts)}",
            counts=data.counts, checks=checks, further=further,
        )  # fmt: skip
    contrast = np.zeros(len(fit.beta))
    contrast[place[first]], contrast[place[second]] = 1.0, -1.0
    estimate = float(contrast @ fit.beta)
    error = math.sqrt(float(contrast @ fit.covariance @ contrast))
    p_wald = 2.0 * float(norm.sf(abs(estimate) / error))
    p = 2.0 * float(t.sf(abs(estimate) / error, freedom))
    reach = float(t.ppf((1.0 + level) / 2.0, freedom)) * error
    interval = data.shown_interval(estimate - reach, estimate + reach, level)
    sentence = (
        f"{data.label}: {data.shown(estimate)} by the mixed model over {persons(people)} "
        f"({interval}; {shown_p(p)} with {freedom} degrees of freedom; the Wald "
        f"{shown_p(p_wald)}{' is too small for so few volunteers' if people < MANY else ''})."
        f"{lost(data.counts)}"
    )
    further = {"standard_error": error, "degrees_of_freedom": float(freedom), "p_wald": p_wald}
    return Finding(
        data.label, estimate, estimate - reach, estimate + reach, p, 0.0, people, sentence,
        data.counts, checks, further,
    )  # fmt: skip


def _checks(fit: Fit | None, strategy: NDArray[np.int64], people: int) -> tuple[Check, ...]:
    names = (
        "the fit converged", "variances lie above zero", "residuals are normal",
        "residuals vary alike in all strategies", "enough volunteers for the Wald p",
    )  # fmt: skip
    if fit is None:
        return tuple(Check(name, "not checked", "There is no fit.") for name in names)
    total = sum(fit.variances.values())
    zero = [name for name, value in fit.variances.items() if value < 1e-6 * total]
    r = fit.residuals
    normal = float(shapiro(r[:: len(r) // MOST_CHECKED + 1]).pvalue)
    groups = [r[strategy == index] for index in np.unique(strategy)]
    alike = float(levene(*groups).pvalue) if all(len(g) > 2 for g in groups) else math.nan
    texts = (
        "The optimiser reached its tolerance." if fit.converged else "The optimiser gave up.",
        f"At zero: {', '.join(zero)}." if zero else "All variances are above zero.",
        f"Shapiro-Wilk {shown_p(normal)} over {len(r)} residuals, which are not independent.",
        f"Levene {shown_p(alike)}.",
        f"{persons(people)}: the normal distribution ignores that the variances are estimated.",
    )
    good = (fit.converged, not zero, normal >= 0.05, not alike < 0.05, people >= MANY)
    return tuple(
        Check(name, "met" if fine else "doubtful", text)
        for name, fine, text in zip(names, good, texts, strict=True)
    )
