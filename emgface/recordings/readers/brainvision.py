"""BrainVision recordings: header (.vhdr), samples and markers (.vmrk).

Source: Brain Products, BrainVision Core Data Format 1.0. Segmented and averaged recordings, and
samples written as text, are refused.
"""

import codecs
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from emgface.errors import DataError
from emgface.recordings.exports.contract import NUMBER
from emgface.recordings.findings import Finding
from emgface.recordings.marks import Mark, is_bad_mark, unapplied_marks
from emgface.recordings.readers._build import (
    Part,
    assemble_parts,
    positive,
    unique_labels,
    voltages,
)
from emgface.recordings.readers._companion import companion_file
from emgface.recordings.readers._declared import rates_in_lines
from emgface.recordings.readers._filters import stated_band
from emgface.recordings.readers._flags import with_bad_samples
from emgface.recordings.readers._row_flags import with_row_flags
from emgface.recordings.timebase import of_rate, with_losses
from emgface.texts import decoded, marked_encoding

SUFFIXES = (".vhdr",)
FORMAT = "BrainVision"

_FORMATS = {"INT_16": "i2", "UINT_16": "u2", "INT_32": "i4", "IEEE_FLOAT_32": "f4"}
_LOST = re.compile(r"[^,]*,?\s*lost ?samples:?\s*(\d+)\s*,\s*(\d+).*", re.IGNORECASE)
_UNIT = "\u00b5V"  #: default unit of a channel, specified by the format


class _Channel(NamedTuple):
    label: str
    resolution: float
    unit: str


def companions(path: Path) -> list[Path]:
    """Return the files of samples and markers, if they exist, of a header."""
    common = _sections(path).get("Common Infos", {})
    named = [_companion(path, common.get(key, "")) for key in ("DataFile", "MarkerFile")]
    return [file for file in named if file is not None and file.is_file()]


def read(path: Path, units: Mapping[str, str]) -> xr.Dataset:
    """Read the channels that are voltages, from a header file.

    Raises DataError also if the recording was paused, segmented or averaged.
    """
    sections = _sections(path)
    common = sections.get("Common Infos", {})
    count = int(positive(path, "NumberOfChannels", common.get("NumberOfChannels", ""), int))
    interval = positive(path, "SamplingInterval", common.get("SamplingInterval", ""))
    rate = 1e6 / interval  # an interval in microseconds
    channels = [_channel(path, sections.get("Channel Infos", {}), i + 1) for i in range(count)]
    bad, lost, marks = _marked(path, common)
    samples = _samples(path, common, sections.get("Binary Infos", {}), count)
    labels, names = unique_labels([channel.label for channel in channels], "channel")
    values = [row * channel.resolution for row, channel in zip(samples, channels, strict=True)]
    witnesses = dict(zip(labels, values, strict=True))
    comment = list(sections.get("Comment", {}))
    base = of_rate(
        path.name, samples.shape[1], rate, by="SamplingInterval",
        others=rates_in_lines(comment), witnesses=witnesses,
    )  # fmt: skip
    base = with_losses(base, lost, "markers 'LostSamples'")
    stated = [channel.unit for channel in channels]
    part = voltages(values, labels, stated, base, units, names)
    for start, stop, channel, text in bad:
        inside = np.zeros(base.stored, dtype=bool)
        inside[start:stop] = True
        concerned = None if channel is None else labels[channel : channel + 1]
        part = with_bad_samples(part, "channel", base, inside, f"a marker {text!r}", concerned)
    part = with_row_flags(part, "channel", base, witnesses)
    timed = [
        mark._replace(start=mark.start / rate, duration=mark.duration / rate) for mark in marks
    ]
    part = part._replace(findings=[*part.findings, *unapplied_marks(timed, "marker")])
    filters = [one for name in _labels_of(part) for one in _hardware_filters(comment, name)]
    return assemble_parts([part._replace(findings=[*part.findings, *filters])])


def _labels_of(part: Part) -> list[str]:
    return [] if part.data is None else [str(name) for name in part.data["channel"].values]


def _hardware_filters(comment: Sequence[str], name: str) -> list[Finding]:
    """Findings on the edges of a channel in the table of filters of a comment, if it has one.

    The low edge is stated as a time constant in s or in Hz (or DC), by the head of its column.
    """
    heads = [
        k for k, line in enumerate(comment) if "Low Cutoff [" in line and "High Cutoff [" in line
    ]
    for head in heads:
        columns = re.split(r"\s{2,}", comment[head].strip())
        low = next(k for k, cell in enumerate(columns) if cell.startswith("Low Cutoff ["))
        for line in comment[head + 1 :]:
            cells = re.split(r"\s{2,}", line.strip())
            if len(cells) > low + 1 and cells[0].isdecimal() and cells[1] == name:
                edges = [float(c) if NUMBER.fullmatch(c) else 0.0 for c in cells[low : low + 2]]
                if "[s]" in columns[low] and edges[0] > 0.0:
                    edges[0] = 1.0 / (2.0 * np.pi * edges[0])
                return stated_band(name, *edges)
    return []


def _sections(path: Path) -> dict[str, dict[str, str]]:
    """Entries of a header or marker file by section; those of the comment are its lines."""
    data = path.read_bytes()
    if marked_encoding(data) not in (None, "utf-8-sig"):
        data = decoded(data, fallback="latin-1").encode()
    first = data[:100].splitlines()[0] if data else b""
    if b"Data Exchange" not in first or b"\x00" in data:
        raise DataError(
            f"{path.name} begins with {first[:40]!r}; expected 'Brain Vision Data Exchange': it is "
            "damaged or another format."
        )
    marked = data.startswith(codecs.BOM_UTF8) or b"Codepage=UTF-8" in data
    try:
        text = decoded(data)
    except UnicodeDecodeError as error:
        if marked:
            raise DataError(
                f"{path.name} declares the encoding UTF-8 but is not valid UTF-8 (byte "
                f"{error.start}); expected text in the declared encoding: it is damaged, "
                "export it again."
            ) from None
        text = decoded(data, "cp1252", fallback="latin-1")
    sections: dict[str, dict[str, str]] = {}
    entries: dict[str, str] = {}
    for line in text.splitlines():
        line = line.strip()
        if line.startswith("[") and line.endswith("]"):
            entries = sections.setdefault(line[1:-1], {})
        elif entries is sections.get("Comment"):
            entries[line] = ""
        elif "=" in line and not line.startswith(";"):
            key, _, value = line.partition("=")
            entries.setdefault(key.strip(), value.strip())
    return sections


def _channel(path: Path, entries: Mapping[str, str], number: int) -> _Channel:
    """Return label, value of one count and unit of a channel: ``Ch1=label,reference,0.5,uV``."""
    entry = entries.get(f"Ch{number}")
    if entry is None:
        raise DataError(
            f"{path.name} does not describe channel {number}; expected an entry 'Ch{number}' in "
            "[Channel Infos]: the header is damaged, export the recording again."
        )
    label, _, resolution, unit, *_ = [*entry.split(","), "", "", "", ""][:5]
    try:
        value = float(resolution or 1.0)
        if not 0.0 < value < np.inf:
            raise ValueError
    except ValueError:
        raise DataError(
            f"{path.name}, channel {label!r}: the resolution is {resolution!r}; expected a number "
            "above 0: the header is damaged, export the recording again."
        ) from None
    return _Channel(label.replace("\\1", ","), value, unit.strip() or _UNIT)


def _companion(path: Path, name: str) -> Path | None:
    """File specified by the header, in its folder; ``$b`` is the name of the header."""
    name = name.replace("$b", path.stem)
    plain = Path(name.replace("\\", "/")).name
    return companion_file(path.parent, plain, path.name) if plain else None


def _marked(
    path: Path, common: Mapping[str, str]
) -> tuple[list[tuple[int, int, int | None, str]], dict[int, int], list[Mark]]:
    """Intervals that markers call bad, numbers of lost samples by the index that they precede, others.

    An interval has its first sample, its end, its channel (None for all) and its text; the other
    markers are in samples. Refuses a recording that is not one continuous sequence of samples.
    """
    kind, domain = common.get("SegmentationType", ""), common.get("DataType", "TIMEDOMAIN")
    if kind not in ("", "NOTSEGMENTED") or domain != "TIMEDOMAIN" or "AveragedSegments" in common:
        raise DataError(
            f"{path.name} contains {kind or domain} data; expected one continuous recording: export "
            "the raw data."
        )
    markers = _companion(path, common.get("MarkerFile", ""))
    bad: list[tuple[int, int, int | None, str]] = []
    lost = dict[int, int]()
    marks: list[Mark] = []
    if markers is None or not markers.is_file():
        return bad, lost, marks
    for entry in _sections(markers).get("Marker Infos", {}).values():
        cells = entry.split(",")
        if cells[0] == "New Segment" and len(cells) > 2 and cells[2].strip() not in ("0", "1"):
            raise DataError(
                f"{path.name} was paused: a new segment begins at sample {cells[2]}; expected a "
                "continuous recording: export each part as a separate file."
            )
        if loss := _LOST.fullmatch(entry):
            lost[int(loss[2]) - 1] = int(loss[1])
        text = cells[0].strip() if cells[0].strip() == "Bad Interval" else "".join(cells[1:2])
        if len(cells) > 4 and (text == "Bad Interval" or is_bad_mark(text)):
            numbers = [cell.strip() for cell in cells[2:5]]
            if all(number.isascii() and number.isdigit() for number in numbers):
                start, size, channel = map(int, numbers)
                place = channel - 1 if channel else None
                bad.append((max(start - 1, 0), start - 1 + size, place, text))
        elif len(cells) > 3 and cells[2].strip().isdecimal() and cells[3].strip().isdecimal():
            words = cells[1:2] if cells[0].strip() == "Comment" else cells[:2]
            marks.append(Mark(int(cells[2]) - 1, int(cells[3]), ",".join(words).strip(", ")))
    return bad, lost, marks


def _samples(
    path: Path, common: Mapping[str, str], binary: Mapping[str, str], count: int
) -> np.ndarray:
    """Return the stored counts, shape (channels, samples)."""
    kind, order = binary.get("BinaryFormat", ""), common.get("DataOrientation", "MULTIPLEXED")
    if (
        common.get("DataFormat", "BINARY") != "BINARY"
        or kind not in _FORMATS
        or order not in ("MULTIPLEXED", "VECTORIZED")
    ):
        raise DataError(
            f"{path.name} stores {common.get('DataFormat', 'BINARY')} {kind or 'no format'} "
            f"{order}; expected BINARY samples as {', '.join(_FORMATS)}, MULTIPLEXED or "
            "VECTORIZED: export it in one of these."
        )
    file = _companion(path, common.get("DataFile", ""))
    if file is None or not file.is_file():
        raise DataError(
            f"{path.name} refers to the samples {common.get('DataFile', '')!r}, which are "
            "not in its folder; expected that file: copy it, or correct DataFile after "
            "renaming."
        )
    big = binary.get("UseBigEndianOrder", "NO").upper() == "YES"
    data, dtype = file.read_bytes(), np.dtype((">" if big else "<") + _FORMATS[kind])
    width = count * dtype.itemsize
    announced = common.get("DataPoints")
    contained = len(data) / width
    if (
        contained != int(contained)
        or contained < 1
        or (announced is not None and announced != f"{contained:.0f}")
    ):
        raise DataError(
            f"{file.name} contains {contained:.6g} samples of {count} channels and {path.name} declares "
            f"{announced or 'a whole number'}; expected all of them: it is truncated or damaged, "
            "copy it again."
        )
    stored = np.frombuffer(data, dtype).astype(np.float64)
    if order == "VECTORIZED":
        return stored.reshape(count, -1)
    return np.ascontiguousarray(stored.reshape(-1, count).T)
