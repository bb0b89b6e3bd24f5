"""Text and tables of a report: outcome, tests, exclusions, run time."""

import re
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from analysis.axes import further_axes
from analysis.cube import TRIAL_DIMS
from analysis.errors import AnalysisError
from analysis.listing import counts, trials
from analysis.robustness import levels_of, robustness, robustness_sentences, robustness_table
from analysis.sensitivity import sensitivity
from analysis.statistics.scope import LEAST_VOLUNTEERS
from analysis.statistics.summary import conclusions, statistics_table, study_statistics
from analysis.tables import Column, Table, origin_of, recordings
from emgface.report.results import Results
from emgface.signals.montage import COMPLETE


@dataclass(frozen=True)
class Inference:
    """Results of the tests of a study.

    `conclusions` contains one sentence per contrast, or the reason why there is none; `table` every
    test and contrast; `methods` names of tests with their methods and scopes, and what all of them
    found; `checks` tests, assumption, verdict and basis of the verdict.
    """

    conclusions: list[str]
    table: Table | None = None
    methods: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = ()
    checks: tuple[tuple[str, str, str, str], ...] = ()


def is_empty(cube: xr.Dataset) -> bool:
    """Return True for a cube without trials."""
    return any(cube.sizes[dim] == 0 for dim in TRIAL_DIMS)


def verdict(cube: xr.Dataset) -> list[str]:
    """Summarise the outcome of a study in sentences, problems first."""
    if is_empty(cube):
        return ["This study contains no trial; there is nothing to report."]
    totals = counts(cube, by=()).iloc[0]
    total, ok = int(totals["trials"]), int(totals["ok"])
    lost = f"{int(totals['failed'])} failed, {int(totals['excluded'])} were excluded"
    lost += f", {int(totals['missing'])} are missing"
    sentences = [f"{ok} of {_n(total, 'trial')} could be scored; {lost}."]
    if ok == 0:
        return [
            f"No trial could be scored: of {_n(total, 'trial')}, {lost}. There are no scores and "
            "no tests; the reasons are listed under exclusions."
        ]
    rho = cube["rho"].values[np.isfinite(cube["rho"].values)]
    if not len(rho):
        sentences.append(
            "No marker has a defined rho, because in every scored trial the measured or the "
            "simulated marker does not move."
        )
        return sentences
    if len(rho) > 1 and float(np.ptp(rho)) < 1e-12:
        sentences.append(
            f"rho is {rho[0]:.3g} everywhere: all {len(rho)} values are identical, so that "
            "strategies cannot be distinguished and tests of differences are meaningless. "
            "Measured data do not have this property; check the input."
        )
    montage = str(cube.attrs.get("montage", COMPLETE.sentence))
    if montage != COMPLETE.sentence:
        sentences.append(f"The montage is incomplete: {montage}.")
    sentences += features(cube) + accuracy(cube) + reduction(cube)
    if cube.sizes["volunteer"] == 1:
        sentences.append(
            "There is one volunteer; the results cannot be generalised to other people, and "
            "no test is performed."
        )
    elif cube.sizes["volunteer"] < LEAST_VOLUNTEERS:
        sentences.append(
            f"There are {cube.sizes['volunteer']} volunteers; intervals require "
            f"{LEAST_VOLUNTEERS} or more and are not given."
        )
    if cube.sizes["strategy"] == 1:
        sentences.append(
            f"There is one strategy, {cube['strategy'].values[0]}; there is no comparison."
        )
    return sentences


def features(cube: xr.Dataset) -> list[str]:
    """State in how many scored trials the feature of a muscle has a narrow range or is mainly noise."""
    reasons = cube["reason"].values[cube["status"].values == "ok"].tolist()
    sentences: list[str] = []
    for code, what, remedy in (
        ("narrow count", "counts within a narrow range of steps, which Eq. 8 stretches to 0-1",
         "the findings of each activation state the threshold that would serve"),
        ("weak burst", "is mainly noise, because the muscle is hardly more active than at rest",
         "no threshold serves: a muscle at rest, or a poor electrode"),
    ):  # fmt: skip
        named = [re.search(rf"{code} \(([^)]*)\)", reason) for reason in reasons]
        hits = [one.group(1) for one in named if one is not None]
        if not hits:
            continue
        counted = Counter(re.findall(r"[A-Z]+_[LR]", " ".join(hits)))
        most, times = counted.most_common(1)[0]
        sentences.append(
            f"In {len(hits)} of {_n(len(reasons), 'scored trial')}, the feature of at least one muscle "
            f"{what} (first of all {most}, named in {times}); {remedy}."
        )
    return sentences


def accuracy(cube: xr.Dataset) -> list[str]:
    """State the estimated error of the time steps in comparison with the motion; empty if unknown."""
    if not {"numerical_error", "motion", "inaccurate"} <= set(cube.data_vars):
        return []
    ok = (cube["status"] == "ok").values
    error, motion = (1e3 * cube[name].values[ok] for name in ("numerical_error", "motion"))
    known = np.isfinite(error)
    if not known.any():
        return ["The error of the time steps was not estimated in any scored trial."]
    flagged = int((cube["inaccurate"].values[ok] == 1.0).sum())
    lost = (
        f" It was not estimated in {_n(int((~known).sum()), 'scored trial')}."
        if not known.all()
        else ""
    )
    return [
        f"The estimated error of the time steps has a median of {np.median(error[known]):.2g} mm and "
        f"a maximum of {error[known].max():.2g} mm; the median motion is "
        f"{np.nanmedian(motion):.2g} mm. The error exceeds a tenth of the motion in "
        f"{_n(flagged, 'trial')}{', flagged as inaccurate' if flagged else ''}.{lost}"
    ]


def reduction(cube: xr.Dataset) -> list[str]:
    """State in how many trials full order replaced a reduced face; empty without a reduced face."""
    if "reduced" not in cube:
        return []
    used = cube["reduced"].values[(cube["status"] == "ok").values]
    used = used[np.isfinite(used)]
    if not used.size:
        return []
    return [
        f"A reduced face was simulated in {_n(used.size, 'scored trial')}. In "
        f"{int((used == 0.0).sum())} of them, the motion was computed at full order instead, because "
        "the reduced motion was not trusted."
    ]


def inference(cube: xr.Dataset, *, known: dict[str, xr.Dataset] | None = None) -> Inference:
    """Apply all tests that the study allows; `known` is their result, if it has been computed."""
    if is_empty(cube) or not np.isfinite(cube["rho"].values).any():
        return Inference(["There are no scores; no test is performed."])
    if cube.sizes["strategy"] < 2:
        return Inference(
            ["There is one strategy; a contrast requires two strategies, and no test is performed."]
        )
    if cube.sizes["volunteer"] < 2:
        return Inference(
            [
                "There is one volunteer; the tests require several volunteers, and no test is performed."
            ]
        )
    try:
        statistics = known or study_statistics(cube)
    except AnalysisError as error:
        return Inference([f"The tests could not be performed: {error}."])
    return Inference(
        conclusions(statistics, together=True),
        statistics_table(statistics),
        _results(statistics),
        _checks(statistics),
    )


def _results(
    statistics: dict[str, xr.Dataset],
) -> tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]:
    """Tests with method and scope, and their sentences: each once, for all tests that share it."""
    tests: dict[str, list[str]] = {}
    for name, each in statistics.items():
        scope = f" ({each.attrs['scope']})" if "scope" in each.attrs else ""
        head = f"{name.replace('_', ' ')}: {each.attrs['method']}{scope}"
        for sentence in each["sentence"].values.tolist():
            tests.setdefault(str(sentence), []).append(head)
    sentences: dict[tuple[str, ...], list[str]] = {}
    for sentence, heads in tests.items():
        sentences.setdefault(tuple(heads), []).append(sentence)
    return tuple((heads, tuple(texts)) for heads, texts in sentences.items())


def _checks(statistics: dict[str, xr.Dataset]) -> tuple[tuple[str, str, str, str], ...]:
    """Tests, assumption, verdict and its basis; the verdict of a test is the worst of all contrasts."""
    order = ["violated", "doubtful", "not checked", "met", "by design"]
    tests: dict[tuple[str, str, str], list[str]] = {}
    assumptions: dict[tuple[str, str, str], list[str]] = {}
    for name, each in statistics.items():
        for assumption in each["assumption"].values if "verdict" in each else ():
            one = each.sel(assumption=assumption)
            said = [str(verdict) for verdict in one["verdict"].values]
            at = said.index(min(said, key=order.index))
            basis = (str(assumption), said[at], str(one["check"].values[at]))
            tests.setdefault(basis, []).append(name.replace("_", " "))
    # One basis may decide several assumptions of the same tests, as if a model was not fitted.
    for (assumption, verdict, basis), names in tests.items():
        assumptions.setdefault((", ".join(names), verdict, basis), []).append(assumption)
    return tuple(
        (names, ", ".join(which), verdict, basis)
        for (names, verdict, basis), which in assumptions.items()
    )


def varied(cube: xr.Dataset, notes: list[str]) -> xr.Dataset | None:
    """Compare the levels of every further axis of a cube; None if there is no such axis."""
    if not further_axes(cube) or not np.isfinite(cube["rho"].values).any():
        return None
    try:
        return sensitivity(cube)
    except AnalysisError as error:
        notes.append(f"The open choices could not be compared: {error}")
        return None


def other_choices(cube: xr.Dataset, notes: list[str]) -> tuple[list[str], Table] | None:
    """Compare the conclusions under every choice and without flagged trials; None if nothing varies."""
    if not np.isfinite(cube["rho"].values).any() or len(levels_of(cube)) < 2:
        return None
    try:
        result = robustness(cube)
    except AnalysisError as error:
        notes.append(f"The conclusions under other choices could not be compared: {error}")
        return None
    return robustness_sentences(result), robustness_table(result)


def exclusions(results: Results) -> Table:
    """List the trials without a score or with a remark, by status and reason, and omitted files."""
    cube = results.base
    rows: list[tuple[Any, ...]] = []
    if not is_empty(cube):
        listed = trials(cube)
        noted = listed[(listed["status"] != "ok") | (listed["reason"] != "")]
        for (status, reason), group in noted.groupby(["status", "reason"], sort=False):
            status = "scored, with a remark" if status == "ok" else status
            labels = group[list(TRIAL_DIMS)].astype(str).agg(" ".join, axis=1).tolist()
            more = f" and {len(labels) - 6} more" if len(labels) > 6 else ""
            rows.append((str(status), len(group), ", ".join(labels[:6]) + more, str(reason)))
        undefined = listed[(listed["status"] == "ok") & (listed["n_undefined"] > 0)]
        for _, one in undefined.iterrows():
            label = " ".join(str(one[dim]) for dim in TRIAL_DIMS)
            rows.append(("partly scored", 1, label, _why_undefined(cube, one)))
    if results.intake is not None:
        for path, error in results.intake.unreadable.items():
            rows.append(("file omitted", 0, path.name, str(error)))
    origin = origin_of(cube)
    columns = (Column("status"), Column("trials"), Column("which"), Column("reason"))
    return Table(
        f"trials and files without scores or with remarks, {recordings(origin)}",
        columns,
        tuple(rows),
        origin,
    )


def _why_undefined(cube: xr.Dataset, one: Any) -> str:
    n = int(one["n_undefined"])
    text = f"{n} of {cube.sizes['marker']} markers have no rho"
    if "marker_reason" not in cube:
        return text
    reasons = cube["marker_reason"].sel({dim: one[dim] for dim in TRIAL_DIMS}).values
    distinct = sorted({str(reason) for reason in reasons.tolist() if reason})
    return f"{text}: {'; '.join(distinct)}" if distinct else text


def cost(results: Results) -> Table | None:
    """Tabulate run time, steps, muscle stress and numerical error [m] per strategy.

    None if no trial was scored.
    """
    cube = results.base
    if is_empty(cube) or not (cube["status"] == "ok").any() or "run_time" not in cube:
        return None
    start = results.study.simulation.sigma_max if results.study is not None else np.nan
    rows: list[tuple[Any, ...]] = []
    for strategy in cube["strategy"].values:
        one = cube.sel(strategy=strategy)
        one = one.where(one["status"] == "ok")
        time, steps, sigma = (
            one[name].values[np.isfinite(one[name].values)]
            for name in ("run_time", "steps", "sigma_max")
        )
        error: Any = "not estimated"
        if "numerical_error" in cube and np.isfinite(one["numerical_error"].values).any():
            error = f"{1e3 * float(np.nanmax(one['numerical_error'].values)):.2g}"
        lowered: Any = int((sigma < start * (1 - 1e-9)).sum()) if np.isfinite(start) else "-"
        rows.append(
            (
                str(strategy),
                len(time),
                float(np.median(time)) if len(time) else np.nan,
                float(np.max(time)) if len(time) else np.nan,
                float(np.sum(time)),
                1e3 * float(np.sum(time) / np.sum(steps)) if np.sum(steps) else np.nan,
                float(np.min(sigma)) if len(sigma) else np.nan,
                lowered,
                error,
            )
        )
    columns = (
        Column("strategy"), Column("trials"), Column("median", "s", "s"), Column("longest", "s", "s"),
        Column("all", "s", "s"), Column("per step", "ms", "ms", 1.0, 1),
        Column("smallest sigma_max", "Pa", "kPa", 1e-3, 0), Column("lowered"),
        Column("largest numerical error [mm]"),
    )  # fmt: skip
    origin = origin_of(cube)
    note = (
        "Run time of the simulations only; strategies that activate the same muscles share "
        "a simulation. lowered: trials for which sigma_max was lowered."
    )
    title = f"run time and numerical error, {recordings(origin)}"
    return Table(title, columns, tuple(rows), origin, note)


def _n(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
