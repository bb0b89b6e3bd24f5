"""Tables and arrays specified by a sidecar."""

import io
import re
import warnings
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from emgface.errors import DataError, listed
from emgface.recordings.ends import doubtful_lines
from emgface.recordings.findings import Finding
from emgface.recordings.readers._arrays import read_array, read_texts
from emgface.recordings.readers._build import require_few
from emgface.recordings.readers._companion import companion_file
from emgface.recordings.readers._declared import declared_rates, flags_in, rates_in_lines, times_in
from emgface.recordings.readers._row_flags import holds_row_flags
from emgface.recordings.readers._table_models import PositionTable, Table
from emgface.recordings.timebase import (
    TimeBase,
    contradicting,
    of_rate,
    of_stamps,
    with_counter,
)
from emgface.schema.rules import hint, one_line
from emgface.schema.units import to_si
from emgface.texts import read_text

_UNREADABLE = (pd.errors.ParserError, pd.errors.ParserWarning)
_EXACT = {
    decimal: re.compile(rf"\s*[+-]?(\d+(\{decimal}\d*)?|\{decimal}\d+)([eE][+-]?\d+)?\s*", re.ASCII)
    for decimal in ".,"
}
"""Format of a number by its decimal sign, without thousands separators."""
FLAGS_OF_SAMPLES = "may state which samples are good, not a signal"  #: reason of an omitted column
_MISSING = frozenset({"", "nan", "NaN", "NAN", "NA", "N/A", "n/a", "null", "NULL"})
"""Cells without a value."""


class Numbers(NamedTuple):
    """Numbers of a table or array, and what its file states next to them."""

    frame: pd.DataFrame
    base: TimeBase
    dropped: dict[str, str]  #: omitted columns with the reason
    flags: dict[str, np.ndarray]  #: columns that may state which samples are good (`_row_flags`)
    lines: list[str]  #: lines before the table


def load_table(
    sidecar: Path, table: Table, wanted: Mapping[str, str] | None, folder: Path | None = None
) -> "Numbers":
    """Return the numbers described by a table of a sidecar.

    `folder` contains the file, by default that of the sidecar. The table has one column of float64
    for each channel, and three for each marker; columns that are not `wanted` may contain text and are
    then omitted. Raises DataError if the file is
    absent or damaged, contains a cell that is not a number, or does not fit the description, and
    UnitsError if the unit of time is unknown.
    """
    path = companion_file(folder or sidecar.parent, table.file, sidecar.name)
    dropped: dict[str, str] = {}
    cut: list[Finding] = []
    lines: list[str] = []
    if table.variable is None:
        text = _text(sidecar, path, table)
        frame = _table(sidecar, path, table, text)
        cut = doubtful_lines(text, table.delimiter)
        lines = [line.rstrip("\r\n") for line in islice(io.StringIO(text), table.skip_rows)]
        if not table.columns:
            _require_labels(sidecar, path, table, text, wanted)
        flags = _separate_flags(sidecar, path, table, frame, wanted)
        dropped |= dict.fromkeys(flags, FLAGS_OF_SAMPLES)
        frame = frame.drop(columns=list(flags))
        for name in list(frame.columns):
            if frame[name].dtype.kind in "iuf":
                continue
            if wanted is not None and name not in wanted and name != table.time:
                dropped[str(name)] = "not in the mapping; contains text"
                frame = frame.drop(columns=name)
            else:
                _refuse_text(path, str(name), frame[name].to_numpy(), sidecar, table)
        frame = frame.astype("float64")
        _require_one_clock(sidecar, path, table, frame)
        instants = _column_of_time(sidecar, path, table, frame)
    else:
        frame = _array(sidecar, path, table)
        flags = flags_in(path, table, [str(name) for name in frame.columns], len(frame))
        _require_flags(sidecar, path, table, flags)
        instants = None
        if table.time is not None:
            instants = read_array(path, table.time, table.time_unit).ravel()
        if instants is not None and instants.size != len(frame):
            raise DataError(
                f"{path.name}: {table.time!r} has {instants.size} instants and {table.variable!r} "
                f"{len(frame)} samples; expected the same number: check 'dims' in {sidecar.name}."
            )
    columns = {str(name): frame[name].to_numpy() for name in frame.columns}
    if (table.step, table.zero) != (1.0, 0.0):
        frame = table.step * (frame - table.zero)
    if instants is None:
        rate = float(table.rate or np.nan)
        by = f"'rate' in {sidecar.name}"
        if table.variable is not None:
            columns |= times_in(path, table.variable, len(frame))
        base = with_counter(
            of_rate(path.name, len(frame), rate, by=by, others=rates_in_lines(lines)), columns
        )
        if not base.gaps:  # which would explain another mean rate
            base = base.noting(contradicting(columns, rate, by))
        if table.variable is not None:
            base = base.noting(declared_rates(path, table.variable, rate, len(frame), by))
        return Numbers(frame, base.noting(cut), dropped, flags, lines)
    named = xr.DataArray(instants, dims="time", name=f"{path.name}, {table.time}")
    time = to_si(named.assign_attrs(units=table.time_unit), "time").values
    base = of_stamps(f"{path.name}, {table.time}", time, by=f"the times of {table.time!r}")
    base = base.noting(cut)
    return Numbers(frame, with_counter(base, columns), dropped, flags, lines)


def _separate_flags(
    sidecar: Path,
    path: Path,
    table: Table,
    frame: pd.DataFrame,
    wanted: Mapping[str, str] | None,
) -> dict[str, np.ndarray]:
    """Columns that may state which samples are good, among those that are not `wanted` as signals."""
    used = {table.time, *(wanted or ())}
    columns = {str(name): frame[name].to_numpy() for name in frame.columns if name not in used}
    flags = {n: v for n, v in columns.items() if n in table.flags or holds_row_flags(n, v)}
    _require_flags(sidecar, path, table, flags)
    return flags


def _require_flags(sidecar: Path, path: Path, table: Table, flags: Mapping[str, object]) -> None:
    """Refuse a column of flags that the file does not contain."""
    if absent := [name for name in table.flags if name not in flags]:
        raise DataError(
            f"{sidecar.name}: the table 'flags' names {absent[0]!r}; expected columns of {path.name} "
            "that are no signals, or variables with a value for each sample: correct the sidecar."
        )


def _array(sidecar: Path, path: Path, table: Table) -> pd.DataFrame:
    """Return an array as a table of one column per channel, or three per marker."""
    counts = (table.step, table.zero) != (1.0, 0.0)
    values = read_array(path, str(table.variable), table.unit, counts=counts)
    if values.ndim == 2 and 1 in values.shape and len(table.dims) == 2:
        long = table.dims.index("time")  # a row or column vector
        values = values.reshape((-1, 1) if long == 0 else (1, -1))
    if values.ndim != len(table.dims):
        raise DataError(
            f"{path.name}: {table.variable!r} has the shape {values.shape}; expected dims "
            f"{', '.join(table.dims)}: check 'dims' in {sidecar.name}."
        )
    order = [d for d in ("time", "channel", "marker", "axis") if d in table.dims]
    values = values.transpose([table.dims.index(d) for d in order])
    count = values.shape[1]
    require_few(count, f"{path.name}: {table.variable!r} has", f"{order[1]}s by 'dims'")
    labels = table.columns or tuple(str(i + 1) for i in range(count))
    if table.columns_variable is not None:
        labels = tuple(read_texts(path, table.columns_variable))
    if len(labels) != count or values.shape[2:] not in ((), (3,)):
        raise DataError(
            f"{path.name}: {table.variable!r} has {values.shape[1:]} columns for {len(labels)} "
            f"labels; expected one each, and 3 axes: check 'dims' and 'columns' in {sidecar.name}."
        )
    if values.ndim == 3:
        endings = table.axes if isinstance(table, PositionTable) else ("_x", "_y", "_z")
        labels = tuple(label + ending for label in labels for ending in endings)
        values = values.reshape(len(values), -1)
    return pd.DataFrame(values, columns=list(labels))


def _text(sidecar: Path, path: Path, table: Table) -> str:
    """Return the text of a table, which is decoded once."""
    try:
        return read_text(path, table.encoding)
    except FileNotFoundError as error:
        raise DataError(
            f"{sidecar.name} specifies {table.file}, which is not in the same folder; "
            "expected a CSV file: check the entry 'file'."
        ) from error
    except UnicodeError as error:
        raise DataError(
            f"{path.name} is not text in {table.encoding} ({one_line(error)}); expected another "
            f"encoding, such as 'latin-1' or 'utf-16': set 'encoding' in {sidecar.name}."
        ) from error
    except (OSError, ValueError) as error:
        raise _no_table(sidecar, path, table, error) from error


def _no_table(sidecar: Path, path: Path, table: Table, error: Exception) -> DataError:
    if isinstance(error, DataError):
        return error
    return DataError(
        f"{path.name} is not a table ({one_line(error)}); expected a row of labels and rows of "
        f"numbers separated by {table.delimiter!r}: check 'delimiter' and 'encoding' in "
        f"{sidecar.name}."
    )


def _table(sidecar: Path, path: Path, table: Table, text: str) -> pd.DataFrame:
    """Return the columns of the text of a file; a column of numbers is converted.

    With a decimal comma the cells are read as text and converted here, because pandas would read
    1.234 as a number, although its point then separates thousands.
    """
    try:
        with warnings.catch_warnings():
            # pandas truncates rows that are longer than the row of labels, with a warning only.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            stream = io.StringIO(text, newline="")
            _require_few_columns(path, stream, table)
            frame = pd.read_csv(
                stream, sep=table.delimiter, skipinitialspace=True, index_col=False,
                header=None if table.columns else 0, skiprows=table.skip_rows,
                dtype=str if table.decimal == "," else None,
                keep_default_na=table.decimal == ".",
            )  # fmt: skip
    except (ValueError, *_UNREADABLE) as error:
        raise _no_table(sidecar, path, table, error) from error
    if table.decimal == ",":
        frame = frame.apply(_with_points)
    frame.columns = [str(c).strip() for c in frame.columns]
    # A delimiter at the end of every line results in an empty last column.
    hollow = [
        c
        for c in frame.columns
        if (c.startswith("Unnamed:") or (table.columns and c == frame.columns[-1]))
        and bool(np.all(pd.isna(frame[c].to_numpy())))
    ]
    frame = frame.drop(columns=hollow)
    if frame.empty:
        raise DataError(f"{path.name} has no row of numbers; expected samples: export it again.")
    if table.columns:
        if len(table.columns) != frame.shape[1]:
            raise DataError(
                f"{path.name} has {frame.shape[1]} columns, and {sidecar.name} lists "
                f"{len(table.columns)}; expected the same number: check 'columns' and "
                "'delimiter'."
            )
        frame.columns = list(table.columns)
    return frame


def _require_few_columns(path: Path, stream: io.StringIO, table: Table) -> None:
    """Refuse a table that is wider than a recording, before its columns are separated."""
    sign = table.delimiter if len(table.delimiter) == 1 else " "
    for _ in range(table.skip_rows + 3):
        require_few(stream.readline().count(sign) + 1, f"{path.name} has", "columns")
    stream.seek(0)


def _require_labels(
    sidecar: Path, path: Path, table: Table, text: str, wanted: Mapping[str, str] | None
) -> None:
    """Refuse repeated labels, of which pandas renames all but the first, and samples in their place.

    A sidecar that lists its channels may leave repeated labels out, or use the names of pandas.
    """
    first = pd.read_csv(
        io.StringIO(text, newline=""), sep=table.delimiter, skipinitialspace=True, header=None,
        nrows=1, dtype=str, skiprows=table.skip_rows, index_col=False,
    )  # fmt: skip
    labels = [str(label).strip() for label in first.iloc[0].dropna()]
    exact = _EXACT[table.decimal]
    if any(not label.isdecimal() for label in labels) and all(map(exact.fullmatch, labels)):
        raise DataError(
            f"{path.name} begins with the numbers {listed(labels)}, expected the labels of the columns: "
            f"list them as 'columns' in {sidecar.name}."
        )
    twice = [label for label in labels if label and labels.count(label) > 1]
    if wanted is not None:
        twice = [label for label in twice if label in wanted and f"{label}.1" not in wanted]
    if twice:
        raise DataError(
            f"{path.name} has several columns {twice[0]!r}; expected different labels: rename them, "
            f"or list them as 'columns' in {sidecar.name} and skip the row of labels by 'skip_rows'."
        )


def _require_one_clock(sidecar: Path, path: Path, table: Table, frame: pd.DataFrame) -> None:
    """Refuse columns of times with the same label and other times: sensors of several rates.

    pandas appends a number to repeated labels.
    """
    if table.time is None or table.time not in frame.columns:
        return
    again = re.compile(rf"{re.escape(table.time)}\.\d+")
    first = frame[table.time].to_numpy()
    for name in frame.columns:
        if not again.fullmatch(str(name)):
            continue
        other = frame[name].to_numpy()
        both = np.isfinite(first) & np.isfinite(other)
        step = float(np.median(np.abs(np.diff(first[both])))) if both.sum() > 1 else 0.0
        if both.any() and float(np.abs(first - other)[both].max()) > 0.5 * step:
            raise DataError(
                f"{path.name} has two columns of times {table.time!r} that differ, so that its signals "
                f"have several rates; expected one: open {path.name} itself if it is the export of a "
                f"recording program, or export signals of one rate for {sidecar.name}."
            )


def _column_of_time(
    sidecar: Path, path: Path, table: Table, frame: pd.DataFrame
) -> np.ndarray | None:
    """Separate the column of sampling times from a table, if it has one."""
    if table.time is None:
        return None
    if table.time not in frame.columns:
        raise DataError(
            f"{path.name} has no column {table.time!r}{hint(table.time, frame.columns)}; found "
            f"{listed(frame.columns)}: check 'time' in {sidecar.name}."
        )
    return frame.pop(table.time).to_numpy()


def _with_points(column: pd.Series) -> pd.Series:
    """Convert a column of texts with decimal commas, unless a cell is not a number."""
    cells = column.fillna("").str.strip()
    empty = cells.isin(_MISSING)
    if not (cells.str.fullmatch(_EXACT[","]) | empty).all():
        return column
    return cells.mask(empty, "nan").str.replace(",", ".", regex=False).astype("float64")


def _refuse_text(path: Path, name: str, cells: np.ndarray, sidecar: Path, table: Table) -> None:
    """Refuse a column with text, stating the first cell that is not a number."""
    exact = _EXACT[table.decimal]
    for row, cell in enumerate(cells):
        text = "" if pd.isna(cell) else str(cell).strip()
        if text in _MISSING or exact.fullmatch(text):
            continue
        # The first row contains the labels, and rows are counted from 1.
        first = table.skip_rows + (1 if table.columns else 2)
        raise DataError(
            f"{path.name}, row {row + first}, column {name!r} contains {cell!r}; expected a "
            "number without a thousands separator, or an empty cell: repair it, or check "
            f"'delimiter' ({table.delimiter!r}) and 'decimal' ({table.decimal!r}) in "
            f"{sidecar.name}."
        )


def by_marker(
    frame: pd.DataFrame, table: PositionTable
) -> tuple[np.ndarray, list[str], dict[str, str]]:
    """Combine the three columns of each marker: positions (markers, 3, frames) and names.

    Columns that belong to no marker are returned with the reason. Raises DataError if there is no
    marker.
    """
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
            f"{listed(columns)}: check 'axes' in the sidecar."
        )
    used = {label + ending for label in labels for ending in table.axes}
    dropped = {c: "no column for each axis of a marker" for c in columns if c not in used}
    values = np.stack(
        [[frame[label + ending].to_numpy() for ending in table.axes] for label in labels]
    )
    return values, labels, dropped
