"""Datasets as netCDF files: written whole or not at all, read back identical."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

from emgface.errors import DataError
from emgface.files import replace_file
from emgface.schema import validate

_HDF5 = b"\x89HDF\r\n\x1a\n"
_JSON = "json_attributes"
"""Attribute that names those of its owner which are JSON text."""
_COMPRESSION = {"zlib": True, "complevel": 4, "shuffle": True}


def write_netcdf(dataset: xr.Dataset, path: str | Path, kind: str) -> Path:
    """Check a dataset and write it as netCDF-4, compressed.

    The file appears under its name only when it is complete: it is written beside and renamed.

    Parameters
    ----------
    dataset : xarray.Dataset
        Dataset to write. Attributes that netCDF cannot hold, or not give back as they were
        (lists, dicts, booleans, None), are written as JSON text and listed in the attribute
        ``json_attributes``.
    path : str or Path
        File to write; its folder is made if need be, an existing file is replaced.
    kind : str
        Kind of dataset, one of `emgface.schema.kinds`.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    SchemaError, UnitsError
        If the dataset does not follow its declaration; nothing is written then.
    DataError
        If the file cannot be written.
    """
    path = Path(path)
    ready = validate(dataset, kind).drop_encoding()
    for part in (ready, *ready.variables.values()):
        part.attrs = _packed(part.attrs)
    encoding = {
        name: dict(_COMPRESSION)
        for name, variable in ready.variables.items()
        if variable.dtype.kind in "iuf" and variable.ndim
    }
    replace_file(path, lambda target: ready.to_netcdf(target, engine="netcdf4", encoding=encoding))
    return path


def read_netcdf(path: str | Path, kind: str) -> xr.Dataset:
    """Read a netCDF file into memory and check it.

    Parameters
    ----------
    path : str or Path
        File written by `write_netcdf`, or another one that follows the declaration.
    kind : str
        Kind of dataset that is expected.

    Returns
    -------
    xarray.Dataset
        What `emgface.schema.validate` returned when the file was written.

    Raises
    ------
    DataError
        If the file is absent, truncated or no netCDF.
    SchemaError, UnitsError
        If its content does not follow the declaration.
    """
    path = Path(path)
    with open_netcdf(path):
        pass
    try:
        dataset = xr.load_dataset(path, engine="netcdf4", decode_times=False)
    except (OSError, RuntimeError, ValueError) as error:
        raise DataError(_damaged(path)) from error
    dataset = dataset.drop_encoding()
    for part in (dataset, *dataset.variables.values()):
        part.attrs = _unpacked(part.attrs)
    for name, variable in dataset.variables.items():
        if variable.dtype.kind in "OT":
            dataset[name] = dataset[name].astype(str)
    try:
        return validate(dataset, kind)
    except DataError as error:
        raise type(error)(f"{path.name}: {error}") from error


def open_netcdf(path: Path) -> netCDF4.Dataset:
    """Open a netCDF file for reading, or say in one sentence why it is none.

    Parameters
    ----------
    path : Path
        File to open; the caller closes it.

    Returns
    -------
    netCDF4.Dataset
        The open file.

    Raises
    ------
    DataError
        If the file is absent, truncated or no netCDF.
    """
    if not path.is_file():
        raise DataError(f"No file {path}; expected a netCDF file: see the spelling of the path.")
    with path.open("rb") as stream:
        start = stream.read(8)
    if start != _HDF5 and not start.startswith(b"CDF"):
        raise DataError(
            f"{path.name} is no netCDF file, it begins with {start[:8]!r}; expected a file "
            "written by this package: give the right file, or its own suffix."
        )
    try:
        return netCDF4.Dataset(path)
    except (OSError, RuntimeError) as error:
        raise DataError(_damaged(path)) from error


def _damaged(path: Path) -> str:
    return (
        f"{path.name} begins like a netCDF file but cannot be read, {path.stat().st_size} bytes; "
        "expected a complete file: it is truncated or damaged, copy or write it again."
    )


def _packed(attrs: Mapping[Any, Any]) -> dict[str, Any]:
    """Return attributes as numbers and text: anything else as JSON, and its name noted."""
    packed: dict[str, Any] = {}
    as_json: list[str] = []
    for name, value in attrs.items():
        if isinstance(value, np.generic | np.ndarray):
            value = value.tolist()
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            value = json.dumps(value, default=str)
            as_json.append(str(name))
        packed[str(name)] = value
    if as_json:
        packed[_JSON] = " ".join(as_json)
    return packed


def _unpacked(attrs: Mapping[Any, Any]) -> dict[str, Any]:
    """Return attributes as they were before `_packed`."""
    plain = {
        str(name): value.tolist() if isinstance(value, np.generic | np.ndarray) else value
        for name, value in attrs.items()
    }
    for name in str(plain.pop(_JSON, "")).split():
        plain[name] = json.loads(plain[name])
    return plain
