"""Tables of flagged alignments and of the noise of markers."""

from typing import Any

import numpy as np
import xarray as xr

from analysis.flags import FLAGS
from analysis.scores import DROWNED
from analysis.tables import Column, Table, origin_of, recordings
from analysis.typed import selected, status_of


def alignment_tables(cube: xr.Dataset) -> dict[str, Table]:
    """Return the tables ``flags``, ``flagged`` and ``noise``, if the cube has their variables."""
    tables = {
        "flags": flag_table(cube),
        "flagged": flagged_table(cube),
        "noise": noise_table(cube),
    }
    return {name: table for name, table in tables.items() if table is not None}


def flag_table(cube: xr.Dataset) -> Table | None:
    """Count the scored trials with a flagged alignment, per flag and strategy.

    None if the cube contains no flags or no scored trial.
    """
    ok = status_of(cube) == "ok"
    flags = [name for name in FLAGS if name in cube]
    if not flags or not ok.any():
        return None
    strategies = [str(name) for name in cube["strategy"].values]
    rows: list[tuple[Any, ...]] = []
    for name in flags:
        raised = (cube[name] == 1.0) & ok
        counts = (int(selected(raised, {"strategy": one}).sum()) for one in strategies)
        rho = cube["rho"].where(raised).values
        rho = rho[np.isfinite(rho)]
        median = float(np.median(rho)) if rho.size else float("nan")
        rows.append((name, *counts, median, FLAGS[name]))
    columns = tuple(Column(name) for name in ("flag", *strategies, "median_rho", "meaning"))
    origin = origin_of(cube)
    note = (
        f"Number of trials with a flag among {int(ok.sum())} scored trials, per strategy. "
        "These trials remain in the scores; the table of all trials lists their flags."
    )
    return Table(f"flagged alignments, {recordings(origin)}", columns, tuple(rows), origin, note)


def flagged_table(cube: xr.Dataset) -> Table | None:
    """Tabulate the median rho per strategy with and without the trials that have any flag.

    None if the cube contains no flags or no scored trial.
    """
    ok = status_of(cube) == "ok"
    flags = [name for name in FLAGS if name in cube]
    if not flags or not ok.any():
        return None
    raised = sum(((cube[name] == 1.0) for name in flags), start=xr.zeros_like(ok)) > 0
    rows: list[tuple[Any, ...]] = []
    for strategy in cube["strategy"].values:
        row: list[Any] = [str(strategy)]
        for mask in (ok, ok & ~raised, ok & raised):
            one = {"strategy": strategy}
            rho = selected(cube["rho"].where(mask), one).values
            rho = rho[np.isfinite(rho)]
            row += [int(selected(mask, one).sum()), float(np.median(rho)) if rho.size else np.nan]
        rows.append(tuple(row))
    heads = ("trials", "median_rho", "without_flag", "median_without_flag", "with_flag",
             "median_with_flag")  # fmt: skip
    columns = (Column("strategy"), *(Column(head) for head in heads))
    origin = origin_of(cube)
    note = (
        "Scored trials and the median of their rho over trials and markers: all of them, those without "
        "any flag, and those with at least one. Statistics include all scored trials."
    )
    title = f"rho with and without flagged trials, {recordings(origin)}"
    return Table(title, columns, tuple(rows), origin, note)


def noise_table(cube: xr.Dataset) -> Table | None:
    """Tabulate the noise of each marker and the expected attenuation of rho.

    Median noise [m], median and 5 % quantile of the attenuation [1], and number of trials in which
    the marker does not move beyond its noise. None if no noise is known.
    """
    if "noise" not in cube or not np.isfinite(cube["noise"].values).any():
        return None
    rows: list[tuple[Any, ...]] = []
    for marker in cube["marker"].values:
        one = selected(cube, {"marker": marker})
        factor = one["attenuation"].values[np.isfinite(one["attenuation"].values)]
        middle, low = np.quantile(factor, [0.5, 0.05]) if factor.size else (np.nan, np.nan)
        drowned = int((one["marker_reason"] == DROWNED).sum())
        rows.append(
            (str(marker), float(np.nanmedian(one["noise"])), float(middle), float(low), drowned)
        )
    columns = (
        Column("marker"),
        Column("noise", "m", "mm", 1e3, 3),
        Column("attenuation", "1", "1", 1.0, 3),
        Column("attenuation_5_percent", "1", "1", 1.0, 3),
        Column("no_more_than_noise"),
    )
    origin = origin_of(cube)
    note = (
        "Medians over trials of the noise (root mean square over three axes) and of the "
        "factor sqrt(S / (S + N)) by which it is expected to lower rho, which is not "
        "corrected; 5 % quantile of this factor; and number of trials in which the motion "
        "of the marker does not exceed the noise, so that rho is undefined."
    )
    return Table(f"noise of the markers, {recordings(origin)}", columns, tuple(rows), origin, note)
