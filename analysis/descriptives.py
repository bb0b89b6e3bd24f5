"""Medians, means and standard deviations of a cube, with counts of missing values."""

import warnings
from collections.abc import Sequence

import numpy as np
import xarray as xr

from analysis.cube import MARKER_DIMS
from analysis.errors import CubeError
from analysis.trajectory import names
from analysis.typed import status_of


def mean_defined(data: xr.DataArray) -> float:
    """Mean of the finite values; NaN if there is none."""
    values = data.values[np.isfinite(data.values)]
    return float(values.mean()) if len(values) else np.nan


def descriptives(
    cube: xr.Dataset, *, by: Sequence[str] = ("strategy",), variable: str = "rho"
) -> xr.Dataset:
    """Describe a variable of a cube in groups.

    Parameters
    ----------
    cube : xarray.Dataset
        Result of `build_cube`.
    by : sequence of str
        Dims of the cube; empty for one group.
    variable : str
        ``"rho"``, ``"amplitude_ratio"``, ``"rmse"`` or a variable per trial.

    Returns
    -------
    xarray.Dataset
        Dims `by`: ``median``, ``mean`` and ``standard_deviation`` (divided by n - 1), in the unit
        of the variable; ``n`` values, and the numbers of those omitted, ``n_undefined``,
        ``n_failed``, ``n_excluded`` and ``n_missing`` (one per marker). The five counts sum to the
        group's size.

    Raises
    ------
    CubeError
        Unknown dim or variable, or a variable that lacks a dim of `by`.

    Notes
    -----
    Source: Eskes et al. 2017, Results and Fig. 6. Values of one volunteer are not independent;
    n counts values, not volunteers.
    """
    if variable not in cube or cube[variable].dtype.kind not in "fiu":
        known = [str(name) for name, data in cube.data_vars.items() if data.dtype.kind in "fiu"]
        raise CubeError(f"cannot describe {variable!r}, expected one of {names(known, most=20)}")
    data = cube[variable]
    wrong = [dim for dim in by if dim not in data.dims]
    if wrong or len(set(by)) != len(by):
        allowed = [dim for dim in MARKER_DIMS if dim in data.dims]
        raise CubeError(f"cannot group {variable} by {names([*by])}, expected {names(allowed, 5)}")
    status, data = xr.broadcast(status_of(cube), data)
    rest = [dim for dim in data.dims if dim not in by]
    shape = (*(data.sizes[dim] for dim in by), -1)
    values = data.transpose(*by, *rest).values.astype(np.float64).reshape(shape)
    kind = status.transpose(*by, *rest).values.reshape(shape)
    ok, missing, excluded = kind == "ok", kind == "missing", kind == "excluded"
    defined = ok & np.isfinite(values)
    kept = np.where(defined, values, np.nan)
    with warnings.catch_warnings():  # the statistics of an empty group are NaN
        warnings.simplefilter("ignore", RuntimeWarning)
        statistics = {
            "median": np.nanmedian(kept, axis=-1),
            "mean": np.nanmean(kept, axis=-1),
            "standard_deviation": np.nanstd(kept, axis=-1, ddof=1),
        }
    units = {"units": str(data.attrs.get("units", "1"))}
    result = xr.Dataset(
        {name: (tuple(by), statistic, units) for name, statistic in statistics.items()},
        coords={dim: cube[dim] for dim in by},
    )
    for name, mask in (
        ("n", defined),
        ("n_undefined", ok & ~np.isfinite(values)),
        ("n_failed", ~ok & ~missing & ~excluded),
        ("n_excluded", excluded),
        ("n_missing", missing),
    ):
        result[name] = (tuple(by), mask.sum(axis=-1), {"units": "1"})
    result.attrs = {
        "variable": variable,
        "origin": cube.attrs["origin"],
        "method": "over all values of a group; standard deviation with n - 1",
    }
    return result
