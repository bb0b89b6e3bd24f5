"""Arrays of MATLAB and HDF5 files, read by the name of their variable."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from emgface.errors import DataError, listed
from emgface.files import existing_file
from emgface.recordings.readers._isolated import parsed
from emgface.recordings.readers._parsers import (
    AbsentVariable,
    NotAnArray,
    parse_hdf5,
    parse_matlab,
)
from emgface.schema.rules import hint

ARRAY_SUFFIXES = (".mat", ".h5", ".hdf5")  #: suffixes of files with arrays

_HDF5 = b"\x89HDF\r\n\x1a\n"
_MATLAB = b"MATLAB 7.3"


def read_array(path: Path, name: str, unit: str = "", *, counts: bool = False) -> np.ndarray:
    """Return a numeric variable as float64, with the dims as in MATLAB (or in the HDF5 file).

    The file is MATLAB of version 4 to 7.3 or HDF5; fields of a structure follow after ``.``,
    members of an HDF5 group after ``/``. Raises DataError if the file is damaged, has no such
    variable, it does not contain real numbers, or its attributes state another unit than `unit` or a
    conversion; the latter two are accepted of `counts`, which the caller converts.
    """
    value = _value(path, name, unit=unit, counts=counts)
    array = np.asarray(value)
    if array.dtype.kind not in "iuf" or array.size == 0:
        raise DataError(
            f"{path.name}: {name!r} contains {array.dtype} of shape {array.shape}; expected "
            "real numbers: specify another variable."
        )
    return array.astype(np.float64)


def read_flags(path: Path, name: str) -> np.ndarray:
    """Return a variable of numbers or logical values, as in the file; DataError as `read_array`."""
    return np.asarray(_value(path, name, counts=True))


def read_texts(path: Path, name: str) -> list[str]:
    """Return a variable of texts, without blanks around them: a cell array, or rows of characters.

    Raises DataError if the file is damaged, has no such variable, or it contains no text.
    """
    texts = list(_texts(_value(path, name, texts=True)))
    if not texts:
        raise DataError(f"{path.name}: {name!r} contains no text; expected a cell array of names.")
    return texts


def _texts(value: Any) -> Iterator[str]:
    for item in np.asarray(value).ravel():
        if isinstance(item, np.ndarray):
            yield from _texts(item)
        elif isinstance(item, bytes):
            yield item.decode("utf-8", "replace").strip()
        elif isinstance(item, str):
            yield item.strip()


def _value(
    path: Path, name: str, *, texts: bool = False, unit: str = "", counts: bool = False
) -> Any:
    """Parse the file in the child process by its content, irrespective of its suffix."""
    with existing_file(path, "a MATLAB or HDF5 file").open("rb") as stream:
        start = stream.read(520)
    matlab = start.startswith(_MATLAB)
    try:
        if matlab or start.startswith(_HDF5):
            options = {"matlab": matlab, "texts": texts, "counts": counts}
            return parsed(path, parse_hdf5, path, name, unit=unit, **options)
        _check_elements(path)
        return parsed(path, parse_matlab, path, name)
    except AbsentVariable as error:
        raise DataError(_absent(path, *error.args)) from None
    except NotAnArray as error:
        raise DataError(
            f"{path.name}: {name!r} is a group; expected one of {listed(error.args[1])} in it."
        ) from None


def _check_elements(path: Path) -> None:
    """Refuse a file of version 5 whose last variable is truncated, which scipy would not detect."""
    data = path.read_bytes()
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        return  # version 4, which does not state its length
    at = 128
    while at + 8 <= len(data):
        at += 8 + struct.unpack_from(f"{order}I", data, at + 4)[0]
    if at != len(data) or at == 128:
        raise DataError(
            f"{path.name} has {len(data)} bytes, and its variables {at}; expected a complete MATLAB file"
            ": it is truncated or damaged, save it again."
        )


def _absent(path: Path, name: str, names: list[str]) -> str:
    return (
        f"{path.name} has no variable {name!r}{hint(name, names)}; found "
        f"{listed(names) or 'none'}: check 'variable' in the sidecar."
    )
