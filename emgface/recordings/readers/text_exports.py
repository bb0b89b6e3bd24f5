"""Text exports of recording programs, which state their rates, labels and units themselves.

The layouts are modules of `emgface.recordings.exports`. Signals other than EMG, for example
accelerometers, and processed ones are left out with the reason; if EMG was recorded at several
rates, that of most channels is read.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import xarray as xr

from emgface.errors import DataError, EmgfaceError, UnitsError
from emgface.recordings import exports
from emgface.recordings.counters import counter_of
from emgface.recordings.ends import doubtful_lines
from emgface.recordings.exports import EXPORTS, head_of, layout_in, layout_of
from emgface.recordings.exports.contract import Column, Export, delimiter_of
from emgface.recordings.findings import Finding
from emgface.recordings.kinds import kind_of_name
from emgface.recordings.readers._build import (
    Part,
    assemble_parts,
    left_out_by_rate,
    unique_labels,
    voltages,
)
from emgface.recordings.readers._row_flags import may_flag_rows, unused_flags
from emgface.recordings.timebase import TimeBase, of_rate, of_stamps, with_counter
from emgface.schema.units import quantity_of
from emgface.texts import read_text, read_toml

SUFFIXES: tuple[str, ...] = exports.SUFFIXES
FORMAT: str = f"text exports of {', '.join(one.NAME for one in EXPORTS)}"

SAME_RATE: Final = 2e-3  #: largest relative difference of two rates that are the same
TRIMMED: Final = 0.05
"""Time [s] at the ends that is cut off if sensors do not begin and end with the same sample."""


class _Signal(NamedTuple):
    label: str
    unit: str
    values: np.ndarray
    base: TimeBase


def is_recording(path: Path) -> bool:
    """Return True for an export of a known layout that no sidecar in its folder describes."""
    if layout_of(path) is None:
        return False
    return path.resolve() not in described_files(path.parent)


def described_files(folder: Path) -> frozenset[Path]:
    """Return the files that the sidecars of a folder describe, as absolute paths without links."""
    return _described(folder.resolve(), folder.stat().st_mtime_ns)


@lru_cache(maxsize=64)
def _described(folder: Path, changed: int) -> frozenset[Path]:
    """Files that the sidecars of a folder describe."""
    files: set[Path] = set()
    for sidecar in folder.iterdir():
        if sidecar.suffix.lower() != ".toml":
            continue
        try:
            content = read_toml(sidecar)
        except EmgfaceError:
            continue
        for part in ("emg", "position"):
            table = content.get(part)
            name = table.get("file") if isinstance(table, dict) else None
            if isinstance(name, str):
                files.add((folder / name).resolve())
    return frozenset(files)


def read(path: Path, units: Mapping[str, str]) -> xr.Dataset:
    """Read the EMG of an export.

    Raises DataError also if the file is a table of another layout, which needs a sidecar.
    """
    return of_export(path, export_of(path), units)


def export_of(path: Path) -> Export:
    """Return all signals of an export; DataError for a table of no known layout."""
    try:
        text = read_text(path, fallback="latin-1").replace("\r\n", "\n").replace("\r", "\n")
    except OSError as error:
        raise DataError(
            f"{path.name} cannot be read ({error.strerror}); expected a text file."
        ) from error
    head = head_of(text)
    layout = layout_in(head)
    if layout is None:
        raise DataError(needs_sidecar(path))
    export = layout.read(path, text, head)
    last = text.rstrip("\x00\x1a \n").rpartition("\n")[2]
    return replace(export, findings=[*export.findings, *doubtful_lines(text, delimiter_of(last))])


def needs_sidecar(path: Path) -> str:
    """Return the message for a table that does not describe itself."""
    sidecar = path.with_suffix(".toml")
    named = f"specify {sidecar.name}, which is in the same folder"
    return (
        f"{path.name} does not specify its contents, rate and units, and is no export of "
        f"{', '.join(one.NAME for one in EXPORTS)}; expected a TOML sidecar that does: "
        f"{named if sidecar.is_file() else 'draft one with emgface describe'} instead."
    )


def of_export(path: Path, export: Export, units: Mapping[str, str]) -> xr.Dataset:
    """Return the recording of the EMG among the signals of an export."""
    return assemble_parts([part_of(path, export, units)], device=export.device)


def part_of(path: Path, export: Export, units: Mapping[str, str], lacking: str = "") -> Part:
    """Return the EMG among the signals of an export; `lacking` is the unit of those without one."""
    if lacking:
        columns = [c if c.unit.strip() else replace(c, unit=lacking) for c in export.columns]
        export = replace(export, columns=columns)
    columns = list(export.columns)
    labels, names = unique_labels([column.label for column in columns], "channel")
    dropped: dict[str, str] = {}
    left: list[Finding] = []
    signals: list[_Signal] = []
    counters = {
        label: column.values
        for label, column in zip(labels, columns, strict=True)
        if counter_of(column.values) is not None
    }
    for label, column in zip(labels, columns, strict=True):
        if label in units:
            column = replace(column, unit=units[label])
        reason = left_out(column, units.get("emg"))
        reason = reason or ("a counter of the samples, not EMG" if label in counters else "")
        if reason:
            dropped[label] = reason
            kind = kind_of_name(column.label) or ""
            values = {"unit": column.unit.strip(), "type": kind, "why": reason}
            left.append(Finding("left_out", "channel", label, values))
            continue
        base = with_counter(_base(path, label, column), _of_size(counters, column))
        signals.append(_Signal(label, column.unit, column.values, base))
    if not signals:
        if columns and all(reason == "has no unit" for reason in dropped.values()):
            raise UnitsError(
                f"None of the {len(columns)} signals of {path.name} has a unit; expected V, mV or uV: "
                "specify it as emg in the table 'units' of the mapping."
            )
        return Part(None, {}, dropped, names, left)
    rates = [signal.base.rate for signal in signals]
    chosen = max(rates, key=lambda rate: (sum(_same(rate, other) for other in rates), rate))
    used = [signal for signal in signals if _same(signal.base.rate, chosen)]
    for signal in signals:
        if not _same(signal.base.rate, chosen):
            left.append(left_out_by_rate(signal.label, signal.base.rate, chosen))
            dropped[signal.label] = left[-1].clause
    kept = {signal.label for signal in used}
    names = {label: old for label, old in names.items() if label in kept or label in dropped}
    part = _together(path, used, units, dropped, names)
    of_file = [replace(finding, kind="channel") for finding in export.findings]
    of_file += _counted([column for column in columns if not left_out(column, units.get("emg"))])
    flags = [
        label
        for label, column in zip(labels, columns, strict=True)
        if label in dropped and may_flag_rows(label, column.values)
    ]
    unused = unused_flags(flags, "channel")
    return part._replace(findings=[*of_file, *left, *unused, *part.findings])


def _counted(columns: Sequence[Column]) -> list[Finding]:
    """Finding on the first signal that has another number of samples than the header states."""
    return [
        Finding("sample_count", "channel", "", {"held": one.values.size, "stated": one.stated})
        for one in columns
        if one.stated is not None and one.stated != one.values.size
    ][:1]


def left_out(column: Column, unit: str | None = None) -> str:
    """Return the reason why a signal is not read as EMG; empty if it is."""
    if column.apart:
        return column.apart
    if column.unit.strip() and quantity_of(column.unit) != "voltage":
        return f"in {column.unit!r}, not a voltage"
    named = kind_of_name(column.label)
    if named is not None:
        return f"of type {named}, not EMG"
    if column.values.size == 0:
        return "has no samples"
    if not column.unit.strip() and unit is None:
        return "has no unit"
    return ""


def _of_size(counters: Mapping[str, np.ndarray], column: Column) -> dict[str, np.ndarray]:
    """Counters of the samples of a signal, which have as many."""
    return {name: one for name, one in counters.items() if one.size == column.values.size}


def _same(rate: float, other: float) -> bool:
    return abs(rate / other - 1.0) <= SAME_RATE


def _base(path: Path, label: str, column: Column) -> TimeBase:
    """Time base of a signal by its column of times and the rate that the file states."""
    where = f"{path.name}, {label}"
    if column.time is None:
        return of_rate(where, column.values.size, column.rate or float("nan"), by="the file")
    return of_stamps(
        where, column.time, nominal=column.rate, by="the column of times",
        nominal_by="the file",
    )  # fmt: skip


def _together(
    path: Path,
    signals: Sequence[_Signal],
    units: Mapping[str, str],
    dropped: Mapping[str, str],
    names: Mapping[str, str],
) -> Part:
    """Return the signals of one rate on common instants.

    Their first and last instants may differ: a difference up to `TRIMMED` is cut off, a longer one
    is a gap of the shorter signals.
    """
    rate = float(np.median([signal.base.rate for signal in signals]))
    starts = np.array([signal.base.times[0] for signal in signals])
    starts[np.abs(starts) * rate < 0.01] = 0.0  # rounded instants, through which a line was fitted
    first = np.rint((starts - starts.min()) * rate).astype(int)
    last = first + np.array([signal.base.times.size for signal in signals])
    begin, end = int(first.min()), int(last.max())
    if (first.max() - begin) <= TRIMMED * rate:
        begin = int(first.max())
    if (end - last.min()) <= TRIMMED * rate:
        end = int(last.min())
    values = np.full((len(signals), max(end - begin, 0)), np.nan)
    if values.shape[1] == 0:
        raise DataError(
            f"{path.name}: its signals have no time in common; expected channels that were recorded "
            "together: export them again."
        )
    for row, signal, at in zip(values, signals, first, strict=True):
        laid = signal.base.laid(signal.values)[max(begin - at, 0) : max(end - at, 0)]
        row[max(at - begin, 0) : max(at - begin, 0) + laid.size] = laid
    base = of_rate(path.name, end - begin, rate, first=float(starts.min()) + begin / rate)
    part = voltages(
        values,
        [signal.label for signal in signals],
        [signal.unit for signal in signals],
        base,
        units,
        names,
    )
    return part._replace(dropped={**dropped, **part.dropped}, findings=_findings(signals))


def _findings(signals: Sequence[_Signal]) -> list[Finding]:
    """Return the findings on the time of the signals, once if all have the same."""
    by_signal = [signal.base.findings("channel") for signal in signals]
    if all(one == by_signal[0] for one in by_signal):
        return by_signal[0]
    return [
        replace(finding, name=signal.label)
        for signal, one in zip(signals, by_signal, strict=True)
        for finding in one
    ]
