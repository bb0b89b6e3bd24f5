"""Tables: one CSV for EMG, one for markers, and a TOML sidecar that says what they hold.

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
    file = "V01_A_1_markers.csv"  # three columns per marker
    rate = 100.0
    unit = "mm"
    axes = ["_x", "_y", "_z"]     # endings of the three columns of a marker
"""

import tomllib
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import Field, model_validator

from emgface._rules import hint, listed
from emgface.errors import DataError
from emgface.labels import LabelMap, apply_labels, read_toml
from emgface.parameters import Parameters, configure
from emgface.readers._build import assemble, emg_array, position_array, unique_labels
from emgface.units import to_si

SUFFIXES = (".toml",)
FORMAT = "CSV tables with a TOML sidecar"


class Table(Parameters):
    """How one CSV file is read.

    Attributes
    ----------
    file : str
        Name, relative to the sidecar.
    unit : str
        Unit of the values.
    rate : float or None
        Sampling rate [Hz]; the alternative to a column of instants.
    time, time_unit : str or None, str
        Column of instants and its unit.
    delimiter, decimal : str
        As the file was written, ``;`` and ``,`` in some countries.
    """

    file: str
    unit: str
    rate: float | None = Field(default=None, gt=0)
    time: str | None = None
    time_unit: str = "s"
    delimiter: str = ","
    decimal: str = "."

    @model_validator(mode="after")
    def _clocked(self) -> "Table":
        if (self.rate is None) == (self.time is None):
            raise ValueError(
                f"{self.file} needs either rate, in Hz, or time, the column of instants"
            )
        return self


class EmgTable(Table):
    """The CSV file of EMG, and the names of its columns."""

    channels: dict[str, str] | None = None


class PositionTable(Table):
    """The CSV file of markers: names, and the endings of a marker's three columns."""

    markers: dict[str, str] | None = None
    axes: tuple[str, str, str] = ("_x", "_y", "_z")


class Sidecar(Parameters):
    """The whole sidecar."""

    # 'schema' would hide a method of the base class.
    kind: Literal["recording"] = Field(alias="schema")
    volunteer: str | None = None
    instruction: str | None = None
    repetition: int | None = Field(default=None, ge=1)
    origin: Literal["measured", "simulated"] = "measured"
    emg: EmgTable | None = None
    position: PositionTable | None = None


def is_recording(path: Path) -> bool:
    """Tell whether a TOML file is the sidecar of a recording.

    Parameters
    ----------
    path : Path
        TOML file.

    Returns
    -------
    bool
        Whether it says ``schema = "recording"``.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8")).get("schema") == "recording"
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return False


def read(path: Path, units: Mapping[str, str]) -> xr.Dataset:
    """Read the tables that a sidecar names.

    Parameters
    ----------
    path : Path
        TOML sidecar.
    units : mapping of str to str
        Unit of ``emg`` or ``position`` that replaces the one in the sidecar.

    Returns
    -------
    xarray.Dataset
        Recording under the names of the sidecar; empty cells are NaN.

    Raises
    ------
    ConfigurationError
        If the sidecar holds an unknown entry (the nearest is named) or a wrong value.
    DataError
        If a table is absent or holds a cell that is no number.
    UnitsError
        If a unit is unknown or measures another quantity.
    """
    sidecar = configure(Sidecar, _with_tables(read_toml(path), path), where=path.name)
    parts: list[xr.Dataset] = []
    names: dict[str, str] = {}
    found: dict[str, str] = {}
    dropped: dict[str, str] = {}
    if sidecar.emg is not None:
        frame, time = _load(path, sidecar.emg)
        labels, names = unique_labels([str(c) for c in frame.columns], "channel")
        unit = units.get("emg", sidecar.emg.unit)
        parts.append(emg_array(np.ascontiguousarray(frame.to_numpy().T), labels, time, unit))
        found["emg"] = sidecar.emg.unit
    if sidecar.position is not None:
        frame, time = _load(path, sidecar.position)
        values, labels, dropped = _by_marker(frame, sidecar.position)
        unit = units.get("position", sidecar.position.unit)
        parts.append(position_array(values, labels, time, unit))
        found["position"] = sidecar.position.unit
    recording = assemble(
        parts,
        original_names=names,
        original_units=found,
        dropped=dropped,
        origin=sidecar.origin,
    )
    labels = LabelMap(
        channels=sidecar.emg.channels if sidecar.emg else None,
        markers=sidecar.position.markers if sidecar.position else None,
        volunteer=sidecar.volunteer,
        instruction=sidecar.instruction,
        repetition=sidecar.repetition,
    )
    return apply_labels(recording, labels)


def _with_tables(content: dict[str, Any], path: Path) -> dict[str, Any]:
    """Refuse a TOML file that is no sidecar, before its entries are judged one by one."""
    if content.get("schema") != "recording":
        raise DataError(
            f'{path.name} does not say schema = "recording"; expected the sidecar of a '
            "recording: give that file, or add the line."
        )
    return content


def _load(sidecar: Path, table: Table) -> tuple[pd.DataFrame, np.ndarray]:
    """Return the numbers of a table and its instants [s]."""
    path = sidecar.parent / table.file
    try:
        with warnings.catch_warnings():
            # pandas only warns where rows are longer than the row of labels, and cuts them.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame = pd.read_csv(
                path, sep=table.delimiter, decimal=table.decimal, skipinitialspace=True,
                index_col=False,
            )  # fmt: skip
    except FileNotFoundError as error:
        raise DataError(
            f"{sidecar.name} names {table.file}, which is not beside it; expected a CSV file: "
            "see the entry 'file'."
        ) from error
    except (
        pd.errors.ParserError,
        pd.errors.ParserWarning,
        pd.errors.EmptyDataError,
        UnicodeDecodeError,
    ) as error:
        raise DataError(
            f"{path.name} is no table ({' '.join(str(error).split())}); expected a row of labels "
            f"and rows of numbers separated by {table.delimiter!r}: see 'delimiter' in "
            f"{sidecar.name}."
        ) from error
    frame.columns = [str(c).strip() for c in frame.columns]
    # A delimiter at the end of every line makes a last column of nothing.
    hollow = [
        c
        for c in frame.columns
        if c.startswith("Unnamed:") and bool(np.all(pd.isna(frame[c].to_numpy())))
    ]
    frame = frame.drop(columns=hollow)
    if frame.empty:
        raise DataError(f"{path.name} has no row of numbers; expected samples: export it again.")
    for name in frame.columns:
        if frame[name].dtype.kind not in "iuf":
            _refuse_text(path, str(name), frame[name].to_numpy(), sidecar, table)
    frame = frame.astype("float64")
    if table.time is None:
        return frame, np.arange(len(frame)) / float(table.rate or np.nan)
    if table.time not in frame.columns:
        raise DataError(
            f"{path.name} has no column {table.time!r}{hint(table.time, frame.columns)}; found "
            f"{listed(frame.columns)}: see 'time' in {sidecar.name}."
        )
    instants = xr.DataArray(frame.pop(table.time).to_numpy(), name=f"{path.name}, {table.time}")
    return frame, to_si(instants.assign_attrs(units=table.time_unit), "time").values


def _refuse_text(path: Path, name: str, cells: np.ndarray, sidecar: Path, table: Table) -> None:
    """Say which cell of a column is no number."""
    for row, cell in enumerate(cells):
        try:
            float(str(cell).replace(table.decimal, "."))
        except ValueError:
            # The first row holds the labels, and people count rows from 1.
            raise DataError(
                f"{path.name}, row {row + 2}, column {name!r} holds {cell!r}; expected a number "
                f"or an empty cell: repair it, or see 'delimiter' ({table.delimiter!r}) and "
                f"'decimal' ({table.decimal!r}) in {sidecar.name}."
            ) from None


def _by_marker(
    frame: pd.DataFrame, table: PositionTable
) -> tuple[np.ndarray, list[str], dict[str, str]]:
    """Gather the three columns of each marker, shape (markers, 3, frames)."""
    columns = [str(c) for c in frame.columns]
    stems = [
        c[: len(c) - len(ending)]
        for c in columns
        for ending in table.axes
        if c.endswith(ending) and len(c) > len(ending)
    ]
    labels = [
        stem
        for stem in dict.fromkeys(stems)
        if all(stem + ending in columns for ending in table.axes)
    ]
    if not labels:
        raise DataError(
            f"{table.file} has no marker with columns ending in {', '.join(table.axes)}; found "
            f"{listed(columns)}: see 'axes' in the sidecar."
        )
    used = {label + ending for label in labels for ending in table.axes}
    dropped = {c: "no column for each axis of a marker" for c in columns if c not in used}
    values = np.stack(
        [[frame[label + ending].to_numpy() for ending in table.axes] for label in labels]
    )
    return values, labels, dropped
