"""The battery as tables and figures."""

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from analysis.figures import limits_table, stability_table
from emgface.bench.stability.limits import limits

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def stability_frame(found: xr.Dataset) -> pd.DataFrame:
    """One row per run."""
    return found.to_dataframe().reset_index(drop=True)


def stability_figure(found: xr.Dataset) -> "Figure":
    """Which integrator stands which case."""
    table = stability_frame(found)
    keys = list(dict.fromkeys(zip(table["row"], table["title"], table["case"], strict=True)))
    methods = list(dict.fromkeys(table["integrator"]))
    status = np.full((len(keys), len(methods)), "", dtype=object)
    for r in table.to_dict("records"):
        where = keys.index((r["row"], r["title"], r["case"])), methods.index(r["integrator"])
        outcome = str(r["outcome"])
        if outcome.startswith("refused: "):
            kind = "ok" if r["expected"] else "failed"
            outcome = f"{kind}:{outcome.removeprefix('refused: ')}"
        elif outcome.startswith("WRONG: "):
            outcome = "wrong:" + outcome.removeprefix("WRONG: ").replace(":", ",")
        status[where] = outcome
    drawn = xr.Dataset(
        {"status": (("case", "method"), status.astype(str))},
        coords={
            "case": [case for _, _, case in keys],
            "group": ("case", [f"{row}. {title}" for row, title, _ in keys]),
            "method": methods,
        },
    )
    return stability_table(drawn, title=_title("stability battery", found))


def limits_figure(found: xr.Dataset) -> "Figure":
    """Where the limit of each integrator lies."""
    table = limits(found)
    methods = [str(c) for c in table.columns[3:]]
    titles = dict(zip(found["row"].values.tolist(), found["title"].values.tolist(), strict=True))
    drawn = xr.Dataset(
        {"limit": (("case", "method"), table[methods].to_numpy(dtype=str))},
        coords={
            "case": [f"{p}: {s}" for p, s in zip(table["parameter"], table["swept"], strict=True)],
            "group": ("case", [f"{row}. {titles[row]}" for row in table["row"]]),
            "method": methods,
        },
    )
    return limits_table(drawn, title=_title("what each integrator holds", found))


def _title(text: str, found: xr.Dataset) -> str:
    face = str(found.attrs.get("face", ""))
    return f"{text}, {face}" if face else text
