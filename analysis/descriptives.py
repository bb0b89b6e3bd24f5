"""Medians, means and standard deviations of a cube, with counts of missing values."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from analysis.cube import MARKER_DIMS
from analysis.errors import CubeError
from analysis.trajectory import names
from analysis.typed import texts


def descriptives(
    cube: xr.Dataset, *, by: Sequence[str] = ("strategy",), variable: str = "rho"
) -> xr.Dataset:
    """Describe a variable of a cube in groups.

    Parameters
    ----------
    cube : xarray.Dataset
        Result of `analysis.cube.build_cube`.
    by : sequence of str
        Any of the dims volunteer, instruction, repetition, strategy, marker; empty for one group.
    variable : str
        ``"rho"``, ``"amplitude_ratio"``, ``"rmse"`` or a variable per trial.

    Returns
    -------
    xarray.Dataset
        Dims `by`: ``median``, ``mean`` and ``standard_deviation`` (divided by n - 1; NaN for
        n = 1) in the unit of the variable; ``n`` values described, and those left out,
        ``n_undefined`` (trial ok, value undefined), ``n_failed``, ``n_excluded`` and ``n_missing``
        (one per marker of such a trial). The five counts sum to the size of the group.

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
    status, data = xr.broadcast(texts(cube["status"]), data)
    rest = [dim for dim in data.dims if dim not in by]
    shape = tuple(data.sizes[dim] for dim in by)
    values = data.transpose(*by, *rest).values.astype(np.float64).reshape(*shape, -1)
    kind = status.transpose(*by, *rest).values.reshape(*shape, -1)
    ok, missing, excluded = kind == "ok", kind == "missing", kind == "excluded"
    defined = ok & np.isfinite(values)

    def each(statistic: str) -> np.ndarray:
        found = np.full(shape, np.nan)
        for index in np.ndindex(*shape):
            group = values[index][defined[index]]
            if statistic == "median" and len(group):
                found[index] = np.median(group)
            elif statistic == "mean" and len(group):
                found[index] = np.mean(group)
            elif statistic == "standard_deviation" and len(group) > 1:
                found[index] = np.std(group, ddof=1)
        return found

    units = {"units": str(data.attrs.get("units", "1"))}
    result = xr.Dataset(
        {name: (tuple(by), each(name), units) for name in ("median", "mean", "standard_deviation")},
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
