"""Sensitivity of scores, per strategy, to the choices that a paper leaves open."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from scipy.stats import t

from analysis.cube import MARKER_DIMS
from analysis.errors import StatisticsError
from analysis.statistics.equivalence import normality
from analysis.statistics.finding import (
    INDEPENDENT,
    StatisticalFinding,
    check_level,
    holm,
    judged_tests,
    persons,
    shown_p,
    untestable,
    without_spread,
)
from analysis.statistics.paired import LIMIT, PairedScores, Scale, described, paired
from analysis.statistics.power import detectable
from analysis.statistics.scope import LEAST_VOLUNTEERS
from analysis.statistics.sign_flip import sign_flip_p, sign_patterns
from analysis.tables import TABLE_UNITS, Column, Table, recordings
from analysis.trajectory import names
from analysis.typed import selected

FURTHER = ("p_sign_flip", "rises", "detectable")


def sensitivity(
    cube: xr.Dataset,
    *,
    axes: Sequence[str] | None = None,
    reference: Mapping[str, Any] | None = None,
    variable: str = "rho",
    scale: Scale | None = None,
    level: float = 0.95,
    limit: float = LIMIT,
) -> xr.Dataset:
    """Compare every level of every axis with its reference, separately for each strategy.

    Differences are computed within trial and marker, all other axes at their reference, and
    averaged to one per volunteer; a paired t test over volunteers gives interval and p, which
    Holm's correction adjusts over all levels and strategies.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with further dims, one per axis, such as ``mapping_stage`` or ``sigma_max``; trials
        with several axes off their reference may be missing.
    axes : sequence of str, optional
        Axes to compare; by default all further dims.
    reference : mapping of str to label, optional
        Reference level per axis; by default its first level.
    variable : str
        ``"rho"``, ``"amplitude_ratio"`` or ``"rmse"``.
    scale, level, limit
        See `analysis.statistics.paired.compare` and `collected`.

    Returns
    -------
    xarray.Dataset
        As `analysis.statistics.finding.collected`, with the dim choice ("axis = level, strategy")
        instead of contrast: ``estimate`` is level minus reference; besides ``axis``, ``level`` and
        ``strategy`` (choice), ``p_sign_flip`` (exact, not adjusted), ``rises`` (volunteers with a
        positive difference), ``detectable`` (change detected with a power of 0.8 at the strictest
        step of Holm), and ``reach`` (axis names), the largest absolute estimate of each. Attributes
        ``reference`` and ``summary``.

    Raises
    ------
    StatisticsError
        No axis, an axis or reference level that the cube does not have, or a level outside 0-1.

    Notes
    -----
    One axis is varied at a time; interactions of two axes are not estimated. The exact p is not
    used for the conclusion, because with six volunteers Holm's correction over two tests leaves
    none below 0.05.
    """
    check_level(level)
    if variable not in cube:
        raise StatisticsError(f"the cube has no variable {variable!r}")
    available = [str(dim) for dim in cube[variable].dims if dim not in MARKER_DIMS]
    chosen = available if axes is None else list(axes)
    wrong = [axis for axis in chosen if axis not in available]
    if wrong or not chosen:
        raise StatisticsError(
            f"cannot compare along {names(wrong) or 'nothing'}: the cube has the further dims "
            f"{names(available) or 'none'}"
        )
    base = {axis: cube[axis].values[0] for axis in available} | dict(reference or {})
    for axis, label in base.items():
        if axis not in available or label not in cube[axis].values:
            raise StatisticsError(
                f"the reference {axis} = {label} is not in the cube, expected one of "
                f"{names(available if axis not in available else [str(v) for v in cube[axis].values])}"
            )
    used: Scale = scale if scale is not None else ("z" if variable == "rho" else "raw")
    data: list[PairedScores] = []
    choices: list[tuple[str, str, str]] = []
    strategies = [str(label) for label in cube["strategy"].values]
    for axis in chosen:
        others = {other: label for other, label in base.items() if other != axis}
        # Only scores have the axes; variables such as labels do not.
        fixed = selected(cube[[variable, "status"]].assign_attrs(cube.attrs), others)
        fixed = fixed.drop_vars(list(others))
        for label in cube[axis].values:
            if label == base[axis]:
                continue
            for strategy in strategies:
                one = selected(fixed, {"strategy": [strategy]})
                each = paired(
                    one, label, base[axis], dim=axis, variable=variable, scale=used, limit=limit
                )
                words = f"{axis} = {_words(label)}, {strategy}"
                data.append(
                    PairedScores(
                        words, each.differences, each.means, each.counts, each.unit, each.factor
                    )
                )
                choices.append((axis, _words(label), strategy))
    return _result(data, choices, base, cube, variable=variable, scale=used, level=level)


def _result(
    data: list[PairedScores], choices: list[tuple[str, str, str]], base: Mapping[str, Any],
    cube: xr.Dataset, *, variable: str, scale: Scale, level: float,
) -> xr.Dataset:  # fmt: skip
    alpha = 1.0 - level
    p = np.array([_t_test(each)[1] for each in data], dtype=np.float64)
    tests = int(np.isfinite(p).sum())
    adjusted = {each.label: float(one) for each, one in zip(data, holm(p), strict=True)}
    attrs = described(cube, variable, scale)
    attrs["reference"] = ", ".join(f"{axis} = {_words(label)}" for axis, label in base.items())
    result = judged_tests(
        data,
        lambda each: _finding(each, adjusted[each.label], tests, level),
        lambda each: (INDEPENDENT, normality(each.values)),
        further=FURTHER,
        method="level minus reference per strategy, paired t over volunteers, Holm over all",
        level=level,
        attrs=attrs,
        least=LEAST_VOLUNTEERS,
    ).rename({"contrast": "choice"})
    for place, name in enumerate(("axis", "level", "strategy")):
        result[name] = ("choice", np.array([each[place] for each in choices], dtype=str))
    chosen = list(dict.fromkeys(axis for axis, _, _ in choices))
    size = np.abs(result["estimate"].values)
    reach = [
        float(np.max(size[[each[0] == axis for each in choices]], initial=0.0)) for axis in chosen
    ]
    result["reach"] = ("axes", np.array(reach), {"units": attrs["units"]})
    result["axes"] = chosen
    result.attrs["summary"] = _summary(result, data[0] if data else None, alpha)
    return result


def _t_test(data: PairedScores) -> tuple[float, float]:
    """Standard error and p of the mean difference; NaN for too few volunteers.

    If the difference is the same in all of them, p is 1 for a difference of zero and otherwise NaN.
    """
    values = data.values
    n = len(values)
    if n < LEAST_VOLUNTEERS:
        return math.nan, math.nan
    mean, error = float(values.mean()), float(values.std(ddof=1)) / math.sqrt(n)
    if without_spread(values):
        return 0.0, math.nan if values.any() else 1.0
    return error, 2.0 * float(t.sf(abs(mean) / error, n - 1))


def _finding(data: PairedScores, adjusted: float, tests: int, level: float) -> StatisticalFinding:
    values = data.values
    n, mean = len(values), float(values.mean())
    error, p = _t_test(data)
    if math.isnan(p):
        exact = {"p_sign_flip": sign_flip_p(values, sign_patterns(n))}
        return replace(untestable(data), further=exact | {"rises": float((values > 0).sum())})
    reach = float(t.ppf((1.0 + level) / 2.0, n - 1)) * error
    exact = sign_flip_p(values, sign_patterns(n))
    up, down = int((values > 0).sum()), int((values < 0).sum())
    smallest = (
        detectable(n, test="t", contrasts=max(tests, 1), alpha=1.0 - level) * error * math.sqrt(n)
    )
    many = f"rises in {up}" if up >= down else f"falls in {down}"
    sentence = (
        f"{data.shown(mean)} over {persons(n)} "
        f"({data.shown_interval(mean - reach, mean + reach, level)}; {shown_p(p)}, "
        f"{shown_p(adjusted)} after Holm over {tests} tests; {many} of {n}, exact {shown_p(exact)})."
    )
    if not values.any():
        sentence = f"no difference in any of {persons(n)}."
    further = {"p_sign_flip": exact, "rises": float(up), "detectable": smallest}
    return StatisticalFinding(mean, mean - reach, mean + reach, p, 0.0, sentence, further)


def choices_table(effects: xr.Dataset) -> Table:
    """Tabulate the change with every level of every axis for every strategy, from `sensitivity`."""
    variable = str(effects.attrs["variable"])
    units, shown, factor, digits = TABLE_UNITS.get(variable, ("1", "1", 1.0, 2))
    if effects.attrs["scale"] == "Fisher z":
        units, shown, factor = "1", "1", 1.0
    columns = (
        Column("axis"), Column("level"), Column("strategy"),
        *(Column(name, units, shown, factor, digits) for name in ("change", "lower", "upper")),
        Column("p", digits=3), Column("p Holm", digits=3), Column("rises in"),
        Column("volunteers"), Column("pairs"),
    )  # fmt: skip
    rows: list[tuple[object, ...]] = []
    for index in range(effects.sizes["choice"]):
        one = effects.isel(choice=index)
        low, high = one["interval"].values.tolist()
        rises = float(one["rises"])
        rows.append(
            (
                *(str(one[name].values) for name in ("axis", "level", "strategy")),
                float(one["estimate"]), float(low), float(high), float(one["p"]),
                float(one["p_holm"]), "-" if math.isnan(rises) else int(rises), int(one["n"]),
                int(one["pairs"]),
            )
        )  # fmt: skip
    origin = str(effects.attrs["origin"])
    scale = " in Fisher's z" if effects.attrs["scale"] == "Fisher z" else ""
    return Table(
        f"change of {variable}{scale} with each choice, {recordings(origin)}",
        columns,
        tuple(rows),
        origin,
        f"Reference: {effects.attrs['reference']}. One choice is varied at a time. Paired t "
        f"test over volunteers, scope: {effects.attrs['scope']}; intervals are not adjusted, "
        f"'p Holm' is over all rows; neither is given with fewer than {LEAST_VOLUNTEERS} "
        "volunteers.",
    )


def _words(label: Any) -> str:
    """Format a level: a number without unnecessary digits, 50000 and not 50000.0."""
    return f"{label:g}" if isinstance(label, float) else str(label)


def _summary(result: xr.Dataset, first: PairedScores | None, alpha: float) -> str:
    """List the significant changes, and the smallest detectable change of the others."""
    variable = str(result.attrs["variable"])
    p, n = result["p_holm"].values, result["n"].values
    if first is None or not np.isfinite(p).any():
        most = int(n.max(initial=0))
        return (
            f"No test is performed: {persons(most)} with pairs, and a test of a choice "
            f"requires {LEAST_VOLUNTEERS} or more."
        )
    shown = np.isfinite(p) & (p <= alpha * (1 + 1e-9))
    change, rises = result["estimate"].values, result["rises"].values
    label = result["choice"].values

    def change_text(index: int) -> str:
        up = change[index] > 0
        many = int(rises[index]) if up else int(n[index] - rises[index])
        moved = "rises" if up else "falls"
        return f"{label[index]} ({first.shown(change[index])}, {moved} in {many} of {n[index]})"

    tests = int(np.isfinite(p).sum())
    order = np.argsort(-np.abs(change), kind="stable")
    parts: list[str] = []
    if shown.any():
        moving = names([change_text(k) for k in order if shown[k]], 100)
        parts.append(
            f"{variable} changes significantly, after Holm's correction over {tests} tests, with "
            f"{moving}."
        )
    alike = np.isfinite(p) & ~shown & (change != 0) & ((rises == 0) | (rises == n))
    if alike.any():
        parts.append(
            f"Of the same sign in all volunteers, but not significant after Holm's correction: "
            f"{names([change_text(k) for k in order if alike[k]], 100)}."
        )
    open_ = np.isfinite(p) & ~shown & (result["detectable"].values > 0)
    same = int((np.isfinite(p) & (change == 0) & ~open_).sum())
    if same:
        parts.append(f"{same} of the tests show no change in any volunteer.")
    if open_.any():
        seen = first.factor * result["detectable"].values[open_]
        low, high = float(seen.min()), float(seen.max())
        sizes = f"{low:.2g}" if math.isclose(low, high) else f"{low:.2g} to {high:.2g}"
        parts.append(
            f"The other {int(open_.sum())} changes are not significant, but may exist: the "
            "smallest change that such a study detects with a power of 0.8 is "
            f"{sizes}{first.unit}, by choice and strategy."
        )
    untested = int((~np.isfinite(p)).sum())
    if untested:
        parts.append(
            f"{untested} are not tested: too few volunteers, or no variation between them."
        )
    return " ".join(parts)
