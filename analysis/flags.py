"""What an alignment says of itself that a reader of its scores must know."""

from typing import Final

import numpy as np
import pandas as pd
import xarray as xr

from analysis.typed import selected

FLAGS: Final = {
    "sign_disagrees": "direction and correlation of the components call for different signs",
    "shift_at_bound": "the best shift lies at, or is hidden by, the bound of what is allowed",
    "scale_at_bound": "the stretch lies at the end of the allowed range, or outside it",
    "little_overlap": "less of the simulated time was measured than must overlap",
    "weak_match": "the aligned components share less than half of their variance",
}
"""Variables that are 1 where a trial is flagged, and what that says."""


def flags_of(trial: xr.Dataset) -> list[str]:
    """Name the flags that are raised in the scores or the alignment of one trial."""
    return [name for name in FLAGS if name in trial and float(trial[name]) == 1.0]


def flag_table(cube: xr.Dataset) -> pd.DataFrame:
    """Count the scored trials that each flag is raised in.

    Parameters
    ----------
    cube : xarray.Dataset
        Result of `analysis.cube.build_cube`.

    Returns
    -------
    pandas.DataFrame
        One row per flag that the cube holds, its name as index; columns ``meaning``, one count
        per strategy, ``trials`` (flagged, all strategies) and ``median_rho`` of these trials.
    """
    rows: dict[str, dict[str, object]] = {}
    for name, meaning in FLAGS.items():
        if name not in cube:
            continue
        raised = (cube[name] == 1.0) & (cube["status"] == "ok")
        per = {
            str(strategy): int(selected(raised, {"strategy": strategy}).sum())
            for strategy in cube["strategy"].values
        }
        rho = cube["rho"].where(raised).values
        rho = rho[np.isfinite(rho)]
        median = float(np.median(rho)) if rho.size else float("nan")
        rows[name] = {"meaning": meaning, **per, "trials": int(raised.sum()), "median_rho": median}
    return pd.DataFrame.from_dict(rows, orient="index")
