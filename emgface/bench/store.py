"""What a measurement leaves behind: a netCDF file, a table (CSV) and a figure."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pandas as pd
import xarray as xr

from analysis.figures import (
    cost_of_parts,
    error_control,
    first_results,
    growth,
    opening_over_time,
    save,
    work_precision,
)
from emgface.bench.contact import contact_table
from emgface.bench.stability.limits import limits
from emgface.bench.stability.shown import limits_figure, stability_figure, stability_frame
from emgface.bench.start import table as start_table
from emgface.bench.work_precision.table import requested_and_achieved
from emgface.bench.work_precision.table import table as work_precision_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def work_precision_figure(found: xr.Dataset) -> "Figure":
    """Errors of time stepping and of the discretisation."""
    return work_precision(found, title=found.attrs["face"])


def contact_figure(found: xr.Dataset) -> "Figure":
    """Opening of the lips over time."""
    return opening_over_time(found, title=f"{found.attrs['face']} (simulated)")


def error_control_figure(found: xr.Dataset) -> "Figure":
    """Error achieved against error requested."""
    return error_control(found, title=found.attrs["face"])


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


Table = Callable[[xr.Dataset], pd.DataFrame]
Draw = Callable[[xr.Dataset], "Figure"]

KINDS: Final[dict[str, tuple[Table, Draw]]] = {
    "work-precision": (work_precision_table, work_precision_figure),
    "stability": (stability_frame, stability_figure),
    "cost": (cost_table, cost_of_parts),
    "scaling": (growth_table, growth),
    "contact": (contact_table, contact_figure),
    "start": (start_table, first_results),
}
"""Table and figure of every kind of measurement."""
FURTHER: Final[dict[str, dict[str, tuple[Table, Draw]]]] = {
    "work-precision": {"error-control": (requested_and_achieved, error_control_figure)},
    "stability": {"stability-limits": (limits, limits_figure)},
}
"""What more is told of a kind, by the name of its files."""


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
    paths = [folder / f"{kind}.nc"]
    found.to_netcdf(paths[0])
    for name, (make_table, draw) in {kind: KINDS[kind], **FURTHER.get(kind, {})}.items():
        table = make_table(found)
        if table.empty:  # no sweep has no limits, no error control no request
            continue
        own = [folder / f"{name}{ending}" for ending in (".csv", ".svg", ".png")]
        table.to_csv(own[0], index=False)
        figure = draw(found)
        for path in own[1:]:
            save(figure, path)
        paths += own
    return KINDS[kind][0](found), paths
