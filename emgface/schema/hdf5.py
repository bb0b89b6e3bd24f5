"""HDF5 files that contain all their data: links to other files, absent and expanding data refused.

An HDF5 file may refer to arrays of other files by external links, virtual data sets and external
storage, which the library follows to any path; a source that is missing, and data that were never
written, are returned as fill values. MATLAB 7.3 and netCDF-4 files are HDF5 files.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import h5py

from emgface.errors import DataError

ROOM, ROOM_PER_BYTE = 512 << 20, 64
"""Largest size of all data sets of a file in memory [byte], and addition per byte of the file."""
_LINKS: Final = 16  #: most soft links of a name that lead to one another
_DIMENSION: Final = b"This is a netCDF dimension but not a netCDF variable"


def item_of(path: Path, opened: h5py.File, name: str) -> Any:
    """Return a group or data set by its name, with ``/`` between groups.

    Soft links are followed within the file. Raises KeyError with the missing part and its group, and
    DataError if a link leads to another file, or in a circle, or the data are not in this file.
    """
    item = _followed(path, opened, name, 0)
    if isinstance(item, h5py.Dataset):
        require_own_data(path, item)
    return item


def _followed(path: Path, start: Any, name: str, links: int) -> Any:
    where = start
    for part in name.strip("/").split("/"):
        link = where.get(part, getlink=True) if isinstance(where, h5py.Group) and part else None
        if link is None:
            raise KeyError(part, where)
        if isinstance(link, h5py.ExternalLink):
            raise _elsewhere(path, name, f"a link to {link.filename!r}")
        if isinstance(link, h5py.SoftLink):
            if links >= _LINKS:
                raise _elsewhere(path, name, "a link that leads to itself")
            target = link.path
            root = where.file if target.startswith("/") else where
            where = _followed(path, root, target, links + 1)
        else:
            where = where[part]  # pyright: ignore[reportIndexIssue]
    return where


def require_own_data(path: Path, item: h5py.Dataset) -> None:
    """Raise DataError unless all values of a data set were written to its own file."""
    name = str(item.name)
    if item.is_virtual:
        sources = sorted({source.file_name for source in item.virtual_sources()})
        raise _elsewhere(path, name, f"a virtual data set of {', '.join(sources) or 'nothing'}")
    if item.external:
        files = ", ".join(str(entry[0]) for entry in item.external)
        raise _elsewhere(path, name, f"stored in {files}")
    if not item.size or item.dtype.kind not in "iufb":
        return
    marked = item.attrs.get("NAME", b"")
    marked = marked.encode() if isinstance(marked, str) else bytes(marked)
    if marked.startswith(_DIMENSION):
        return
    chunks = 1 if item.chunks is None else math.prod(
        -(-length // step) for length, step in zip(item.shape, item.chunks, strict=True)
    )  # fmt: skip
    written = item.id.get_num_chunks() if item.chunks else int(item.id.get_storage_size() > 0)
    if written < chunks:
        raise DataError(
            f"{path.name}: {written} of {chunks} parts of {name!r} were written; expected all of them, "
            "because the others would be read as a constant: record or export it again."
        )


def require_own_file(path: Path, opened: h5py.File) -> None:
    """Raise DataError if a link or data set refers to another file, or the sum expands too far."""
    total, room = 0, ROOM + ROOM_PER_BYTE * path.stat().st_size
    for name, link, item in _items(opened):
        if isinstance(link, h5py.ExternalLink):
            raise _elsewhere(path, name, f"a link to {link.filename!r}")
        if isinstance(item, h5py.Dataset):
            require_own_data(path, item)
            total += math.prod(item.shape or ()) * item.dtype.itemsize
            if total > room:
                raise DataError(
                    f"{path.name} has {path.stat().st_size} bytes and expands to more than {room}; "
                    "expected data of a similar size: it is damaged, or not a recording."
                )


def _items(group: h5py.Group) -> Iterator[tuple[str, Any, Any]]:
    """Yield name, link and item of all groups and data sets, once each."""
    left, seen = [group], set[Any]()
    while left:
        here = left.pop()
        for key in here:
            link = here.get(key, getlink=True)
            name = f"{str(here.name).rstrip('/')}/{key}"
            item = here[key] if isinstance(link, h5py.HardLink) else None
            if item is not None:
                address = h5py.h5o.get_info(item.id).addr  # pyright: ignore
                if address in seen:
                    continue
                seen.add(address)
            yield name, link, item
            if isinstance(item, h5py.Group):
                left.append(item)


def _elsewhere(path: Path, name: str, what: str) -> DataError:
    return DataError(
        f"{path.name}: {name!r} is {what}; expected data in the file itself, because other files are "
        "not followed: copy the data into it."
    )
