"""All tests of a study, their conclusions and their table."""

import math
from collections.abc import Mapping

import numpy as np
import xarray as xr

from analysis.statistics.bootstrap import hierarchical_bootstrap
from analysis.statistics.equivalence import equivalence
from analysis.statistics.finding import persons, shown_p
from analysis.statistics.leave_one_out import leave_one_volunteer_out
from analysis.statistics.mixed_model import mixed_model
from analysis.statistics.paired import WHY, compare
from analysis.statistics.power import detectable
from analysis.statistics.ranks import MOST_EXACT_RANKS, friedman, wilcoxon
from analysis.statistics.scope import LEAST_VOLUNTEERS
from analysis.statistics.sign_flip import MOST_EXACT_SIGNS, sign_flip
from analysis.tables import TABLE_UNITS, Column, Table, recordings


def study_statistics(
    cube: xr.Dataset,
    *,
    variable: str = "rho",
    margin: float | None = None,
    level: float = 0.95,
    draws: int = 2000,
    seed: int = 0,
) -> dict[str, xr.Dataset]:
    """Apply every test to a cube.

    Parameters
    ----------
    cube : xarray.Dataset
        Result of `analysis.cube.build_cube`.
    variable : str
        ``"rho"``, ``"amplitude_ratio"`` or ``"rmse"``.
    margin : float, optional
        Of equivalence, on the scale of the analysis; by default equivalence is not tested.
    level : float
        Of the intervals.
    draws, seed : int
        Number of bootstrap samples, and the seed of all draws.

    Returns
    -------
    dict of str to xarray.Dataset
        ``sign_flip``, ``mixed_model`` of instructions in general and
        ``mixed_model_these_instructions``, ``friedman``, ``wilcoxon``, ``bootstrap``,
        ``leave_one_out`` and, with a margin, ``equivalence``.

    Raises
    ------
    StatisticsError
        Unknown variable, further dims, or an option outside its range.
    """
    data = compare(cube, variable=variable)
    # The bootstrap estimates effects in units of the variable.
    raw = compare(cube, variable=variable, scale="raw")
    results = {
        "sign_flip": sign_flip(data, level=level, seed=seed),
        "mixed_model": mixed_model(data, level=level),
        "mixed_model_these_instructions": mixed_model(
            data, scope="these instructions", level=level
        ),
        "friedman": friedman(data),
        "wilcoxon": wilcoxon(data, level=level),
        "bootstrap": hierarchical_bootstrap(raw, level=level, draws=draws, seed=seed),
        "leave_one_out": leave_one_volunteer_out(data),
    }
    if margin is not None:
        results["equivalence"] = equivalence(data, margin=margin)
    return results


def conclusions(statistics: Mapping[str, xr.Dataset], *, together: bool = False) -> list[str]:
    """State for every contrast whether the difference is significant, and for which scope.

    One or two sentences per contrast of the result of `study_statistics`; with `together`, a second
    sentence that several contrasts share, which is on instructions in general, is a text of its own
    after those of the contrasts. A difference is significant for the instructions of the study if the
    sign-flip p over all contrasts jointly is at most 1 - level, and for instructions in general if that
    of the mixed model is, after Holm's correction. Otherwise the smallest detectable difference is
    stated.
    """
    exact = statistics["sign_flip"]
    alpha = 1.0 - float(exact.attrs["level"])
    variable, origin = str(exact.attrs["variable"]), str(exact.attrs["origin"])
    tested = int((exact["n"].values > 1).sum())
    sentences: list[str] = []
    general: dict[
        str, list[int]
    ] = {}  # of a sentence, the places in `sentences` that it belongs to
    for index, contrast in enumerate(exact["contrast"].values):
        row = exact.isel(contrast=index)
        p, least, n = float(row["p_joint"]), float(row["smallest_p"]), int(row["n"])
        if math.isnan(p) or n < 2:
            sentences.append(f"{contrast}: {persons(n)} with pairs; no test is performed.")
            continue
        if p <= alpha * (1 + 1e-9):
            higher = "higher" if float(row["estimate"]) > 0 else "lower"
            text = (
                f"{variable} is {higher} with the first strategy for the instructions of this study "
                f"({shown_p(p)} jointly, {persons(n)}, {recordings(origin)})."
            )
        elif least > alpha:
            text = (
                f"with {persons(n)}, p cannot fall below {least:.2g}, so that the exact test "
                "cannot show a difference."
            )
        else:
            text = (
                f"no significant difference in {variable} ({shown_p(p)} jointly, "
                f"{persons(n)}); a difference may exist: {_smallest_seen(row, alpha, tested)}."
            )
        sentences.append(f"{contrast}: {text}")
        second = _in_general(statistics["mixed_model"].isel(contrast=index), alpha)
        general.setdefault(second, []).append(len(sentences) - 1)
    every = exact["contrast"].values.tolist()
    for second, places in general.items():
        if together and len(places) > 1:
            shared = [sentences[k].partition(":")[0] for k in places]
            sentences.append(second if shared == every else f"{', '.join(shared)}: {second}")
        else:
            for k in places:
                sentences[k] += f" {second}"
    return sentences or [str(exact.attrs["sentence"])]


def _smallest_seen(row: xr.Dataset, alpha: float, tested: int) -> str:
    """State the difference that the exact test over `tested` contrasts detects with a power of 0.8."""
    spread = float(row["standard_deviation"])
    if spread == 0.0:
        return (
            "the volunteers do not differ, so that no smallest detectable difference can be stated"
        )
    size = detectable(int(row["n"]), test="sign_flip", contrasts=tested, alpha=alpha) * spread
    variable, scale = str(row.attrs["variable"]), str(row.attrs["scale"])
    _, unit, factor, _ = TABLE_UNITS.get(variable, ("1", "1", 1.0, 2))
    unit = " in z" if scale == "Fisher z" else "" if unit == "1" else f" {unit}"
    return (
        "with the spread between these volunteers, the smallest difference that such a "
        f"study detects with a power of 0.8 is {factor * size:.2g}{unit}"
    )


def _in_general(row: xr.Dataset, alpha: float) -> str:
    """State the result of the mixed model for instructions in general."""
    p = float(row["p_holm"])
    if math.isnan(p):
        reason = str(row["reason"].values)
        return f"No statement is made about instructions in general: {reason}."
    if p > alpha:
        return (
            "For instructions in general, the difference is not significant (mixed model, "
            f"{shown_p(p)} after Holm's correction)."
        )
    higher = "higher" if float(row["estimate"]) > 0 else "lower"
    return (
        f"For instructions in general, it is {higher} with the first strategy (mixed model, "
        f"{shown_p(p)} after Holm's correction)."
    )


def statistics_table(statistics: Mapping[str, xr.Dataset]) -> Table:
    """Tabulate estimate, interval and p of every test and contrast of `study_statistics`.

    The column ``in`` contains the unit of the estimate.
    """
    columns = (
        Column("test"), Column("instructions"), Column("contrast"), Column("in"),
        Column("estimate"), Column("lower"),
        Column("upper"), Column("standard deviation"), Column("p", digits=3),
        Column("p Holm", digits=3), Column("p joint", digits=3), Column("smallest p", digits=3),
        Column("volunteers"), Column("pairs"), Column("pairs lost"),
    )  # fmt: skip
    rows: list[tuple[object, ...]] = []
    for name, each in statistics.items():
        variable = str(each.attrs["variable"])
        _, unit, factor, _ = TABLE_UNITS.get(variable, ("1", "1", 1.0, 2))
        if each.attrs["scale"] == "Fisher z":
            unit = "z"
        if name == "friedman":
            unit, factor = "Kendall's W", 1.0
        unit = variable if unit == "1" else unit
        scope = "in general" if name == "mixed_model" else "these"
        for index, contrast in enumerate(each["contrast"].values):
            row = each.isel(contrast=index)
            bounds = np.asarray(row["interval"].values, dtype=np.float64) * factor
            joint = float(row["p_joint"]) if "p_joint" in row else math.nan
            gone = sum(int(row[f"lost_{why}"]) for why in WHY)
            numbers = [float(row["estimate"]) * factor, float(bounds[0]), float(bounds[1])]
            spread = float(row["standard_deviation"]) if "standard_deviation" in row else math.nan
            numbers += [spread * factor, float(row["p"]), float(row["p_holm"]), joint]
            numbers += [float(row["smallest_p"])]
            counts = (int(row["n"]), int(row["pairs"]), gone)
            test = name.replace("_these_instructions", "").replace("_", " ")
            rows.append((test, scope, str(contrast), unit, *numbers, *counts))
    first = next(iter(statistics.values()))
    origin = str(first.attrs["origin"])
    note = (
        "All tests apply to volunteers in general; the column instructions states if they "
        "apply to the instructions of the study or to instructions in general. Sign flips "
        f"and Wilcoxon are exact (up to {MOST_EXACT_SIGNS} and {MOST_EXACT_RANKS} volunteers); "
        "the mixed model uses t; the p of equivalence is small if "
        "strategies are equivalent; the bounds of leave one out are the extreme estimates. "
        "Standard deviation: of the differences between volunteers. "
        f"No interval is given with fewer than {LEAST_VOLUNTEERS} volunteers."
    )
    title = f"tests of {first.attrs['variable']}, {recordings(origin)}"
    return Table(title, columns, tuple(rows), origin, note)
