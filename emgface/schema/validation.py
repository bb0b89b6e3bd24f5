"""Validation of names, dims, units and ranges of datasets.

The declarations ``data_schema/*.json``, one file per kind of dataset, are read only here; a new
kind requires a new file.
"""

import json
from collections.abc import Collection
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from emgface.errors import DataError, SchemaError, UnitsError, listed
from emgface.schema.declaration import ArrayDeclaration, ObjectDeclaration
from emgface.schema.demands import Problem, attribute_problems, study_problems
from emgface.schema.migration import migrate
from emgface.schema.rules import (
    INDEX_ORDER,
    Rule,
    hint,
    index_rule,
    nearest,
    order_of,
    order_rule,
    rules_of,
    type_rule,
)

CONVENTIONS = "CF-1.11"
NOT_DATASETS = {"study", "treatment"}
"""Names of the JSON Schemas of the files of a study and of a plan, which do not declare datasets."""


def schema_folder() -> Path:
    """Return the folder of declarations, in the package or in the checkout.

    Raises DataError if neither exists.
    """
    here = Path(__file__).resolve().parents[1]
    for folder in (here / "_data_schema", here.parent / "data_schema"):
        if folder.is_dir():
            return folder
    raise DataError(
        f"No declarations found in {here / '_data_schema'} or {here.parent / 'data_schema'}; "
        "expected one JSON file per kind of dataset: reinstall the package."
    )


def kinds() -> tuple[str, ...]:
    """Return the kinds of dataset that are declared, sorted.

    Examples
    --------
    >>> "recording" in kinds()
    True
    """
    names = {path.stem for path in schema_folder().glob("*.json")}
    return tuple(sorted(names - NOT_DATASETS))


@cache
def declaration(kind: str) -> ObjectDeclaration:
    """Return the declaration of one kind of dataset; SchemaError if it is unknown.

    Examples
    --------
    >>> declaration("recording").variables["emg"].units
    'V'
    """
    path = schema_folder() / f"{kind}.json"
    if kind not in kinds():
        raise SchemaError(
            f"Unknown kind of dataset {kind!r}{hint(kind, kinds())}; "
            f"expected one of {', '.join(kinds())}."
        )
    return ObjectDeclaration.model_validate(json.loads(path.read_text(encoding="utf-8")))


def declared_variables(kind: str, **arrays: Any) -> dict[str, xr.Variable]:
    """Return arrays of a kind of dataset as variables with the dims and units that it declares.

    Values of coordinates of names are converted to text. Whether the values and their types agree with
    the declaration is checked by `validate`.

    Examples
    --------
    >>> declared_variables("sound", length=[0.17])["length"].attrs["units"]
    'm'
    """
    known, variables = declaration(kind).arrays(), dict[str, xr.Variable]()
    for name, values in arrays.items():
        array = known[name]
        data = np.asarray(values, dtype=str) if array.dtype == "string" else values
        variables[name] = xr.Variable(array.dims, data, array.units and {"units": array.units})
    return variables


def validate(
    dataset: xr.Dataset, kind: str, *, study: bool = False, partial: Collection[str] = ()
) -> xr.Dataset:
    """Check a dataset against its declaration and return it in canonical form.

    `dataset`, of one of the `kinds`, is not changed. `study` requires also the contents needed by a
    study: for a recording EMG and positions, all channels and markers by name, and the attributes
    that identify the trial; coordinates in `partial`, for example ``("channel",)``, may lack names.
    The result has the same values, migrated from older versions, integers in their declared width
    and strings as NumPy strings, with ``long_name`` and the attributes ``schema``,
    ``schema_version``, ``Conventions``. Raises UnitsError if units are missing or differ, without
    any other problem, and otherwise SchemaError with one sentence for each problem.

    Examples
    --------
    >>> time = xr.DataArray([0.0, 0.5], dims="time", attrs={"units": "s"})
    >>> values = xr.DataArray([[0.0, 1.0]], dims=("muscle", "time"), attrs={"units": "1"})
    >>> coords = {"muscle": ["ZYG_L"], "time": time}
    >>> given = xr.Dataset({"activation": values}, coords, {"origin": "measured"})
    >>> validate(given, "activation").attrs["schema_version"]
    1
    """
    declared = declaration(kind)
    problems = _identity(dataset, declared)
    if not problems:
        dataset = migrate(dataset, kind, declared.version)
        problems = _structure(dataset, declared) + _values(dataset, declared)
        problems += attribute_problems(dataset, declared)
        if study:
            reported = " ".join(text for _, text in problems)
            problems += study_problems(dataset, declared, reported, partial)
    if problems:
        units_only = all(units for units, _ in problems)
        sentences = [text for _, text in problems]
        message = sentences[0]
        if len(sentences) > 1:
            message = f"The {kind} has {len(sentences)} problems:\n" + "\n".join(
                f"- {text}" for text in sentences
            )
        raise (UnitsError if units_only else SchemaError)(message)
    return _canonical(dataset, declared)


def _identity(dataset: xr.Dataset, declared: ObjectDeclaration) -> list[Problem]:
    """Refuse a dataset of another kind."""
    kind = dataset.attrs.get("schema", declared.kind)
    if kind != declared.kind:
        text = (
            f"The dataset is of kind {kind!r}, expected {declared.kind!r}: specify the other file."
        )
        return [(False, text)]
    return []


def _structure(dataset: xr.Dataset, declared: ObjectDeclaration) -> list[Problem]:
    """Misspelt and unknown variables and coordinates, and variables of which one is required."""
    arrays = declared.arrays()
    absent = [name for name in arrays if name not in dataset.variables]
    problems: list[Problem] = []
    for name in map(str, dataset.variables):
        if name in arrays:
            continue
        # If further variables are allowed, only a very similar name is regarded as misspelt.
        near = nearest(name, absent, cutoff=0.75 if declared.extra_variables else 0.6)
        if near:
            text = (
                f"Variable {name!r} is not defined for kind {declared.kind!r}; expected "
                f"{near!r}: rename it."
            )
        elif not declared.extra_variables:
            text = (
                f"Variable {name!r} is not defined for kind {declared.kind!r}{hint(name, arrays)}; "
                f"expected only {', '.join(declared.variables)}: rename or remove it."
            )
        elif dataset[name].dtype.kind in "iuf" and not dataset[name].attrs.get("units"):
            problems.append((True, f"{name} has no unit; expected the attribute units: set it."))
            continue
        else:
            continue
        problems.append((False, text))
    if declared.any_of and not any(name in dataset for name in declared.any_of):
        text = (
            f"The {declared.kind} contains none of {', '.join(declared.any_of)}; expected at least "
            "one: check whether the reader found the signals."
        )
        problems.append((False, text))
    return problems


def _values(dataset: xr.Dataset, declared: ObjectDeclaration) -> list[Problem]:
    """Presence, dims, type, units and values of every array; only its first fault is reported."""
    problems: list[Problem] = []
    further = _further(dataset, declared)
    # The coordinates of the dims of a present optional variable are required.
    used = {dim for name in declared.variables if name in dataset for dim in dataset[name].dims}
    for name, array in declared.arrays().items():
        what = "coordinate" if name in declared.coords else "variable"
        if name not in (dataset.coords if what == "coordinate" else dataset.data_vars):
            if array.required or (what == "coordinate" and set(array.dims) & used):
                present = listed(map(str, dataset.variables), 10) or "nothing"
                text = (
                    f"The {what} {name!r} is missing, found {present}; expected {array.long_name}"
                )
                problems.append((False, f"{text}, dims ({', '.join(array.dims)})."))
            continue
        dims, wanted = dataset[name].dims, (*(further if what == "variable" else ()), *array.dims)
        if dims != wanted:
            advice = "transpose it" if set(dims) == set(wanted) else "rename or select dims"
            text = f"{name} has dims ({', '.join(map(str, dims))}); expected ({', '.join(wanted)})"
            problems.append((False, f"{text}: {advice}."))
            continue
        rules = [("type", type_rule(array))]
        if array.units is not None:
            rules.append(("units", _units_rule(array)))
        rules += rules_of(array)
        if array.index_into in dataset.sizes:
            rules.append(("index", index_rule(array, dataset.sizes[array.index_into])))
        if (names := _names_along(dataset, declared, array)) is not None:
            rules.append(("order", order_rule(names)))
        # The range of values of a wrong type or unit is not examined.
        broken = ((label, rule(dataset[name])) for label, rule in rules)
        label, sentence = next((one for one in broken if one[1]), ("", None))
        if sentence:
            problems.append((label == "units", f"{name} {sentence}."))
    return problems


def _names_along(
    dataset: xr.Dataset, declared: ObjectDeclaration, array: ArrayDeclaration
) -> xr.DataArray | None:
    """Names along the dim into which an array is an index, or None if that has no names."""
    dim = array.index_into
    names = declared.coords.get(dim or "")
    if names is None or names.dtype != "string" or dim not in dataset.coords:
        return None
    return dataset[dim]


def _further(dataset: xr.Dataset, declared: ObjectDeclaration) -> tuple[str, ...]:
    """Dims beyond those declared, in the order of the first variable, if they are allowed."""
    if not declared.further_dims:
        return ()
    own = {dim for array in declared.arrays().values() for dim in array.dims}
    present = next((dataset[name] for name in declared.variables if name in dataset), None)
    if present is None:
        return ()
    return tuple(str(dim) for dim in present.dims if dim not in own and dim in dataset.coords)


def _units_rule(declared: ArrayDeclaration) -> Rule:
    """Require the declared unit in the attribute ``units``."""

    def rule(array: xr.DataArray) -> str | None:
        unit = array.attrs.get("units")
        if unit == declared.units:
            return None
        state = f"is in {unit!r}" if unit else "has no unit"
        return f"{state}; expected {declared.units!r}: convert it to SI and set the attribute units"

    return rule


def _canonical(dataset: xr.Dataset, declared: ObjectDeclaration) -> xr.Dataset:
    """Cast to the declared types, and add descriptions and version to the dataset."""
    result = dataset.copy()
    for name, array in declared.arrays().items():
        if name not in result.variables:
            continue
        current = result[name]
        target = current.dtype
        if array.dtype == "string":
            target = np.dtype(str)
        elif array.dtype != "number":
            target = np.dtype(array.dtype)
        order = _names_along(result, declared, array)
        numbered = {} if order is None else {INDEX_ORDER: order_of(order)}
        attrs = {
            **current.attrs,
            **numbered,
            "long_name": current.attrs.get("long_name", array.long_name),
        }
        if target.kind != current.dtype.kind or (target.kind != "U" and target != current.dtype):
            result[name] = current.astype(target).assign_attrs(attrs)
        else:
            result[name].attrs.update(attrs)
    result.attrs = {
        **dataset.attrs,
        "Conventions": CONVENTIONS,
        "schema": declared.kind,
        "schema_version": declared.version,
    }
    return result
