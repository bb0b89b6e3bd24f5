"""What a measurement leaves behind: a netCDF file, a table (CSV) and a figure."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from analysis.figures import cost_of_parts, growth, save, stability_table, work_precision
from emgface.bench.work_precision.table import table as work_precision_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def work_precision_figure(found: xr.Dataset) -> "Figure":
    """Errors of time stepping and of the discretisation."""
    return work_precision(found, title=found.attrs["face"])


def stability_frame(found: xr.Dataset) -> pd.DataFrame:
    """One row per run."""
    return found.to_dataframe().reset_index(drop=True)


def stability_figure(found: xr.Dataset) -> "Figure":
    """Which integrator stands which case."""
    table = stability_frame(found)
    cases = list(
        dict.fromkeys(f"{r}. {t}: {c}" for r, t, c in table[["row", "title", "case"]].values)
    )
    methods = list(dict.fromkeys(table["integrator"]))
    status = np.full((len(cases), len(methods)), "", dtype=object)
    for r in table.to_dict("records"):
        where = (
            cases.index(f"{r['row']}. {r['title']}: {r['case']}"),
            methods.index(r["integrator"]),
        )
        outcome = str(r["outcome"])
        if outcome.startswith("refused: "):
            kind = "ok" if r["expected"] else "failed"
            outcome = f"{kind}:{outcome.removeprefix('refused: ')}"
        elif outcome.startswith("WRONG: "):
            outcome = "wrong:" + outcome.removeprefix("WRONG: ").replace(":", ",")
        status[where] = outcome
    drawn = xr.Dataset(
        {"status": (("case", "method"), status.astype(str))},
        coords={"case": cases, "method": methods},
    )
    return stability_table(drawn, title="stability battery")


def growth_table(found: xr.Dataset) -> pd.DataFrame:
    """One row per mesh with milliseconds per phase, and a last row with the exponents."""
    table = (1e3 * found["seconds"].to_pandas()).add_suffix(" ms")
    table.insert(0, "elements", found["elements"].values)
    table["factor MB"] = found["factor_bytes"].values / 1e6
    exponents = {f"{p} ms": float(found["exponent"].sel(phase=p)) for p in found["phase"].values}
    last = {"elements": "exponent", **exponents, "factor MB": float(found["factor_exponent"])}
    return pd.concat([table.astype(object), pd.DataFrame([last])], ignore_index=True)


def cost_table(found: xr.Dataset) -> pd.DataFrame:
    """One row per scene: milliseconds per phase, and what it costs more than the tissue alone."""
    table = (1e3 * found["seconds"].to_pandas()).add_suffix(" ms")
    table.insert(0, "scene", found["scene"].values)
    for phase in ("force", "tangent", "step"):
        table[f"{phase} - alone ms"] = table[f"{phase} ms"] - table[f"{phase} ms"].iloc[0]
    table["spread ms"] = 1e3 * found["spread"].values
    table["step U"] = found["seconds"].sel(phase="step").values / found.attrs["unit_s"]
    table["nonzeros"] = found["nonzeros"].values
    return table.reset_index(drop=True)


KINDS: dict[str, tuple[Callable[[xr.Dataset], pd.DataFrame], Callable[[xr.Dataset], "Figure"]]] = {
    "work-precision": (work_precision_table, work_precision_figure),
    "stability": (stability_frame, stability_figure),
    "cost": (cost_table, cost_of_parts),
    "scaling": (growth_table, growth),
}
"""Table and figure of every kind of measurement."""


def store(kind: str, found: xr.Dataset, folder: Path) -> tuple[pd.DataFrame, list[Path]]:
    """Write netCDF, CSV and figure into a folder.

    Parameters
    ----------
    kind : str
        A key of `KINDS`.
    found : Dataset
        The measurement.
    folder : Path
        Made if absent.

    Returns
    -------
    table : DataFrame
    paths : list of Path
    """
    folder.mkdir(parents=True, exist_ok=True)
    make_table, draw = KINDS[kind]
    table = make_table(found)
    paths = [folder / f"{kind}{ending}" for ending in (".nc", ".csv", ".svg", ".png")]
    found.to_netcdf(paths[0])
    table.to_csv(paths[1], index=False)
    figure = draw(found)
    for path in paths[2:]:
        save(figure, path)
    return table, paths
