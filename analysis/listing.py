"""List of the trials of a cube, and their numbers by status."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr

from analysis.cube import MARKER_DIMS, OF_INCISOR, PER_TRIAL, TRIAL_DIMS
from analysis.errors import CubeError
from analysis.flags import FLAGS
from analysis.trajectory import names
from analysis.typed import scored_values, status_of


def trials(cube: xr.Dataset) -> pd.DataFrame:
    """List every trial of a cube with its status.

    One row per trial: the labels, ``status``, ``reason``, ``median_rho``, ``n_defined`` and
    ``n_undefined`` markers (both 0 for a trial that is not ok), the values per trial, and the names
    of the ``flags`` that are raised.
    """
    stacked = cube.transpose(*MARKER_DIMS, ...)
    scored = scored_values(stacked)
    rho = scored["rho"].values.reshape(-1, stacked.sizes["marker"])
    table = pd.DataFrame(
        list(np.ndindex(*(stacked.sizes[dim] for dim in TRIAL_DIMS))), columns=list(TRIAL_DIMS)
    )
    for dim in TRIAL_DIMS:
        table[dim] = stacked[dim].values[table[dim].to_numpy()]
    table["status"] = status_of(stacked).values.ravel()
    table["reason"] = stacked["reason"].values.ravel().astype(str)
    defined = np.isfinite(rho).sum(axis=1)
    table["median_rho"] = [
        float(np.median(row[np.isfinite(row)])) if count else np.nan
        for row, count in zip(rho, defined, strict=True)
    ]
    table["n_defined"] = defined
    table["n_undefined"] = np.where(table["status"] == "ok", rho.shape[1] - defined, 0)
    for name in (*PER_TRIAL, *OF_INCISOR):
        if name in stacked:
            table[name] = (scored if name in OF_INCISOR else stacked)[name].values.ravel()
    raised = [name for name in FLAGS if name in table]
    table["flags"] = [
        ", ".join(name for name in raised if row[name] == 1.0)
        for row in table[raised].to_dict("records")
    ]
    return table


def counts(cube: xr.Dataset, *, by: Sequence[str] = ("strategy",)) -> pd.DataFrame:
    """Count the trials of a cube by status.

    Parameters
    ----------
    cube : xarray.Dataset
        Result of `build_cube`.
    by : sequence of str
        Trial dims to count over; empty for the whole study.

    Returns
    -------
    pandas.DataFrame
        Index `by`; columns ``trials``, ``ok``, ``failed``, ``excluded``, ``missing`` and, in
        markers, ``correlations`` (defined) and ``undefined``.

    Raises
    ------
    CubeError
        `by` contains a label that is not a trial dim.
    """
    wrong = [dim for dim in by if dim not in TRIAL_DIMS]
    if wrong:
        raise CubeError(f"cannot count trials by {names(wrong)}, expected {names([*TRIAL_DIMS])}")
    table = trials(cube)
    kind = table["status"].str.split(":").str[0]
    kinds = ("ok", "failed", "excluded", "missing")
    table = table.assign(trials=1, **{name: (kind == name).astype(int) for name in kinds})
    table = table.assign(correlations=table["n_defined"], undefined=table["n_undefined"])
    columns = ["trials", *kinds, "correlations", "undefined"]
    if not by:
        return table[columns].sum().to_frame().T
    return table.groupby(list(by), sort=False)[columns].sum()
