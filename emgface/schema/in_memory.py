"""Datasets that a user passes in memory, in seconds and SI units, whatever xarray made of them.

xarray turns times with the unit s into ``timedelta64`` when it opens a file, arithmetic removes units,
and arrays may be those of dask. `usable` converts what has one meaning, and refuses the rest, before
anything is computed.
"""

import numpy as np
import xarray as xr

from emgface.errors import SchemaError, UnitsError, listed
from emgface.schema.clocks import without_unit
from emgface.schema.declaration import ArrayDeclaration, ObjectDeclaration
from emgface.schema.validation import declaration, kinds


def usable(dataset: xr.Dataset, kind: str) -> xr.Dataset:
    """Return a dataset of a kind with arrays in memory and times in s; it is not changed.

    Dims may have any order; the result has the declared one. Variables of the kind that are absent, and
    further ones, are allowed; scalar coordinates that are not declared, which a selection leaves, are
    omitted. Raises UnitsError if a variable has another unit than its declaration, or none although it
    has a dimension, and SchemaError if the dataset is of another kind, or a variable has other dims,
    contains dates instead of seconds or complex numbers, or lacks the names of its axes.
    """
    require_kind(dataset, kind)
    declared = declaration(kind)
    arrays = declared.arrays()
    selected = [name for name, one in dataset.coords.items() if not one.ndim and name not in arrays]
    result = dataset.drop_vars(selected).copy().load()
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


def kind_in_memory(dataset: xr.Dataset) -> str:
    """Return the kind of which a dataset has all variables, of several the one with the most, or ""."""
    complete = [kind for kind in kinds() if _is_complete(dataset, declaration(kind))]
    return max(complete, key=lambda kind: len(_required(declaration(kind))), default="")


def require_kind(dataset: xr.Dataset, kind: str) -> None:
    """Raise SchemaError if a dataset is of another kind, or has no variable of this one."""
    declared = declaration(kind)
    if _is_complete(dataset, declared):
        return
    stated = str(dataset.attrs.get("schema", kind))
    other = kind_in_memory(dataset) if stated == kind else stated
    if other:
        raise SchemaError(
            f"the dataset is of the kind {other!r}, expected {kind!r}: pass the other dataset"
        )
    if not set(declared.variables) & set(dataset.variables):
        raise SchemaError(
            f"the dataset contains {listed(dataset.variables) or 'no variable'}, expected "
            f"{listed(_required(declared) or declared.any_of)}, as of a dataset of the kind {kind!r}: "
            "pass the result of the preceding stage"
        )


def _required(declared: ObjectDeclaration) -> list[str]:
    return [name for name, array in declared.variables.items() if array.required]


def _is_complete(dataset: xr.Dataset, declared: ObjectDeclaration) -> bool:
    """Return True if all required variables are there, with their dims in any order."""

    def fits(name: str) -> bool:
        own = set(declared.variables[name].dims)
        return name in dataset and set(dataset[name].dims) == own

    required = _required(declared)
    one_of = any(map(fits, declared.any_of))
    return all(map(fits, required)) and (one_of if declared.any_of else bool(required))


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
