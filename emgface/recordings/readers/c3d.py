"""C3D files of motion capture: markers and analog EMG of one trial, through ezc3d."""

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from emgface.errors import DataError
from emgface.recordings.findings import Finding
from emgface.recordings.marks import Mark, unapplied_marks
from emgface.recordings.readers._build import (
    Part,
    assemble_parts,
    position_array,
    unique_labels,
    voltages,
)
from emgface.recordings.readers._c3d_structure import check_structure
from emgface.recordings.readers._isolated import parsed
from emgface.recordings.readers._parsers import parse_c3d
from emgface.recordings.readers._row_flags import with_row_flags
from emgface.recordings.timebase import of_rate

SUFFIXES = (".c3d",)
FORMAT = "C3D"

_NO_POSITION = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")
"""Parameters of POINT that list points which are not positions."""


def read(path: Path, units: Mapping[str, str]) -> xr.Dataset:
    """Read markers and the analog channels that are voltages; time is 0 at the first stored frame.

    A position is NaN in frames in which the marker was not visible.
    """
    content = _open(path)
    marks = Part(findings=unapplied_marks(_events(content), "event"))
    return assemble_parts([_analogs(content, units), _points(content, units), marks])


def _open(path: Path) -> dict[str, Any]:
    """Read the file, and refuse one with fewer frames than declared."""
    check_structure(path)
    content = parsed(path, parse_c3d, path)
    # ezc3d reads a truncated file up to its end and adapts its counts without a warning.
    announced, frames = _announced_frames(path, content), content["points"].shape[2]
    content["header_rate"] = _header_rate(path)
    if announced is not None and frames < announced:
        raise DataError(
            f"{path.name} declares {announced} frames but contains {frames}; expected all of them: "
            "it is truncated, copy or export it again."
        )
    return content


def _announced_frames(path: Path, content: Mapping[str, Any]) -> int | None:
    """Frames from TRIAL:ACTUAL_START_FIELD and _END_FIELD, or otherwise from the header."""
    trial = content["parameters"].get("TRIAL", {})
    fields = [
        [int(v) % 65536 for v in trial[name]]
        for name in ("ACTUAL_START_FIELD", "ACTUAL_END_FIELD")
        if name in trial and len(trial[name]) == 2
    ]
    if len(fields) == 2:
        first, last = (low + 65536 * high for low, high in fields)
        return last - first + 1
    with path.open("rb") as stream:
        header = stream.read(512)
        stream.seek((header[0] - 1) * 512 + 3)
        processor = stream.read(1)
    order = ">u2" if processor == b"\x56" else "<u2"  # 86 is big-endian (MIPS)
    first, last = (int(v) for v in np.frombuffer(header[6:10], order))
    # Counts beyond 16 bits are written as 65535.
    return last - first + 1 if last < 65535 else None


def _header_rate(path: Path) -> float | None:
    """Frame rate of the header [Hz]; None if it is not stated, or in the format of a DEC processor."""
    with path.open("rb") as stream:
        header = stream.read(512)
        stream.seek((header[0] - 1) * 512 + 3)
        processor = stream.read(1)
    if processor not in (b"\x54", b"\x56"):
        return None
    (rate,) = struct.unpack_from(">f" if processor == b"\x56" else "<f", header, 20)
    return float(rate) if 0.0 < rate < 1e6 else None


def _strings(group: Any, name: str) -> list[str]:
    """Strings of a parameter and of its continuations NAME2, NAME3 ... beyond 255."""
    strings = [str(v) for v in group.get(name, [])]
    number = 2
    while f"{name}{number}" in group:
        strings += [str(v) for v in group[f"{name}{number}"]]
        number += 1
    return strings


def _rate(group: Any, what: str) -> float:
    values = np.atleast_1d(group.get("RATE", []))
    if values.size == 0 or not values[0] > 0:
        raise DataError(
            f"The file specifies no sampling rate of its {what}; expected {what}:RATE above 0 Hz: "
            "set it in the program that wrote the file."
        )
    return float(values[0])


def _points(content: Mapping[str, Any], units: Mapping[str, str]) -> Part:
    """Marker positions, NaN where a marker is not visible."""
    values = content["points"][:3]
    group = content["parameters"]["POINT"]
    count, frames = values.shape[1:]
    if count == 0 or frames == 0:
        return Part()
    given = _strings(group, "LABELS")[:count]
    labels, changed = unique_labels(given + [""] * (count - len(given)), "marker")
    other = {label: kind for kind in _NO_POSITION for label in _strings(group, kind)}
    dropped = {
        label: f"POINT:{other[label]} lists it, so it is not a position"
        for label in labels
        if label in other
    }
    keep = [i for i, label in enumerate(labels) if label not in dropped]
    if not keep:
        return Part(None, {}, dropped, changed)
    # ezc3d returns NaN for points with a negative residual, which were not visible.
    seen = values[:, keep]
    stated = (_strings(group, "UNITS") or [""])[0]
    unit = units.get("position", stated)
    base = of_rate(
        "POINT",
        frames,
        _rate(group, "POINT"),
        by="POINT:RATE",
        others={
            "the header": content["header_rate"],
            "TRIAL:CAMERA_RATE": _number(content, "TRIAL", "CAMERA_RATE"),
        },
    )
    part = position_array(
        np.ascontiguousarray(seen.transpose(1, 0, 2)), [labels[i] for i in keep], base, unit
    )
    findings = _interpolated(content["residuals"][0][keep], [labels[i] for i in keep])
    return Part(part, {"position": stated}, dropped, changed, findings)


def _interpolated(residuals: np.ndarray, labels: list[str]) -> list[Finding]:
    """Findings on markers with positions whose residual is 0, which no camera measured.

    A file in which all residuals are 0 does not state them.
    """
    if not (residuals > 0).any():
        return []
    findings: list[Finding] = []
    for label, row in zip(labels, residuals, strict=True):
        computed = int((row == 0).sum())
        if computed:
            values = {"frames": computed, "share": computed / row.size, "by": "their residual of 0"}
            findings.append(Finding("interpolated", "marker", label, values))
    return findings


def _events(content: Mapping[str, Any]) -> list[Mark]:
    """Events of the group EVENT, whose times [min, s] count from the first frame of the camera."""
    group = content["parameters"].get("EVENT", {})
    times = np.atleast_2d(np.array(group.get("TIMES", []), dtype=float))
    labels = _strings(group, "LABELS")
    if times.shape != (2, len(labels)):
        return []
    first, rate = content["first_frame"], _number(content, "POINT", "RATE")
    start = first / rate if rate else 0.0
    seconds = 60.0 * times[0] + times[1] - start
    return [Mark(float(at), 0.0, text) for at, text in zip(seconds, labels, strict=True)]


def _number(content: Mapping[str, Any], group: str, name: str) -> float | None:
    value = np.atleast_1d(content["parameters"].get(group, {}).get(name, []))
    return float(value[0]) if value.size and value.dtype.kind in "iuf" else None


def _unsigned(content: Mapping[str, Any]) -> np.ndarray:
    """Analog values, with counts that ANALOG:FORMAT declares unsigned read as such.

    The parser reads 16-bit counts as signed, value = (count - OFFSET) SCALE GEN_SCALE, and an OFFSET
    above 32767 as either; the sum with OFFSET is therefore exact modulo 2^16.
    Numbers stored as floats (a negative POINT:SCALE) have no such format.
    """
    values = content["analogs"][0]
    group = content["parameters"]["ANALOG"]
    kind = (_strings(group, "FORMAT") or [""])[0].strip().upper()
    stored = _number(content, "POINT", "SCALE")
    if kind != "UNSIGNED" or stored is None or stored <= 0 or not values.size:
        return values
    count = len(values)
    scale = _numbers(group, "SCALE")[:count] * (_number(content, "ANALOG", "GEN_SCALE") or 1.0)
    offset = _numbers(group, "OFFSET")[:count]
    if scale.size != count or offset.size != count or (scale == 0).any():
        return values
    counts = np.mod(np.rint(values / scale[:, None] + offset[:, None]), 65536)
    zero = np.mod(offset, 65536)
    return (counts - zero[:, None]) * scale[:, None]


def _numbers(group: Any, name: str) -> np.ndarray:
    """Numbers of a parameter and of its continuations NAME2, NAME3 ... beyond 255."""
    parts = [np.atleast_1d(group.get(name, [])).astype(float)]
    number = 2
    while f"{name}{number}" in group:
        parts.append(np.atleast_1d(group[f"{name}{number}"]).astype(float))
        number += 1
    return np.concatenate(parts)


def _analogs(content: Mapping[str, Any], units: Mapping[str, str]) -> Part:
    """Analog channels that are voltages, each converted from its own unit."""
    values = _unsigned(content)
    group = content["parameters"]["ANALOG"]
    count, samples = values.shape
    if count == 0 or samples == 0:
        return Part()
    given = _strings(group, "LABELS")[:count]
    labels, changed = unique_labels(given + [""] * (count - len(given)), "channel")
    stated = _strings(group, "UNITS")[:count]
    stated += [""] * (count - len(stated))
    columns = dict(zip(labels, values, strict=True))
    rate, frames = _rate(group, "ANALOG"), content["points"].shape[2]
    frame_rate = _number(content, "POINT", "RATE")
    base = of_rate(
        "ANALOG",
        samples,
        rate,
        by="ANALOG:RATE",
        others={
            "POINT:RATE and the samples of a frame": frame_rate * samples / frames
            if frames and frame_rate
            else None
        },
        witnesses=columns,
    )
    part = voltages(values, labels, stated, base, units, changed)
    return with_row_flags(part, "channel", base, columns)
