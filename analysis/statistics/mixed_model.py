"""Mixed model of differences between strategies, volunteers and instructions crossed."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from scipy.stats import norm, normaltest, shapiro, t

from analysis.errors import StatisticsError
from analysis.statistics.crossed import Fit, fit_crossed
from analysis.statistics.finding import (
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
from analysis.statistics.scope import LEAST_INSTRUCTIONS, LEAST_VOLUNTEERS, Scope, told_scope
from analysis.trajectory import names

RANDOM_EFFECTS: Final = ("volunteer x strategy", "instruction x strategy")
OF_MANY: Final = ("D'Agostino-Pearson", normaltest)  #: test of more than 5000 residuals
#: number of volunteers above which the normal distribution approximates t
MANY_VOLUNTEERS: Final = 30


@dataclass(frozen=True)
class _Fitted:
    """Fit of one contrast: estimate, standard error and degrees of freedom."""

    fit: Fit
    estimate: float
    error: float
    freedom: float


def mixed_model(
    data: Comparison, *, scope: Scope = "instructions", level: float = 0.95
) -> xr.Dataset:
    """Compare strategies by a linear mixed model with slopes of volunteers and instructions.

    The difference d of two strategies within the same trial and marker, averaged over repetitions
    and markers, is d = delta + volunteer x strategy + instruction x strategy + residual, with
    crossed random terms, by restricted maximum likelihood; p and interval use t with
    Satterthwaite's degrees of freedom. Effects common to both strategies cancel in d: the
    intercepts of volunteer, instruction and marker, and their interactions.

    With the scope ``"instructions"``, those of the study are a sample of all, so that instruction x
    strategy is random and its variance is part of the error. With ``"these instructions"``, it is
    fixed, and delta is the mean over the instructions of the study.

    The result is that of `collected`; besides ``standard_error``, ``degrees_of_freedom`` and
    ``p_wald`` (normal distribution; too small for few volunteers); ``variance`` (contrast, random)
    of the terms of d, NaN for one that is not in the model; ``converged`` [1] and ``criterion`` (-2
    restricted log-likelihood).

    Each contrast is fitted separately, so that variances may differ between strategies. The model
    of "instructions" in R: ``lmer(d ~ 1 + (1 | volunteer) + (1 | instruction))``. Sources: Clark
    1973, Journal of Verbal Learning and Verbal Behavior 12:335; Baayen, Davidson and Bates 2008,
    Journal of Memory and Language 59:390; Judd, Westfall and Kenny 2012, Journal of Personality and
    Social Psychology 103:54.
    """
    check_level(level)
    if scope not in ("instructions", "these instructions"):
        raise StatisticsError(
            f"the scope is {scope!r}, expected 'instructions' or 'these instructions'"
        )
    fitted = {each.label: fit_differences(cell_means(each), scope) for each in data.pairs}
    result = judged_tests(
        data.pairs,
        lambda each: _finding(each, fitted[each.label], level),
        lambda each: _checks(fitted[each.label], len(cell_means(each))),
        further=("standard_error", "degrees_of_freedom", "p_wald"),
        method="linear mixed model of paired differences, restricted maximum likelihood",
        level=level,
        attrs=data.attrs | {"scope": told_scope(scope, data.values.sizes["instruction"])},
    )
    random = (*RANDOM_EFFECTS, "residual")
    fits = [one.fit if isinstance(one, _Fitted) else None for one in fitted.values()]
    variances = [
        [fit.variances.get(r, math.nan) if fit else math.nan for r in random] for fit in fits
    ]
    squared = {"units": "1" if data.attrs["units"] == "1" else f"{data.attrs['units']}^2"}
    table = np.array(variances, dtype=np.float64).reshape(len(fits), len(random))
    result["random"] = list(random)
    return result.assign(
        variance=(("contrast", "random"), table, squared),
        criterion=("contrast", [fit.criterion if fit else math.nan for fit in fits]),
        converged=("contrast", [int(fit.converged) if fit else 0 for fit in fits]),
    )


def cell_means(data: PairedScores) -> Array:
    """Differences averaged over repetitions, then markers, shape (volunteers, instructions).

    Volunteers and instructions without a pair are omitted; other gaps are NaN.
    """
    mean = data.differences.mean("repetition", skipna=True)
    rest = [dim for dim in mean.dims if dim not in ("volunteer", "instruction")]
    table = mean.mean(rest, skipna=True).transpose("volunteer", "instruction").values
    known = np.isfinite(table)
    return np.asarray(table[known.any(axis=1)][:, known.any(axis=0)], dtype=np.float64)


def fit_differences(
    table: Array, scope: Scope, *, least: tuple[int, int] = (LEAST_VOLUNTEERS, LEAST_INSTRUCTIONS)
) -> _Fitted | str:
    """Fit the mean differences of one contrast, or return the reason for which they cannot be fitted.

    `table` (volunteers, instructions) contains mean differences, NaN where there is no pair.
    `least` are the least numbers of volunteers and, if they are a sample, of instructions.
    """
    people, instructions = table.shape
    if people < least[0]:
        return f"the model requires {least[0]} or more volunteers"
    if scope == "instructions" and instructions < least[1]:
        return (
            f"{instructions} instructions do not allow a statement about instructions in "
            f"general, which requires {least[1]} or more"
        )
    v, i = np.nonzero(np.isfinite(table))
    y = table[v, i]
    if float(np.ptp(y)) <= 1e-12 * float(np.abs(y).max(initial=0.0)):
        return "all differences are equal, so that the model cannot be fitted"
    fixed = scope == "these instructions"
    X = np.eye(instructions)[i] if fixed else np.ones((len(y), 1))
    factors = {RANDOM_EFFECTS[0]: v} if fixed else {RANDOM_EFFECTS[0]: v, RANDOM_EFFECTS[1]: i}
    if instructions == 1:
        factors = {}  # volunteers cannot be distinguished from the residual
    if instructions > 1 and len(y) < people + instructions:
        return "too many pairs are missing, so that the model cannot be fitted"
    fit = fit_crossed(y, X, factors)
    weights = np.full(X.shape[1], 1.0 / X.shape[1])
    error = math.sqrt(float(weights @ fit.covariance @ weights))
    return _Fitted(fit, float(weights @ fit.beta), error, fit.degrees_of_freedom(weights))


def _finding(data: PairedScores, fitted: _Fitted | str, level: float) -> StatisticalFinding:
    n, instructions = cell_means(data).shape
    over = f"{persons(n)} and {instructions} instruction{'s' if instructions > 1 else ''}"
    if not isinstance(fitted, _Fitted):
        estimate = float(data.values.mean())
        text = f"{data.shown(estimate)} over {over}; no test and no interval: {fitted}."
        return StatisticalFinding(estimate, sentence=text, reason=fitted)
    if without_spread(data.values) and data.values.any():
        return untestable(data)
    estimate, error, freedom = fitted.estimate, fitted.error, fitted.freedom
    p_wald = 2.0 * float(norm.sf(abs(estimate) / error))
    p = 2.0 * float(t.sf(abs(estimate) / error, freedom))
    reach = float(t.ppf((1.0 + level) / 2.0, freedom)) * error
    interval = data.shown_interval(estimate - reach, estimate + reach, level)
    sentence = (
        f"{data.shown(estimate)} by the mixed model over {over} ({interval}; "
        f"{shown_p(p)} with {freedom:.1f} degrees of freedom; the Wald "
        f"{shown_p(p_wald)}{' is too small for so few volunteers' if n < MANY_VOLUNTEERS else ''})."
    )
    further = {"standard_error": error, "degrees_of_freedom": freedom, "p_wald": p_wald}
    return StatisticalFinding(
        estimate, estimate - reach, estimate + reach, p, 0.0, sentence, further
    )


def _checks(fitted: _Fitted | str, people: int) -> tuple[Check, ...]:
    assumptions = (
        "the fit converged", "variances lie above zero", "residuals are normal",
        "enough volunteers for the Wald p",
    )  # fmt: skip
    if not isinstance(fitted, _Fitted):
        return tuple(
            Check(name, "not checked", "The model was not fitted.") for name in assumptions
        )
    fit = fitted.fit
    total = sum(fit.variances.values())
    zero = [name for name, value in fit.variances.items() if value < 1e-6 * total]
    # The p of Shapiro and Wilk is an approximation for up to 5000 values.
    name, test = ("Shapiro-Wilk", shapiro) if len(fit.residuals) <= 5000 else OF_MANY
    normal = float(test(fit.residuals).pvalue) if np.ptp(fit.residuals) > 0 else math.nan
    texts = (
        "The optimiser reached its tolerance."
        if fit.converged
        else "The optimiser did not converge.",
        f"At zero: {names(zero)}." if zero else "All variances are above zero.",
        f"{name} {shown_p(normal)} over {len(fit.residuals)} residuals, which are not independent.",
        f"{persons(people)}: the normal distribution does not account for the estimation of "
        "the variances.",
    )
    good = (fit.converged, not zero, not normal < 0.05, people >= MANY_VOLUNTEERS)
    return tuple(
        Check(name, "met" if fine else "doubtful", text)
        for name, fine, text in zip(assumptions, good, texts, strict=True)
    )
