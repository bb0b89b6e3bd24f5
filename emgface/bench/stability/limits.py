"""Where each scheme's limit lies: over every sweep, what it holds and what stops it."""

import pandas as pd
import xarray as xr


def limits(found: xr.Dataset) -> pd.DataFrame:
    """One row per sweep, one column per integrator.

    Parameters
    ----------
    found : Dataset
        Of `run_battery`.

    Returns
    -------
    DataFrame
        Columns ``row``, ``parameter``, ``swept`` and the integrators: "all", or the values that went
        well and, in brackets, what came at the others; "" where a scheme was not run. Refusals that
        are the right answer count as well.
    """
    table = found.to_dataframe()
    swept = table[table["parameter"] != ""]
    if swept.empty:
        return pd.DataFrame(columns=["row", "parameter", "swept"])
    methods = list(dict.fromkeys(swept["integrator"]))
    rows: list[dict[str, object]] = []
    for key, of in swept.groupby(["row", "parameter"], sort=False):
        row, parameter = key if isinstance(key, tuple) else (key, "")
        values = sorted(set(of["value"]))
        line: dict[str, object] = {"row": row, "parameter": parameter, "swept": _span(values)}
        for method in methods:
            line[method] = _limit(of[of["integrator"] == method])
        rows.append(line)
    return pd.DataFrame(rows).sort_values("row", kind="stable").reset_index(drop=True)


def _limit(of: pd.DataFrame) -> str:
    if of.empty:
        return ""
    good = (of["outcome"] == "ok") | of["expected"].astype(bool)
    if good.all():
        return "all"
    stops = [str(o).removeprefix("refused: ") for o in dict.fromkeys(of["outcome"][~good])]
    held = _span(sorted(of["value"][good])) if good.any() else "none"
    return f"{held} ({', '.join(stops)})"


def _span(values: list[float]) -> str:
    if len(values) == 1:
        return f"{values[0]:g}"
    return f"{values[0]:g} ... {values[-1]:g}"
