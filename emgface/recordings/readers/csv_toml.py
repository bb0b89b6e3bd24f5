"""Tables and arrays (CSV, MATLAB, HDF5) described by a TOML sidecar.

The sidecar is the file to open::

    schema = "recording"
    volunteer = "V01"
    instruction = "A"
    repetition = 1
    origin = "measured"

    [emg]
    file = "V01_A_1_emg.csv"      # one column per channel, first row labels
    rate = 2048.0                 # Hz; or time = "t" and time_unit = "ms"
    unit = "mV"

    [emg.channels]                # column to channel; without this table columns keep their labels
    "EMG 1" = "OOS_L"

    [position]
    file = "V01_A_1.mat"
    variable = "mocap.markers"    # of a MATLAB or HDF5 file
    dims = ["marker", "axis", "time"]
    columns = ["M1", "M2"]        # labels, if the file contains none
    rate = 100.0
    unit = "mm"

Files are in the folder of the sidecar or a folder in it. The labels of a table without a row of
labels are specified by ``columns``; ``skip_rows`` is the number of lines before it. Counts of a
converter are converted by ``step * (count - zero)``, in the unit. ``delimiter``, ``decimal`` and
``encoding`` specify the format of the text. Entries listed in ``unconfirmed`` are guesses of
`emgface.recordings.describe`; such a sidecar is refused.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import pandas as pd
import xarray as xr
from pydantic import Field

from emgface.choices import Parameters, configure
from emgface.errors import DataError, EmgfaceError, listed
from emgface.recordings.exports import EXPORTS, layout_of
from emgface.recordings.labels import LabelMap, apply_labels
from emgface.recordings.readers._build import (
    Part,
    assemble_parts,
    position_array,
    unique_labels,
    voltages,
)
from emgface.recordings.readers._companion import companion_file
from emgface.recordings.readers._declared import (
    declared_conversions,
    home_of,
    require_declared_units,
    require_stated_units,
    statements_in_lines,
    statements_near,
)
from emgface.recordings.readers._row_flags import named, with_row_flags
from emgface.recordings.readers._table_models import EmgTable, PositionTable, Table
from emgface.recordings.readers._tables import by_marker, load_table
from emgface.recordings.readers.text_exports import export_of, part_of
from emgface.recordings.timebase import TimeBase
from emgface.schema.rules import hint
from emgface.signals.filters import sampling_rate
from emgface.texts import read_toml

SUFFIXES = (".toml",)
FORMAT = "CSV tables or MATLAB and HDF5 arrays with a TOML sidecar"


class Sidecar(Parameters):
    """Contents of a sidecar."""

    # The name 'schema' would hide a method of the base class.
    kind: Literal["recording"] = Field(alias="schema")
    unconfirmed: tuple[str, ...] = ()
    volunteer: str | None = None
    instruction: str | None = None
    repetition: int | None = Field(default=None, ge=1)
    origin: Literal["measured", "simulated"] = "measured"
    emg: EmgTable | None = None
    position: PositionTable | None = None


def is_recording(path: Path) -> bool:
    """Return True for a TOML file with ``schema = "recording"``, or a damaged one."""
    try:
        return read_toml(path).get("schema") == "recording"
    except EmgfaceError:
        return True  # it may be a sidecar, whose recording must not vanish


def companions(path: Path, folder: Path | None = None) -> list[Path]:
    """Return the files of tables and arrays specified by a sidecar, each once; `folder` as in `read`."""
    sidecar = configure(Sidecar, _with_tables(read_toml(path), path), where=path.name)
    tables = [table for table in (sidecar.emg, sidecar.position) if table is not None]
    return list(
        dict.fromkeys(
            companion_file(folder or path.parent, table.file, path.name) for table in tables
        )
    )


def read(path: Path, units: Mapping[str, str], folder: Path | None = None) -> xr.Dataset:
    """Read the tables specified by a sidecar, with its names; empty cells are NaN.

    The files are in `folder` or a folder in it, by default that of the sidecar.
    Raises ConfigurationError also if the sidecar contains an unknown entry (with the nearest valid
    name) or an invalid value.
    """
    sidecar = configure(Sidecar, _with_tables(read_toml(path), path), where=path.name)
    parts: list[Part] = []
    if sidecar.emg is not None:
        if sidecar.emg.layout is not None:
            parts.append(_export(path, sidecar.emg, units, folder))
    if sidecar.emg is not None and sidecar.emg.layout is None:
        table = sidecar.emg
        frame, time, dropped, flags, lines = load_table(path, table, table.channels, folder)
        part = _emg(path, table, units, frame, time, dropped)
        given = {"emg", *map(str, frame.columns), *(table.channels or {}).values()} & set(units)
        part = _with_statements(path, table, part, bool(given), lines, folder)
        with named({"channel": table.channels or {}}):
            part = with_row_flags(part, "channel", time, flags, table.flags, home_of(table))
        parts.append(part)
    if sidecar.position is not None:
        table = sidecar.position
        frame, time, left, flags, lines = load_table(path, table, None, folder)
        if "position" not in units:
            _require_stated(path, sidecar.position, list(frame.columns))
        values, labels, dropped = by_marker(frame, sidecar.position)
        unit = units.get("position", sidecar.position.unit)
        data = position_array(values, labels, time, unit)
        part = Part(data, {"position": sidecar.position.unit}, left | dropped)
        part = _with_statements(path, table, part, "position" in units, lines, folder)
        with named({"marker": table.markers or {}}):
            part = with_row_flags(part, "marker", time, flags, table.flags, home_of(table))
        parts.append(part)
    recording = assemble_parts(parts, origin=sidecar.origin)
    labels = LabelMap(
        channels=sidecar.emg.channels if sidecar.emg else None,
        markers=sidecar.position.markers if sidecar.position else None,
        volunteer=sidecar.volunteer,
        instruction=sidecar.instruction,
        repetition=sidecar.repetition,
    )
    return apply_labels(recording, labels)


def _with_statements(
    path: Path, table: Table, part: Part, given: bool, lines: list[str], folder: Path | None
) -> Part:
    """Compare what the file states of its numbers with the sidecar; `given` is a unit of a mapping."""
    file = companion_file(folder or path.parent, table.file, path.name)
    if table.variable is not None:
        statements = statements_near(file, table.variable)
    else:
        statements = statements_in_lines(lines)
    others = table.units.values() if isinstance(table, EmgTable) else ()
    if not given and (table.step, table.zero) == (1.0, 0.0):
        require_declared_units(file, statements, [table.unit, *others], path)
    converted = bool({"step", "zero"} & table.model_fields_set)
    kind = "channel" if isinstance(table, EmgTable) else "marker"
    findings = declared_conversions(file, statements, kind, converted)
    return part._replace(findings=[*part.findings, *findings])


def _emg(
    path: Path,
    table: EmgTable,
    units: Mapping[str, str],
    frame: pd.DataFrame,
    time: TimeBase,
    dropped: dict[str, str],
) -> Part:
    """Convert the columns of EMG, each from the unit that the mapping or the sidecar states."""
    columns = [str(column) for column in frame.columns]
    if unknown := [label for label in table.units if label not in columns]:
        raise DataError(
            f"{path.name}: the table 'units' names {unknown[0]!r}{hint(unknown[0], columns)}; expected "
            f"columns of {table.file} that are read: correct the sidecar."
        )
    called = table.channels or {}
    given = {c: units[name] for c in columns for name in (called.get(c, c), c) if name in units}
    if "emg" not in units:
        for column in columns:
            if column not in given and (column in called or table.channels is None):
                _require_stated(path, table, [column], table.units.get(column))
    labels, names = unique_labels(columns, "channel")
    stated = [table.units.get(column, table.unit) for column in columns]
    every = [given.get(c, units.get("emg", own)) for c, own in zip(columns, stated, strict=True)]
    chosen = dict(zip(labels, every, strict=True))
    part = voltages(frame.to_numpy().T, labels, stated, time, chosen, names)
    return part._replace(dropped={**part.dropped, **dropped})


def _require_stated(
    path: Path, table: EmgTable | PositionTable, labels: list[str], unit: str | None = None
) -> None:
    """Refuse units in labels that contradict the sidecar; counts have the unit of their converter."""
    if (table.step, table.zero) == (1.0, 0.0):
        require_stated_units(path, labels, unit or table.unit, "units" if unit else "unit")
    if table.time is not None:
        require_stated_units(path, [table.time], table.time_unit, "time_unit")


def _export(path: Path, table: EmgTable, units: Mapping[str, str], folder: Path | None) -> Part:
    """Read a file that is the export of a recording program."""
    file = companion_file(folder or path.parent, table.file, path.name)
    layout = layout_of(file)
    if layout is None or layout.NAME != table.layout:
        description = "no known export" if layout is None else f"an export of {layout.NAME}"
        raise DataError(
            f"{path.name} specifies layout = {table.layout!r}, and {file.name} is {description}; "
            f"expected one of {', '.join(one.NAME for one in EXPORTS)}: draft the sidecar again with "
            "'emgface describe'."
        )
    part = part_of(file, export_of(file), units, table.unit)
    rate = sampling_rate(part.data["time_emg"]) if part.data is not None else None
    if rate and table.rate and abs(rate / table.rate - 1.0) > 0.01:
        raise DataError(
            f"{path.name} specifies {table.rate:g} Hz, and {file.name} contains {rate:.6g} Hz; expected "
            "one rate: correct 'rate'."
        )
    return part


def _with_tables(content: dict[str, Any], path: Path) -> dict[str, Any]:
    """Refuse a TOML file that is not a sidecar, before its entries are checked."""
    if content.get("schema") != "recording":
        raise DataError(
            f'{path.name} does not contain schema = "recording"; expected the sidecar of a '
            "recording: specify that file, or add the line."
        )
    if guesses := content.get("unconfirmed"):
        raise DataError(
            f"{path.name} lists {listed(guesses)} as unconfirmed, which are guesses of 'emgface "
            "describe'; expected entries that a person has checked: correct them and delete the line "
            "'unconfirmed'."
        )
    return content
