"""XDF recordings of the Lab Streaming Layer: EMG and motion capture on one clock, read by pyxdf.

A stream of type EMG, or one of several kinds whose channels are of type EMG, contains the EMG. A
stream of type MoCap contains markers: three channels of type PositionX, PositionY and PositionZ
each, with the entry ``marker``. Source: the XDF 1.0 specification and its metadata for EEG and
MoCap (sccn/xdf).
"""

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from emgface.errors import DataError, UnitsError, listed
from emgface.recordings.exports.contract import NUMBER
from emgface.recordings.findings import Finding, Kind
from emgface.recordings.marks import Mark, unapplied_marks
from emgface.recordings.readers._build import (
    Part,
    assemble_parts,
    left_out,
    one_unit,
    position_array,
    unique_labels,
    voltages,
)
from emgface.recordings.readers._declared import declared_conversions
from emgface.recordings.readers._isolated import parsed
from emgface.recordings.readers._parsers import parse_xdf
from emgface.recordings.readers._row_flags import with_row_flags
from emgface.recordings.timebase import TimeBase, of_stamps, with_counter

SUFFIXES = (".xdf",)
FORMAT = "XDF"

_AXES = ("positionx", "positiony", "positionz")
_LENGTHS = {1: "B", 4: "<I", 8: "<Q"}
_STREAM_CHUNKS = (2, 3, 4, 6)


def read(path: Path, units: Mapping[str, str]) -> xr.Dataset:
    """Read the EMG stream and the markers.

    Time is 0 at the first sample of any stream that is read, so that EMG and markers remain
    synchronous; other streams are listed in ``dropped``. Samples lost on the way are gaps at the
    nominal rate. Raises DataError also if the times of a stream cannot be those of its samples, or
    there are two EMG streams.
    """
    _check_chunks(path)
    streams = parsed(path, parse_xdf, path)
    texts = [stream for stream in streams if "texts" in stream]
    streams = [stream for stream in streams if len(stream["time"]) and "texts" not in stream]
    emg = [stream for stream in streams if _emg_channels(stream)]
    markers = [stream for stream in streams if stream["type"].lower() == "mocap"]
    for kind, candidates in (("EMG", emg), ("MoCap", markers)):
        if len(candidates) > 1:
            names = listed([stream["name"] for stream in candidates])
            raise DataError(
                f"{path.name} contains {len(candidates)} streams of {kind} ({names}); expected "
                "one: save each as a separate file."
            )
    used = emg + markers
    for stream in used:
        _require_whole(path, stream)
    bases = [_time_base(path, stream) for stream in used]
    start = min((float(base.times[0]) for base in bases), default=0.0)
    dropped = {
        f"stream {stream['name']}": f"of type {stream['type']!r}, neither EMG nor MoCap"
        for stream in streams
        if stream not in used
    }
    clocks = [base.moved(-start) for base in bases]
    parts = [_emg(path, stream, clocks[0], units) for stream in emg]
    parts += [_markers(path, stream, clocks[-1], units.get("position")) for stream in markers]
    if parts:
        marks = [
            Mark(float(at) - start, 0.0, text)
            for stream in texts
            for at, text in zip(stream["time"], stream["texts"], strict=True)
        ]
        parts.append(Part(findings=unapplied_marks(marks, "mark")))
    return assemble_parts([*parts, Part(None, {}, dropped, {})])


def _check_chunks(path: Path) -> None:
    """Refuse a file whose chunks are not contiguous to its end, which pyxdf would skip."""
    data = path.read_bytes()
    at = 4
    known: set[int] = set()
    while data[:4] == b"XDF:" and at < len(data):
        code = _LENGTHS.get(data[at])
        size = struct.calcsize(code) if code else 0
        if code is None or at + 1 + size + 2 > len(data):
            break
        (length,) = struct.unpack_from(code, data, at + 1)
        first = at + 1 + size
        (tag,) = struct.unpack_from("<H", data, first)
        if length < 2 or first + length > len(data) or not 1 <= tag <= 6:
            break
        if tag in _STREAM_CHUNKS:
            if length < 6:
                break
            (stream,) = struct.unpack_from("<I", data, first + 2)
            if tag != 2 and stream not in known:
                break
            known.add(stream)
        at = first + length
    if data[:4] != b"XDF:" or at != len(data) or not known:
        raise DataError(
            f"{path.name} has {len(data)} bytes but its chunks end at byte {at}; expected "
            "'XDF:' and complete chunks to the end of the file: it is truncated or damaged, "
            "copy it again."
        )


def _require_whole(path: Path, stream: Mapping[str, Any]) -> None:
    """Refuse a stream that does not contain the samples that it declares."""
    stored, announced = len(stream["time"]), stream["announced"]
    if announced is not None and announced != stored:
        raise DataError(
            f"{path.name}, stream {stream['name']!r}, declares {announced} samples but contains "
            f"{stored}; expected all of them: it is damaged, copy it again."
        )


def _time_base(path: Path, stream: Mapping[str, Any]) -> TimeBase:
    """Instants of the samples by their time stamps, which jitter, the nominal rate, and counters."""
    nominal = float(stream["rate"])
    base = of_stamps(
        f"{path.name}, stream {stream['name']!r}",
        stream["time"],
        nominal=nominal,
        by="the time stamps",
        jittered=nominal > 0,
        irregular=not nominal > 0,
    )
    labels = unique_labels(
        [_text(stream, i, "label") for i in range(stream["values"].shape[1])], "channel"
    )[0]
    return with_counter(base, dict(zip(labels, stream["values"].T, strict=True)))


def _emg_channels(stream: Mapping[str, Any]) -> list[int]:
    """Indices of the channels that are EMG."""
    count = stream["values"].shape[1] if stream["values"].ndim == 2 else 0
    kinds = [channel.get("type", "").lower() for channel in stream["channels"]]
    if stream["type"].lower() == "emg":
        described = dict(enumerate(kinds))
        return [i for i in range(count) if described.get(i, "emg") in ("emg", "")]
    return [i for i, kind in enumerate(kinds[:count]) if kind == "emg"]


def _conversions(
    path: Path, stream: Mapping[str, Any], channels: Sequence[int], kind: Kind
) -> list[Finding]:
    """Findings on numbers such as ``gain`` in the descriptions of channels, which were not applied."""
    statements: dict[str, list[float | str]] = {}
    for i in channels:
        described: Mapping[str, str] = stream["channels"][i] if i < len(stream["channels"]) else {}
        for key, text in described.items():
            if NUMBER.fullmatch(text.strip()) and key != "scaling_factor":  # which `_emg` refuses
                values = statements.setdefault(key, [])
                values += [] if float(text) in values else [float(text)]
    return declared_conversions(path, statements, kind, False, conversion="unapplied_conversion")


def _emg(path: Path, stream: Mapping[str, Any], base: TimeBase, units: Mapping[str, str]) -> Part:
    """Channels of EMG, each converted from its own unit; the others of the stream are listed."""
    chosen = _emg_channels(stream)
    count = stream["values"].shape[1]
    every, names = unique_labels([_text(stream, i, "label") for i in range(count)], "channel")
    labels = [every[i] for i in chosen]
    for i, label in zip(chosen, labels, strict=True):
        factor = _text(stream, i, "scaling_factor").strip()
        if factor not in ("", "1", "1.0") and not {label, "emg"} & set(units):
            raise UnitsError(
                f"the channel {label!r} states scaling_factor = {factor} and the unit "
                f"{_text(stream, i, 'unit')!r}; expected values in their unit: it is not known whether "
                "they were multiplied by it, export them converted, or specify the unit of the stored "
                "values by an entry in the table 'units' of the mapping."
            )
    values = [stream["values"][:, i] for i in chosen]
    stated = [_text(stream, i, "unit") for i in chosen]
    part = voltages(values, labels, stated, base, units, names)
    given = {labels[k] for k in range(len(labels)) if {labels[k], "emg"} & set(units)}
    findings = _conversions(path, stream, [i for i in chosen if every[i] not in given], "channel")
    part = part._replace(findings=[*part.findings, *findings])
    columns = dict(zip(every, stream["values"].T, strict=True))
    part = with_row_flags(part, "channel", base, columns)
    left = [
        left_out(every[i], kind=_text(stream, i, "type")) for i in range(count) if i not in chosen
    ]
    dropped = {finding.name: finding.clause for finding in left}
    return part._replace(findings=[*part.findings, *left], dropped={**part.dropped, **dropped})


def _markers(path: Path, stream: Mapping[str, Any], base: TimeBase, unit: str | None) -> Part:
    """Markers of a motion capture stream, with the three coordinates of each combined."""
    by_marker: dict[str, dict[str, int]] = {}
    for i, channel in enumerate(stream["channels"]):
        axis = channel.get("type", "").lower()
        if axis in _AXES:
            name = channel.get("marker") or channel.get("label", "")
            by_marker.setdefault(name, {})[axis] = i
    whole = {name: axes for name, axes in by_marker.items() if len(axes) == len(_AXES)}
    if not whole:
        raise DataError(
            f"{path.name}, stream {stream['name']!r}, does not describe a marker with three "
            "coordinates; expected channels of type PositionX, PositionY and PositionZ with "
            "the entry 'marker'."
        )
    labels, names = unique_labels(list(whole), "marker")
    order = [[axes[axis] for axis in _AXES] for axes in whole.values()]
    places = [column for columns in order for column in columns]
    stated = one_unit(
        [_text(stream, i, "unit") for i in places], unit, f"stream {stream['name']!r}"
    )
    values = np.stack([stream["values"][:, columns].T for columns in order])
    data = position_array(values, labels, base, unit or stated)
    dropped = {name: "lacks a coordinate" for name in by_marker if name not in whole}
    every = [_text(stream, i, "label") for i in range(stream["values"].shape[1])]
    columns = dict(zip(unique_labels(every, "channel")[0], stream["values"].T, strict=True))
    findings = [] if unit else _conversions(path, stream, places, "marker")
    part = Part(data, {"position": stated}, dropped, names, findings)
    return with_row_flags(part, "marker", base, columns)


def _text(stream: Mapping[str, Any], index: int, name: str) -> str:
    """Entry of the description of a channel, empty if it does not exist."""
    channels: Sequence[Mapping[str, str]] = stream["channels"]
    return channels[index].get(name, "") if index < len(channels) else ""
