"""Datasets that a user passes in memory, in seconds and SI units, whatever xarray made of them.

xarray turns times with the unit s into ``timedelta64`` when it opens a file, arithmetic removes units,
and arrays may be those of dask. `usable` converts what has one meaning, and refuses the rest, before
anything is computed.
"""

import numpy as np
import xarray as xr

from emgface.errors import SchemaError, UnitsError, listed
from emgface.schema.clocks import without_unit
from emgface.schema.declaration import ArrayDeclaration
from emgface.schema.validation import declaration


def usable(dataset: xr.Dataset, kind: str) -> xr.Dataset:
    """Return a dataset of a kind with arrays in memory and times in s; it is not changed.

    Dims may have any order; the result has the declared one. Variables of the kind that are absent, and
    further ones, are allowed. Raises UnitsError if a variable has another unit than its declaration, or
    none although it has a dimension, and SchemaError if it has other dims, contains dates instead of
    seconds or complex numbers, or lacks the names of its axes.
    """
    declared = declaration(kind)
    arrays = declared.arrays()
    result = dataset.copy().load()
    for name, array in arrays.items():
        if name not in result.variables:
            continue
        result = _in_seconds(result, name, array)
        values = result[name]
        if array.unique:
            labels = list(map(str, values.values.ravel()))
            if twice := sorted({label for label in labels if labels.count(label) > 1}):
                raise SchemaError(
                    f"the {kind} contains {name} {listed(twice)} more than once, expected every {name} "
                    "once: remove or rename the others"
                )
        if set(values.dims) != set(array.dims) and not declared.further_dims:
            raise SchemaError(
                f"{name} of the {kind} has dims ({', '.join(map(str, values.dims))}), expected "
                f"({', '.join(array.dims)}): rename or select dims"
            )
        if (array.units is not None or array.dtype == "float64") and values.dtype.kind not in "iuf":
            raise SchemaError(
                f"{name} of the {kind} contains {values.dtype}, expected numbers: convert it with "
                ".astype(float)"
            )
        _require_unit(values, array, kind, name)
        if array.units == "s" and not values.attrs.get("units") and values.ndim == 1:
            if doubt := without_unit(
                np.asarray(values.values, dtype=float), f"{name} of the {kind}"
            ):
                raise UnitsError(doubt)
        for dim in array.dims:
            own = arrays.get(dim)
            if own is not None and own.units == "s" and dim not in result.coords:
                raise SchemaError(
                    f"the {kind} has no coordinate {dim!r} of {name}, expected its instants in s: "
                    "assign them"
                )
            if own is not None and own.units == "s" and not result.sizes[dim]:
                raise SchemaError(
                    f"{name} of the {kind} contains no instant, expected a {dim} of at least one: check "
                    "what was selected"
                )
            if own is not None and own.complete and own.names and name != dim:
                result = _in_order(result, dim, own.names, kind)
        if name not in result.coords:
            ordered = result[name].transpose(*array.dims, ..., missing_dims="ignore")
            result = result.assign({name: ordered})
    return result


def _in_order(dataset: xr.Dataset, dim: str, names: tuple[str, ...], kind: str) -> xr.Dataset:
    """Return the axes in the declared order; SchemaError unless they are exactly these."""
    labels = [str(one) for one in dataset[dim].values] if dim in dataset.coords else []
    if sorted(labels) != sorted(names):
        raise SchemaError(
            f"the {kind} has the {dim} {listed(labels) or 'without names'}, expected {listed(names)}: "
            "select or assign them"
        )
    return dataset if labels == list(names) else dataset.sel({dim: list(names)})


def _in_seconds(dataset: xr.Dataset, name: str, array: ArrayDeclaration) -> xr.Dataset:
    """Convert durations to seconds; SchemaError for dates."""
    values = dataset[name]
    if values.dtype.kind == "M":
        raise SchemaError(
            f"{name} contains dates, expected s from one instant that EMG and markers have in common: "
            "subtract it and divide by np.timedelta64(1, 's')"
        )
    if values.dtype.kind != "m" or array.units != "s":
        return dataset
    seconds = values.variable.copy(data=values.values / np.timedelta64(1, "s"))
    seconds.attrs["units"] = "s"
    return dataset.assign({name: seconds}) if name not in dataset.coords else dataset.assign_coords(
        {name: seconds}
    )  # fmt: skip


def _require_unit(values: xr.DataArray, array: ArrayDeclaration, kind: str, name: str) -> None:
    unit = values.attrs.get("units")
    if array.units is None or unit == array.units:
        return
    # Times and numbers without a dimension are often made without a unit.
    if not unit and (array.units in ("1", "s")):
        return
    state = f"is in {unit!r}" if unit else "has no unit"
    raise UnitsError(
        f"{name} of the {kind} {state}, expected {array.units!r}: convert it and set the attribute "
        "units (arithmetic of xarray removes it, except with xr.set_options(keep_attrs=True))"
    )
