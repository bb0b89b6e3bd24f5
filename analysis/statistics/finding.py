"""Common format of the results of all methods."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal

import numpy as np
import xarray as xr

from analysis.arguments import number
from analysis.errors import StatisticsError
from analysis.statistics.paired import WHY, Array, PairedScores
from analysis.statistics.scope import LEAST_VOLUNTEERS

Verdict = Literal["met", "by design", "doubtful", "violated", "not checked"]

FINDING_COUNTS: Final = ("pairs", *(f"lost_{why}" for why in WHY), "clipped")


@dataclass(frozen=True)
class Check:
    """Assumption of a method (a few words), its verdict, and the check that led to it (a sentence)."""

    assumption: str
    verdict: Verdict
    check: str


@dataclass(frozen=True)
class StatisticalFinding:
    """Result of a method for one contrast; NaN where it is undefined.

    Contrast, number of volunteers, counts and assumptions are set by `judged`.
    """

    estimate: float = math.nan  #: in the units of the result
    lower: float = math.nan  #: bounds of the interval, in these units
    upper: float = math.nan
    p: float = math.nan  #: probability [1]
    smallest_p: float = math.nan  #: smallest p that the design can reach [1]
    sentence: str = ""  #: the finding in words
    #: quantities of this method only
    further: Mapping[str, float] = field(default_factory=dict[str, float])
    contrast: str = ""  #: "first - second"
    n: int = 0  #: number of volunteers
    counts: Mapping[str, int] = field(default_factory=dict[str, int])  #: counts of `Paired`
    checks: tuple[Check, ...] = ()
    reason: str = ""  #: why there is no test, in words; empty if there is one


def judged_tests(
    pairs: Sequence[PairedScores],
    judge: Callable[[PairedScores], StatisticalFinding],
    checks: Callable[[PairedScores], tuple[Check, ...]],
    *,
    further: Sequence[str],
    method: str,
    level: float,
    attrs: Mapping[str, Any],
    least: int = 2,
) -> xr.Dataset:
    """Judge contrasts by a method and collect its findings.

    `judge` returns estimate, interval, p, `further` and sentence of a contrast with `least` or more
    volunteers; with fewer, only the mean is reported. `checks` returns the assumptions of the
    method and their checks. `further` are the names of the quantities of this method only, NaN
    where undefined; `method`, `level` and `attrs` are those of `collected`.
    """
    findings: list[StatisticalFinding] = []
    for data in pairs:
        n = len(data.values)
        finding = judge(data) if n >= least else _too_few(data, least)
        findings.append(
            replace(
                finding,
                contrast=data.label,
                n=n,
                sentence=f"{data.label}: {finding.sentence}{_lost(data.counts)}",
                counts=data.counts,
                checks=(*checks(data), _left_out(data)),
                further={name: finding.further.get(name, math.nan) for name in further},
            )
        )
    return collected(findings, method=method, level=level, attrs=attrs)


def collected(
    findings: Sequence[StatisticalFinding], *, method: str, level: float, attrs: Mapping[str, Any]
) -> xr.Dataset:
    """Combine the findings of a method, one per contrast, in one labelled Dataset.

    There is one finding per contrast. `method` is the name of the method, with its source, and
    `level` the nominal level of the intervals [1]; NaN if the bounds are not a confidence interval.
    Of `attrs`, ``units`` are those of estimate and interval.

    The result has the dims contrast, bound (lower, upper), assumption: ``estimate``, ``interval``,
    ``p``, ``p_holm`` (over the contrasts), ``smallest_p``, ``smallest_p_holm``, ``n`` (volunteers),
    the counts of pairs, texts ``verdict`` and ``check`` per assumption, texts ``sentence`` and
    ``reason`` (why there is no p);
    attributes ``method``, ``level`` and ``sentence``. Intervals from fewer than
    `analysis.statistics.scope.LEAST_VOLUNTEERS` are NaN.
    """
    attrs = dict(attrs)
    units = {"units": str(attrs.pop("units", "1"))}
    one = {"units": "1"}
    dim = "contrast"
    bounds = np.array([(f.lower, f.upper) for f in findings], dtype=np.float64).reshape(-1, 2)
    bounds[[f.n < LEAST_VOLUNTEERS for f in findings]] = math.nan
    p = np.array([f.p for f in findings], dtype=np.float64)
    least = np.array([f.smallest_p for f in findings], dtype=np.float64)
    estimates = np.array([f.estimate for f in findings], dtype=np.float64)
    variables: dict[str, Any] = {
        "estimate": (dim, estimates, units),
        "interval": ((dim, "bound"), bounds, units),
        "p": (dim, p, one),
        "p_holm": (dim, holm(p), one),
        "smallest_p": (dim, least, one),
        "smallest_p_holm": (dim, np.minimum(1.0, least * max(1, int(np.isfinite(p).sum()))), one),
        "n": (dim, np.array([f.n for f in findings], dtype=int), one),
    }
    for name in FINDING_COUNTS:
        variables[name] = (dim, np.array([f.counts.get(name, 0) for f in findings], dtype=int), one)
    for name in findings[0].further if findings else ():
        measured = name in ("standard_error", "standard_deviation")
        values = np.array([f.further[name] for f in findings])
        variables[name] = (dim, values, units if measured else one)
    variables["reason"] = (dim, np.array([f.reason for f in findings], dtype=str))
    variables["sentence"] = (dim, np.array([f.sentence for f in findings], dtype=str))
    coords: dict[str, Any] = {
        dim: np.array([f.contrast for f in findings], dtype=str),
        "bound": ["lower", "upper"],
    }
    if findings and findings[0].checks:
        variables["verdict"] = (
            (dim, "assumption"),
            [[c.verdict for c in f.checks] for f in findings],
        )
        variables["check"] = ((dim, "assumption"), [[c.check for c in f.checks] for f in findings])
        coords["assumption"] = [c.assumption for c in findings[0].checks]
    result = xr.Dataset(variables, coords=coords)
    sentences = [f.sentence for f in findings] or [
        "There is no comparison: a contrast requires two strategies."
    ]
    if findings and "scope" in attrs:
        sentences.append(f"Scope: {attrs['scope']}.")
    result.attrs = {"method": method, "level": level, **attrs, "sentence": " ".join(sentences)}
    return result


EQUAL: Final = 1e-12  #: spread relative to the largest value below which values differ by rounding


def without_spread(values: Array, scale: float = 0.0) -> bool:
    """Return True if values differ by rounding only, so that their spread cannot be the error of a test.

    `scale` is a size with which the values are compared, such as a margin.
    """
    size = max(float(np.abs(values).max(initial=0.0)), scale)
    return float(np.ptp(values)) <= EQUAL * size


def untestable(data: PairedScores) -> StatisticalFinding:
    """Finding of a contrast whose differences are the same in all volunteers, and not zero."""
    estimate = float(data.values.mean())
    n = persons(len(data.values))
    text = (
        f"{data.shown(estimate)} in each of {n}; without variation between them, there is no test and "
        "no interval."
    )
    reason = f"the difference is the same in each of {n}, so that its error cannot be estimated"
    return StatisticalFinding(estimate, sentence=text, reason=reason)


def check_level(level: float) -> None:
    """Raise for a level that is not a probability."""
    if not 0 < number("the level", level) < 1:
        raise StatisticsError(f"the level is {level}, expected between 0 and 1")


def holm(p: Array) -> Array:
    """Holm's step-down adjustment of probabilities; NaN are not counted.

    Source: Holm 1979, Scandinavian Journal of Statistics 6:65.
    """
    p = np.asarray(p, dtype=np.float64)
    adjusted = np.full(p.shape, np.nan)
    known = np.flatnonzero(np.isfinite(p))
    ascending = known[np.argsort(p[known], kind="stable")]
    multiples = p[ascending] * np.arange(len(ascending), 0, -1)
    adjusted[ascending] = np.minimum(1.0, np.maximum.accumulate(multiples))
    return adjusted


def shown_p(p: float) -> str:
    """Format a probability."""
    if math.isnan(p):
        return "p undefined"
    return "p < 0.001" if p < 1e-3 else f"p = {p:.2g}" if p < 0.0995 else f"p = {p:.2f}"


def persons(n: int) -> str:
    """Format a number of volunteers."""
    return f"{n} volunteer" if n == 1 else f"{n} volunteers"


def _lost(counts: Mapping[str, int]) -> str:
    """Describe the missing pairs of a finding; empty if there is none."""
    causes = {why: counts.get(f"lost_{why}", 0) for why in WHY}
    total = sum(causes.values())
    if not total:
        return ""
    listed = ", ".join(f"{count} {why}" for why, count in causes.items() if count)
    return f" {total} of {total + counts['pairs']} pairs are missing ({listed})."


def _too_few(data: PairedScores, least: int) -> StatisticalFinding:
    """Finding of a contrast with fewer volunteers than a method needs."""
    n = len(data.values)
    if not n:
        return StatisticalFinding(
            sentence="no pair of scored trials.", reason="there is no pair of scored trials"
        )
    estimate = float(data.values.mean())
    why = f"over {persons(n)}; no test and no interval, which require {least} or more."
    if n == 1:
        why = (
            "in the only volunteer with a pair; one volunteer does not allow a test or an interval."
        )
    reason = f"there are pairs of {persons(n)}, and {least} or more are required"
    return StatisticalFinding(estimate, sentence=f"{data.shown(estimate)} {why}", reason=reason)


def _left_out(data: PairedScores) -> Check:
    """Check the missing pairs of a contrast."""
    gone = sum(data.counts[f"lost_{why}"] for why in WHY)
    absent = data.means.sizes["volunteer"] - len(data.values)
    name = "pairs are missing at random"
    if not gone:
        return Check(name, "met", "No pair is missing.")
    text = f"{gone} of {gone + data.counts['pairs']} pairs are lost"
    text += f", all those of {persons(absent)}" if absent else ""
    text += ": a trial that fails because of its strategy would bias the contrast."
    return Check(name, "doubtful", text)


INDEPENDENT: Final = Check(
    "volunteers are independent",
    "by design",
    "One number per volunteer is used; markers, repetitions and instructions are averaged.",
)
