"""Arrays in MATLAB and HDF5 files, by the name of their variable."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io

from emgface.errors import DataError
from emgface.schema.rules import hint, listed

SUFFIXES = (".mat", ".h5", ".hdf5")
"""Files that hold arrays."""

_HDF5 = b"\x89HDF\r\n\x1a\n"
_MATLAB = b"MATLAB 7.3"
_EXPANSION = 1100
"""Most values for each byte of a file; zeros deflate to about 1/1030, and bytes are the smallest."""


def read_array(path: Path, name: str) -> np.ndarray:
    """Return a numeric variable.

    Parameters
    ----------
    path : Path
        MATLAB file of version 4 to 7.3, or any HDF5 file.
    name : str
        Variable; fields of a structure follow after ``.``, members of an HDF5 group after ``/``.

    Returns
    -------
    ndarray
        The numbers as float64, with the dims as MATLAB (or, for other HDF5 files, the file) has
        them.

    Raises
    ------
    DataError
        If the file is damaged or has no such variable, or it holds no real numbers.
    """
    value = _value(path, name)
    array = np.asarray(value)
    if array.dtype.kind not in "iufb" or array.size == 0:
        raise DataError(
            f"{path.name}: {name!r} holds {array.dtype} of shape {array.shape}; expected real "
            "numbers: name another variable."
        )
    return array.astype(np.float64)


def read_texts(path: Path, name: str) -> list[str]:
    """Return a variable that holds texts: a cell array of names, or rows of characters.

    Parameters
    ----------
    path : Path
        MATLAB or HDF5 file.
    name : str
        Variable, as for `read_array`.

    Returns
    -------
    list of str
        The texts, without blanks around them.

    Raises
    ------
    DataError
        If the file is damaged or has no such variable, or it holds no text.
    """
    texts = list(_texts(_value(path, name, texts=True)))
    if not texts:
        raise DataError(f"{path.name}: {name!r} holds no text; expected a cell array of names.")
    return texts


def _texts(value: Any) -> Iterator[str]:
    for item in np.asarray(value).ravel():
        if isinstance(item, np.ndarray):
            yield from _texts(item)
        elif isinstance(item, bytes):
            yield item.decode("utf-8", "replace").strip()
        elif isinstance(item, str):
            yield item.strip()


def _value(path: Path, name: str, *, texts: bool = False) -> Any:
    """Open the file by what it holds, whatever its suffix says."""
    if not path.is_file():
        raise DataError(f"No file {path}; expected a MATLAB or HDF5 file: see its path.")
    with path.open("rb") as stream:
        start = stream.read(520)
    matlab = start.startswith(_MATLAB)
    try:
        # Parsers of binary formats raise whatever the damage leads them to.
        if matlab or start.startswith(_HDF5):
            with h5py.File(path, "r") as opened:
                return _in_hdf5(path, opened, name, matlab=matlab, texts=texts)
        return _in_mat5(path, name)
    except DataError:
        raise
    except Exception as error:
        raise DataError(
            f"{path.name} cannot be read ({type(error).__name__}: {error}); expected a complete "
            "MATLAB or HDF5 file: it is truncated or damaged, save it again."
        ) from error


def _in_mat5(path: Path, name: str) -> Any:
    """Take a variable, or a field of one, out of a MATLAB file before version 7.3."""
    _check_elements(path)
    head, *fields = name.split(".")
    found: list[Any] = scipy.io.whosmat(str(path), appendmat=False)
    held: dict[str, tuple[int, ...]] = {str(row[0]): row[1] for row in found}
    if head not in held:
        raise DataError(_absent(path, head, list(held)))
    if np.prod(np.array(held[head], float)) > _EXPANSION * path.stat().st_size:
        raise DataError(
            f"{path.name}: {head!r} has the shape {held[head]} in a file of "
            f"{path.stat().st_size} bytes; expected an array that fits: it is damaged."
        )
    value: Any = scipy.io.loadmat(str(path), appendmat=False, variable_names=[head])[head]
    for field in fields:
        known = value.dtype.names or () if isinstance(value, np.ndarray) else ()
        if field not in known:
            raise DataError(_absent(path, field, list(known)))
        value = value[field]
        # A structure is an array of objects, of size one where it is no array of structures.
        while isinstance(value, np.ndarray) and value.dtype == object and value.size == 1:
            value = value.ravel()[0]
    return value


def _check_elements(path: Path) -> None:
    """Refuse a file of version 5 whose last variable is cut; scipy reads those before it."""
    data = path.read_bytes()
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        return  # version 4, which says nothing of its length
    at = 128
    while at + 8 <= len(data):
        at += 8 + struct.unpack_from(f"{order}I", data, at + 4)[0]
    if at != len(data) or at == 128:
        raise DataError(
            f"{path.name} has {len(data)} bytes and its variables {at}; expected a whole MATLAB "
            "file: it is truncated or damaged, save it again."
        )


def _in_hdf5(path: Path, opened: h5py.File, name: str, *, matlab: bool, texts: bool) -> Any:
    """Take a data set out of an HDF5 file; MATLAB stores the dims in reverse."""
    where: Any = opened
    for part in (name.replace(".", "/") if matlab else name).strip("/").split("/"):
        if not isinstance(where, h5py.Group) or part not in where:
            held = [str(k) for k in where] if isinstance(where, h5py.Group) else []
            raise DataError(_absent(path, part, [k for k in held if not k.startswith("#")]))
        where = where[part]
    if not isinstance(where, h5py.Dataset):
        raise DataError(f"{path.name}: {name!r} is a group; expected one of {listed(where)} in it.")
    if where.size is not None and where.size > _EXPANSION * path.stat().st_size:
        raise DataError(
            f"{path.name}: {name!r} has the shape {where.shape} in a file of "
            f"{path.stat().st_size} bytes; expected an array that fits: it is damaged."
        )
    value = where[()]
    if texts and matlab and value.dtype.kind in "Ou":
        if value.dtype == object:  # references to arrays of characters
            found: Any = opened
            cells = (np.asarray(found[reference][()]) for reference in value.ravel(order="F"))
        else:
            cells = iter(np.atleast_2d(value.T))
        return np.array(["".join(map(chr, cell.ravel(order="F"))) for cell in cells], dtype=object)
    return value.T if matlab and isinstance(value, np.ndarray) else value


def _absent(path: Path, name: str, held: list[str]) -> str:
    return (
        f"{path.name} has no variable {name!r}{hint(name, held)}; found "
        f"{listed(held) or 'none'}: see 'variable' in the sidecar."
    )
