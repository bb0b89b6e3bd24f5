"""Tables of datasets, for commands."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from analysis.tables import Table
from emgface.cli.console import Rows, frame

if TYPE_CHECKING:
    import pandas as pd


def activation_rows(activation: xr.Dataset) -> Rows:
    """List mean and peak activation per muscle, left and right."""
    values = activation["activation"]
    head = ("muscle", "mean left", "mean right", "peak left", "peak right")
    rows = []
    for name in dict.fromkeys(str(m).rsplit("_", 1)[0] for m in values["muscle"].values):
        sides = [values.sel(muscle=f"{name}_{side}") for side in "LR"]
        numbers = [float(s.mean()) for s in sides] + [float(s.max()) for s in sides]
        rows.append((name, *(f"{number:.2f}" for number in numbers)))
    return Rows(head, tuple(rows))


def score_rows(scores: xr.Dataset) -> Rows:
    """List the scores of every marker."""
    head = ("marker", "rho", "amplitude ratio", "rmse [mm]", "reason")
    rows = [
        (
            str(marker),
            f"{float(s['rho']):.3f}",
            f"{float(s['amplitude_ratio']):.2f}",
            f"{1e3 * float(s['rmse']):.2f}",
            str(s["reason"].item()),
        )
        for marker in scores["marker"].values
        for s in [scores.sel(marker=marker)]
    ]
    rows.append(("median", f"{float(np.nanmedian(scores['rho'])):.3f}", "", "", ""))
    return Rows(head, tuple(rows))


def rows_of(table: "Table | pd.DataFrame", title: str) -> tuple[Rows, str]:
    """Cells and title of a table of the analysis, or of a data frame."""
    if not isinstance(table, Table):
        return frame(table), title
    heads = tuple(column.head() for column in table.columns)
    rows = (zip(table.columns, row, strict=True) for row in table.rows)
    cells = tuple(tuple(column.cell(value) for column, value in row) for row in rows)
    return Rows(heads, cells), table.title
