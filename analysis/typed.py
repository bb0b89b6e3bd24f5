"""Methods of xarray with complete annotations, which the strict type check requires."""

from collections.abc import Hashable, Mapping
from typing import Any, TypeVar, cast

import numpy as np
import xarray as xr

from analysis.errors import CubeError

Labelled = TypeVar("Labelled", xr.DataArray, xr.Dataset)


def coordinates(data: xr.DataArray | xr.Dataset) -> dict[str, xr.DataArray]:
    """Return the coordinates by name."""
    coords: Mapping[Hashable, xr.DataArray] = cast(Any, data).coords
    return {str(name): coords[name] for name in coords}


def selected(data: Labelled, indexers: Mapping[str, Any]) -> Labelled:
    """Select by label."""
    return cast(Any, data).sel(dict(indexers))


def floats(data: xr.DataArray) -> xr.DataArray:
    """Convert to float64."""
    return cast(Any, data).astype(np.float64)


def texts(data: xr.DataArray) -> xr.DataArray:
    """Convert to text."""
    return cast(Any, data).astype(str)


def status_of(cube: xr.Dataset) -> xr.DataArray:
    """Return the status of every trial as text, or raise CubeError if the cube has none."""
    if "status" not in cube:
        raise CubeError(
            "the cube has no variable 'status', expected 'ok' for every scored trial: keep it when "
            "variables are selected"
        )
    return texts(cube["status"])


def scored_values(cube: xr.Dataset) -> xr.Dataset:
    """Return the cube with NaN for the numbers of every trial that is not scored, as `build_cube` does.

    A trial may be excluded later by its status alone.
    """
    ok = status_of(cube) == "ok"
    by_status = {
        name: data.where(ok)
        for name, data in cube.data_vars.items()
        if data.dtype.kind == "f" and set(ok.dims) <= set(data.dims)
    }
    return cube.assign(by_status)


def relabelled(data: Labelled, coords: Mapping[str, Any]) -> Labelled:
    """Return the data with these coordinates."""
    return cast(Any, data).assign_coords(dict(coords))
