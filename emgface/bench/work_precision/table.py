"""The measurement as a table."""

import numpy as np
import pandas as pd
import xarray as xr

from emgface.bench.work_precision.measure import COUNTS


def table(found: xr.Dataset) -> pd.DataFrame:
    """One row per setting, the worst over the instructions, then one per model.

    ``error of`` tells rows of time stepping, measured against the same model in small steps, from rows
    of the discretisation, measured against the finest model.
    """
    worst = found.max("instruction", skipna=False)
    ok = (found["status"] == "ok").all("instruction").values
    settings = pd.DataFrame(
        {
            "error of": "time steps",
            "model": found["model_of"].values,
            "family": found["family"].values,
            "setting": found["label"].values,
            "run time s/s": worst["run_time"].values,
            "error rms mm": 1e3 * worst["error_rms"].values,
            "error max mm": 1e3 * worst["error_max"].values,
            "change of rho": worst["change_rho"].values,
            **{name: worst[name].values for name in COUNTS},
            "smallest J": found["smallest_J"].min("instruction").values,
            "Pareto": found["pareto"].values,
            "status": [
                _status(row, good) for row, good in zip(found["status"].values, ok, strict=True)
            ],
        }
    )
    models = pd.DataFrame(
        {
            "error of": "discretisation",
            "model": found["model"].values,
            "family": [f"{n} elements" for n in found["elements"].values],
            "setting": f"against {found.attrs['finest']}",
            "error rms mm": 1e3 * worst["difference_rms"].values,
            "error max mm": 1e3 * worst["difference_max"].values,
            "change of rho": worst["difference_rho"].values,
        }
    )
    return pd.concat([settings, models], ignore_index=True)


def _status(row: np.ndarray, good: bool) -> str:
    return "ok" if good else ", ".join(sorted({str(s) for s in row} - {"ok"}))


def requested_and_achieved(found: xr.Dataset) -> pd.DataFrame:
    """One row per error wanted, model and instruction: what error control made of it."""
    rows: list[dict[str, object]] = []
    for i in np.flatnonzero(np.isfinite(found["requested"].values)):
        for instruction in found["instruction"].values:
            one = found.isel(setting=int(i)).sel(instruction=instruction)
            requested, achieved = float(one["requested"]), float(one["error_max"])
            rows.append(
                {
                    "model": str(one["model_of"].values),
                    "instruction": str(instruction),
                    "requested mm": 1e3 * requested,
                    "achieved mm": 1e3 * achieved,
                    "achieved / requested": achieved / requested,
                    "steps": float(one["steps"]),
                    "rejected": float(one["rejected"]),
                    "run time s/s": float(one["run_time"]),
                    "status": str(one["status"].values),
                }
            )
    return pd.DataFrame(rows)
