"""Write and read datasets as netCDF files, without partial files or changes."""

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import netCDF4
import numpy as np
import xarray as xr

from emgface.errors import DataError
from emgface.files import existing_file, replace_file
from emgface.schema.hdf5 import ROOM, ROOM_PER_BYTE, require_own_file
from emgface.schema.validation import validate

_HDF5 = b"\x89HDF\r\n\x1a\n"
_JSON = "json_attributes"  #: attribute that lists the attributes stored as JSON text
_EXPANSION = 1100
"""Largest number of bytes in memory per byte of a file; zeros are compressed to about 1/1030."""
_COMPRESSION = {"zlib": True, "complevel": 4, "shuffle": True, "fletcher32": True}
"""Encoding with checksums, so that a flipped bit is detected."""


def write_netcdf(
    dataset: xr.Dataset,
    path: str | Path,
    kind: str,
    *,
    groups: Mapping[str, tuple[xr.Dataset, str]] | None = None,
) -> Path:
    """Check a dataset of a kind and write it as netCDF-4, compressed, and return the path.

    `groups` are further datasets with their kinds, written as groups of the same file.

    The file is written under a temporary name and renamed when it is complete; an existing one is
    replaced and folders are created. Attributes that netCDF cannot represent exactly (lists, dicts,
    booleans, None) are written as JSON text and listed in the attribute ``json_attributes``. Raises
    SchemaError or UnitsError, without writing, if the dataset does not fulfil its declaration, and
    DataError if the file cannot be written or its name does not end in .nc, by which it is read.
    """
    path = Path(path)
    if path.suffix.lower() != ".nc":
        raise DataError(
            f"{path.name} has the suffix {path.suffix!r}, expected '.nc', because netCDF is written: "
            "rename the file"
        )
    every = {"": (dataset, kind), **(groups or {})}
    ready = {group: ready_to_write(own, declared) for group, (own, declared) in every.items()}

    def write(target: Path) -> None:
        for group, (own, encoding) in ready.items():
            mode, place = ("a", group) if group else ("w", None)
            own.to_netcdf(target, mode=mode, group=place, engine="netcdf4", encoding=encoding)

    replace_file(path, write)
    return path


def ready_to_write(dataset: xr.Dataset, kind: str) -> tuple[xr.Dataset, dict[Any, dict[str, Any]]]:
    """Return a checked dataset with attributes that netCDF can represent, and its encoding."""
    ready = validate(dataset, kind).drop_encoding()
    for part in (ready, *ready.variables.values()):
        part.attrs = _packed(part.attrs)
    return ready, {
        name: dict(_COMPRESSION)
        for name, variable in ready.variables.items()
        if variable.dtype.kind in "iuf" and variable.ndim
    }


def read_netcdf(path: str | Path, kind: str, *, group: str | None = None) -> xr.Dataset:
    """Read a netCDF file of an expected kind, or one of its groups, into memory and check it.

    Raises DataError if the file is absent, truncated or is not netCDF, and SchemaError or
    UnitsError if its content does not fulfil the declaration.
    """
    path = Path(path)
    with open_netcdf(path) as opened:
        _check_sizes(path, opened)
        if opened.disk_format == "HDF5":
            _check_texts(path)
    try:
        dataset = xr.load_dataset(path, group=group, engine="netcdf4", decode_times=False)
    except (OSError, RuntimeError, ValueError, AttributeError, KeyError, TypeError) as error:
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


def kind_of(path: str | Path) -> str:
    """Return the kind of dataset declared by a netCDF file, empty if it is not specified.

    Raises DataError if the file is absent, truncated or is not netCDF.
    """
    with open_netcdf(Path(path)) as opened:
        return str(getattr(opened, "schema", ""))


def open_netcdf(path: Path) -> netCDF4.Dataset:
    """Open a netCDF file for reading; the caller closes it.

    Raises DataError if the file is absent, truncated or is not netCDF.
    """
    existing_file(path, "a netCDF file")
    with path.open("rb") as stream:
        start = stream.read(8)
    if start != _HDF5 and not start.startswith(b"CDF"):
        raise DataError(
            f"{path.name} is not a netCDF file, it begins with {start[:8]!r}; expected a "
            "file written by this package: specify the correct file, or correct its suffix."
        )
    try:
        return netCDF4.Dataset(path)
    except (OSError, RuntimeError) as error:
        raise DataError(_damaged(path)) from error


def _check_sizes(path: Path, opened: netCDF4.Dataset) -> None:
    """Refuse a file whose damaged counts would fill the memory."""
    room = _EXPANSION * path.stat().st_size
    total, most = 0, ROOM + ROOM_PER_BYTE * path.stat().st_size
    for name, variable in _variables(opened):
        # The product of the shape, because variable.size overflows.
        size = getattr(variable.dtype, "itemsize", 1)
        total += math.prod(variable.shape) * size
        if math.prod(variable.shape) * size > room or total > most:
            raise DataError(
                f"{path.name}: {name!r} has the shape {variable.shape} in a file of "
                f"{path.stat().st_size} bytes; expected arrays no larger than the file: it "
                "is damaged, copy or write it again."
            )


def _variables(group: Any) -> Iterator[tuple[str, Any]]:
    """Yield the variables of a file and of all its groups."""
    yield from group.variables.items()
    for name, inner in group.groups.items():
        for variable, value in _variables(inner):
            yield f"{name}/{variable}", value


def _check_texts(path: Path) -> None:
    """Refuse a file with a text longer than the file, for which HDF5 would allocate memory."""
    longest = path.stat().st_size
    lengths: list[np.ndarray] = []

    def visit(_: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or h5py.check_string_dtype(item.dtype) is None:
            return
        count = math.prod(item.shape)
        start = item.id.get_offset()  # None if it is stored in chunks
        if start is not None and item.id.get_type().is_variable_str():
            # A length of 4 bytes, an address of 8 and an index of 4 for each text.
            descriptors = np.memmap(path, np.uint8, "r", start, (count, 16))
            lengths.append(np.ascontiguousarray(descriptors[:, :4]).view("<u4").ravel())

    try:
        with h5py.File(path, "r") as opened:
            require_own_file(path, opened)
            opened.visititems(visit)
    except DataError:
        raise
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise DataError(_damaged(path)) from error
    if any(bool((length > longest).any()) for length in lengths):
        raise DataError(_damaged(path))


def _damaged(path: Path) -> str:
    return (
        f"{path.name} begins like a netCDF file but cannot be read, {path.stat().st_size} bytes; "
        "expected a complete file: it is truncated or damaged, copy or write it again."
    )


def _packed(attrs: Mapping[Any, Any]) -> dict[str, Any]:
    """Return attributes as numbers and text; others are encoded as JSON and listed."""
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
    """Return attributes decoded from `_packed`."""
    plain = {
        str(name): value.tolist() if isinstance(value, np.generic | np.ndarray) else value
        for name, value in attrs.items()
    }
    for name in str(plain.pop(_JSON, "")).split():
        plain[name] = json.loads(plain[name])
    return plain
