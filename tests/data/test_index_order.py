"""Indices into named dims: reordering the names must not change what the numbers mean."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from emgface.errors import SchemaError
from emgface.run.digest import dataset_digest
from emgface.schema.netcdf import read_netcdf, write_netcdf
from emgface.schema.rules import INDEX_ORDER
from emgface.schema.validation import declaration, kinds, validate

Make = Callable[[str], xr.Dataset]


def numbered() -> list[tuple[str, str, str]]:
    """Kind, index and named dim of every declaration."""
    return [
        (kind, name, array.index_into)
        for kind in kinds()
        for name, array in declaration(kind).variables.items()
        if array.index_into is not None
        and (names := declaration(kind).coords.get(array.index_into)) is not None
        and names.dtype == "string"
    ]


def test_muscles_bodies_and_joints_are_among_them() -> None:
    dims = set(numbered())
    for kind, name, dim in (
        ("face_model", "bundle_muscle", "muscle"),
        ("tongue_model", "fibre_muscle", "muscle"),
        ("jaw_model", "muscle_body", "body"),
    ):
        assert (kind, name, dim) in dims


@pytest.mark.parametrize(("kind", "name", "dim"), numbered())
def test_names_in_another_order_are_refused(
    kind: str, name: str, dim: str, valid: Make, tmp_path
) -> None:
    made = validate(valid(kind), kind)
    if name not in made or dim not in made.coords:
        pytest.skip(f"the example of {kind} has no {name}")
    assert INDEX_ORDER in made[name].attrs
    xr.testing.assert_identical(validate(made, kind), made)
    if made.sizes[dim] < 2:
        other = made.assign_coords({dim: [f"{made[dim].values[0]}x"]})
    else:
        other = made.isel({dim: np.arange(made.sizes[dim])[::-1]})
    stored = read_netcdf(write_netcdf(made, tmp_path / "a.nc", kind), kind)
    for changed in (other, stored.isel({dim: [*range(1, made.sizes[dim]), 0]})):
        if changed[dim].equals(made[dim]):
            continue
        with pytest.raises(
            SchemaError, match=f"{name} is an index into '{dim}', whose names or order"
        ):
            validate(changed, kind)
    for array in other.variables.values():
        array.attrs.pop(
            INDEX_ORDER, None
        )  # an older file, or names and numbers that were both changed
    try:
        validate(other, kind)
    except SchemaError as error:
        assert "whose names or order" not in str(error)


def test_the_order_changes_no_digest(coarse: xr.Dataset, tmp_path) -> None:
    """A face read from a file of an earlier version has the digest that its reduced face states."""
    earlier = coarse.copy(deep=True)
    for variable in earlier.variables.values():
        variable.attrs.pop(INDEX_ORDER, None)
    path = tmp_path / "face.nc"
    earlier.to_netcdf(path)
    read = read_netcdf(path, "face_model")
    assert any(INDEX_ORDER in variable.attrs for variable in read.variables.values())
    assert dataset_digest(read) == dataset_digest(xr.load_dataset(path))
