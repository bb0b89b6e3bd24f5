"""Consistency check of the sections of a C3D file, before it is parsed.

The parser is compiled code that does not check counts and offsets; damaged ones may cause a crash
or unbounded allocation. Source: C3D.org, The C3D file format user guide, 2008: header of 256 words,
chain of group and parameter records, frames of points and analog samples.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from emgface.errors import DataError

_BLOCK = 512
_ORDERS = {84: "<", 85: "<", 86: ">"}  #: byte order by processor: Intel, DEC, MIPS
_SIZES = {-1: 1, 1: 1, 2: 2, 4: 4}
_MOST_DIMS = 7


class _Record(NamedTuple):
    group: int
    name: str
    kind: int
    dims: tuple[int, ...]
    data: bytes


def check_structure(path: Path) -> None:
    """Raise DataError if the sections of a C3D file are inconsistent."""
    data = path.read_bytes()
    if len(data) < 2 * _BLOCK or data[1] != 0x50 or data[0] < 2:
        raise _error(path, f"has {len(data)} bytes and begins with {data[:2]!r}", "a header")
    start = (data[0] - 1) * _BLOCK
    if start + 4 > len(data) or data[start + 3] not in _ORDERS:
        raise _error(path, "specifies no processor", "a parameter section")
    order = _ORDERS[data[start + 3]]
    if order == ">":
        raise DataError(
            f"{path.name} is a C3D file in the byte order of SGI and MIPS computers, which is not "
            "supported; expected that of Intel or DEC: convert it in the program that wrote it."
        )
    end = start + data[start + 2] * _BLOCK
    if not start < end <= len(data):
        raise _error(path, f"has parameters up to byte {end} of {len(data)}", "all of them")
    groups: dict[int, str] = {}
    parameters: dict[tuple[str, str], _Record] = {}
    for record in _records(path, data, start + 4, end, order):
        if record.group < 0:
            groups[-record.group] = record.name
    for record in _records(path, data, start + 4, end, order):
        if record.group > 0:
            if record.group not in groups:
                raise _error(path, f"has {record.name!r} in no group", "a group for each parameter")
            parameters[groups[record.group], record.name] = record
    _check_counts(path, data, parameters, order)


def _records(path: Path, data: bytes, at: int, end: int, order: str) -> Iterator[_Record]:
    """Yield the linked list of groups and parameters."""
    while True:
        if at + 2 > end:
            raise _error(path, "has parameters without an end", "a chain of records")
        length, group = struct.unpack_from("bb", data, at)
        length = abs(length)
        if length == 0:
            return
        name = data[at + 2 : at + 2 + length]
        here = at + 2 + length
        if group == 0 or here + 2 > end or not (name.isascii() and name.decode().isprintable()):
            raise _error(path, f"has a parameter called {name!r}", "readable names")
        offset = struct.unpack_from(f"{order}h", data, here)[0]
        following = here + offset if offset else end
        if offset < 0 or following > end:
            raise _error(path, f"leads from {name.decode()!r} out of its parameters", "a chain")
        kind, dims, content = 0, (), b""
        if group > 0:
            kind, count = struct.unpack_from("bB", data, here + 2)
            dims = tuple(data[here + 4 : here + 4 + count])
            size = abs(_SIZES.get(kind, 0))
            for dim in dims:
                size *= dim
            first = here + 4 + count
            if kind not in _SIZES or count > _MOST_DIMS or first + size + 1 > following:
                raise _error(
                    path,
                    f"gives {name.decode()!r} the type {kind} and dims {dims}",
                    "a value that fits",
                )
            content = data[first : first + size]
            described = first + size
        else:
            described = here + 2
        if described + 1 + data[described] > following:
            raise _error(path, f"describes {name.decode()!r} beyond its record", "texts that fit")
        yield _Record(group, name.decode(), kind, dims, content)
        if not offset:
            return
        at = following


def _check_counts(
    path: Path, data: bytes, parameters: dict[tuple[str, str], _Record], order: str
) -> None:
    """Compare counts of header and parameters with the length of the file."""
    points, per_frame, first, last = struct.unpack_from(f"{order}4H", data, 2)
    block, samples = struct.unpack_from(f"{order}2H", data, 16)
    numbers = {
        name: _integer(parameters.get(name), order)
        for name in (("POINT", "USED"), ("ANALOG", "USED"), ("POINT", "DATA_START"))
    }
    used, channels, start = numbers.values()
    if used is not None and used != points:
        raise _error(
            path, f"has {points} points in its header and {used} in POINT:USED", "one count"
        )
    if channels is not None and channels * max(samples, 1) != per_frame and channels:
        raise _error(
            path,
            f"has {per_frame} analog samples in a frame and {channels} channels of {samples}",
            "their product",
        )
    if start not in (None, 0, block):  # some programs leave it at 0
        raise _error(path, f"begins its data at block {block} and {start}", "one place")
    needed = [("POINT", "SCALE", 1), ("POINT", "RATE", 1)] if points else []
    if channels:
        each = min(channels, 255)  # further ones are in SCALE2
        needed += [("ANALOG", "RATE", 1)]
        needed += [("ANALOG", "SCALE", each), ("ANALOG", "OFFSET", each)]
    for group, name, least in needed:
        record = parameters.get((group, name))
        if record is None or record.kind < 2 or len(record.data) < least * record.kind:
            raise _error(path, f"has no {group}:{name} of {least} numbers", "one for each channel")
    frames = last - first + 1 if last >= first else 0
    empty = not (points or per_frame)
    # Numbers of frames beyond 16 bits are stored elsewhere.
    if (block - 1) * _BLOCK > len(data) or (empty and frames > 1 and last != 65535):
        raise _error(path, f"begins its data at byte {(block - 1) * _BLOCK} of {len(data)}", "data")


def _integer(record: _Record | None, order: str) -> int | None:
    if record is None or len(record.data) < 2 or record.kind != 2:
        return None
    return struct.unpack_from(f"{order}H", record.data)[0]


def _error(path: Path, fault: str, expected: str) -> DataError:
    return DataError(
        f"{path.name} cannot be read as C3D: it {fault}; expected {expected}: it is damaged or "
        "another format, export it again."
    )
