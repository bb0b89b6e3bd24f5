"""Stability battery: twelve rows of extreme cases, each simulated with every suitable integrator.

Rows 3, 4, 9 and 11 require a face, that of --face or the coarse template. Prints, for every
parameter that is varied, the range in which each integrator succeeds and the errors outside it;
fails if a wrong result occurred without an error. The folder of --out receives a table of all runs.
"""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import pandas as pd
import xarray as xr

from benchmarks.report import face_of, finish, say
from benchmarks.stability.face_rows import face_trials
from benchmarks.stability.input_rows import bad_input
from benchmarks.stability.material_rows import bulk_moduli, masses, slivers, stiff_layers
from benchmarks.stability.motion_rows import (
    TURNING,
    bad_starts,
    gravity_and_rotation,
    jumps,
    quiet,
    time_steps,
    turned,
)
from benchmarks.stability.rigid_rows import rigid
from benchmarks.stability.trial import Outcome, run

BLOCK_ROWS = (
    bulk_moduli, stiff_layers, time_steps, jumps, bad_starts, gravity_and_rotation, slivers, masses,
    bad_input, quiet, rigid,
)  # fmt: skip
"""Functions of the rows on small bodies."""


def run_battery(
    face: xr.Dataset | None = None, *, rows: Sequence[int] | None = None
) -> pd.DataFrame:
    """Run the battery, or some of its `rows`; rows on a face are omitted without one.

    The table has one row per run, with the attributes of `benchmarks.stability.trial.Outcome`.
    """
    trials = [trial for make in BLOCK_ROWS for trial in make()]
    if face is not None:
        trials += face_trials(face)
    outcomes: list[Outcome] = []
    for trial in trials:
        if rows is None or trial.row in rows:
            say(f"{trial.row}. {trial.title}: {trial.case}")
            outcomes += [run(trial, name) for name in trial.integrators]
    if rows is None or 6 in rows:
        wrong = turned(1000)
        outcome = f"WRONG: {wrong}" if wrong else "ok"
        outcomes.append(Outcome(6, TURNING, "1000 turns", "", float("nan"), "any", outcome))
    return pd.DataFrame(map(asdict, sorted(outcomes, key=lambda o: o.row)))


def limits(results: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the result of `run_battery`, one row per varied parameter, one column per integrator.

    A cell is "all", or the range of values that succeeded and, in brackets, the errors at the
    others; "" if a scheme was not run. Expected refusals count as success.
    """
    swept = results[results["parameter"] != ""]
    if swept.empty:
        return pd.DataFrame(columns=["row", "parameter", "swept"])
    methods = list(dict.fromkeys(swept["integrator"]))
    rows: list[dict[str, object]] = []
    for key, group in swept.groupby(["row", "parameter"], sort=False):
        row, parameter = key if isinstance(key, tuple) else (key, "")
        values = sorted(set(group["value"]))
        line: dict[str, object] = {"row": row, "parameter": parameter, "swept": _span(values)}
        for method in methods:
            line[method] = _limit(group[group["integrator"] == method])
        rows.append(line)
    return pd.DataFrame(rows).sort_values("row", kind="stable").reset_index(drop=True)


def _limit(group: pd.DataFrame) -> str:
    if group.empty:
        return ""
    good = (group["outcome"] == "ok") | group["expected"].astype(bool)
    if good.all():
        return "all"
    stops = [str(o).removeprefix("refused: ") for o in dict.fromkeys(group["outcome"][~good])]
    span = _span(sorted(group["value"][good])) if good.any() else "none"
    return f"{span} ({', '.join(stops)})"


def _span(values: list[float]) -> str:
    if len(values) == 1:
        return f"{values[0]:g}"
    return f"{values[0]:g} ... {values[-1]:g}"


def main(out: Path = Path("bench"), face: Path | None = None, row: list[int] | None = None) -> None:
    """Run the battery, print the limits, and fail on wrong answers."""
    results = run_battery(face_of(face), rows=row)
    finish("stability", results, out)
    finish("stability-limits", limits(results), out)
    wrong = int(results["outcome"].str.startswith("WRONG").sum())
    if wrong:
        raise SystemExit(f"{wrong} wrong answers came without an error")
