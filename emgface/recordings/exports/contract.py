"""Text exports of recording programs: contract of their layouts, and tables of numbers in them."""

import csv
import io
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final, Protocol

import numpy as np
import pandas as pd

from emgface.errors import DataError
from emgface.recordings.findings import Finding
from emgface.recordings.readers._build import require_few
from emgface.schema.rules import one_line
from emgface.schema.units import DIVISORS, spelling

#: lines in which a layout is recognised; headers have two lines per channel
HEADER_LINES: Final = 400
DELIMITERS: Final = ("\t", ";", ",")
NUMBER: Final = re.compile(r"\s*[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?\s*", re.ASCII)
_MISSING: Final = frozenset({"", "nan", "n/a", "na", "null"})


@dataclass(frozen=True)
class Column:
    """One signal of an export.

    `values` (samples,) end with the last sample of this signal, `rate` [Hz] is that stated in the
    file, `time` (samples,) [s] are the instants if the file lists them; at least one of both exists.
    """

    label: str
    unit: str  #: as in the file, empty if none is stated
    values: np.ndarray
    rate: float | None = None
    time: np.ndarray | None = None
    apart: str = ""  #: reason why the signal is no EMG, empty if it may be
    stated: int | None = None  #: number of samples that the header states


@dataclass(frozen=True)
class Export:
    """Signals of an export, and the device if it is stated."""

    columns: Sequence[Column]
    device: str = ""
    findings: Sequence[Finding] = ()  #: on the whole file


class Layout(Protocol):
    """A module of `emgface.recordings.exports`: the export of one recording program."""

    NAME: str

    @staticmethod
    def matches(head: Sequence[str]) -> bool:
        """Return True if the first lines of a file are those of this export."""
        ...

    @staticmethod
    def read(path: Path, text: str, head: Sequence[str]) -> Export:
        """Return all signals of a file that matches; DataError if it is damaged."""
        ...


def split(line: str, delimiter: str) -> list[str]:
    """Return the stripped cells of a line, whose quoted cells may contain the delimiter."""
    try:
        cells = next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:
        cells = line.split(delimiter)
    return [cell.strip() for cell in cells]


def delimiter_of(line: str) -> str:
    """Return the delimiter of a line of labels: a tab, a semicolon, otherwise a comma."""
    return next((sign for sign in DELIMITERS if sign in line), ",")


def header_rate(path: Path, name: str, cell: str) -> float:
    """Return a rate [Hz] or interval that a header states; DataError unless it is positive."""
    try:
        value = float(cell.strip().replace(",", "."))
        if not 1e-6 < value < 1e9:
            raise ValueError
    except ValueError:
        raise DataError(
            f"{path.name} has {name} = {cell.strip()!r}; expected a number above 0: the header is "
            "damaged, export the recording again."
        ) from None
    return value


def seconds_in(path: Path, values: np.ndarray, unit: str) -> np.ndarray:
    """Convert a column of instants to seconds; DataError for another unit."""
    known = spelling(unit) if spelling(unit) in DIVISORS["s"] else unit.strip().lower()
    factors = {name: 1.0 / divisor for name, divisor in DIVISORS["s"].items()} | {"min": 60.0}
    if known not in factors:
        raise DataError(
            f"{path.name} has instants in {unit!r}; expected s, ms, us or min: export it again with "
            "times in seconds."
        )
    return values * factors[known]


class Block:
    """Rows of numbers below a header.

    Parameters
    ----------
    path : Path
        File, for messages.
    text : str
        Its text.
    skip : int
        Lines before the first row.
    delimiter : str
        Sign between cells.
    labels : sequence of str
        Labels of the columns, for messages; further columns must be empty.

    Raises
    ------
    DataError
        There is no row, a row is longer than the others, or the last one is truncated.
    """

    def __init__(
        self, path: Path, text: str, skip: int, delimiter: str, labels: Sequence[str]
    ) -> None:
        self.path, self.skip, self.labels = path, skip, list(labels)
        self._numbers: dict[int, np.ndarray] = {}
        rows = text.split("\n", skip)[-1] if text.count("\n") >= skip else ""
        self._rows = rows.rstrip("\n\r \x1a\x00")
        self._delimiter = delimiter
        if not self._rows.strip():
            raise DataError(
                f"{path.name} has no row of numbers below its header; expected samples: it is "
                "truncated, export it again."
            )
        first = self._rows[:100_000].splitlines()[:20]
        self._width = max(len(labels), *(line.count(delimiter) + 1 for line in first))
        require_few(self._width, f"{path.name} has", "columns")
        last = self._rows[-100_000:].splitlines()[-2:]
        if len(last) == 2 and last[1].count(delimiter) < last[0].count(delimiter):
            raise DataError(
                f"{path.name} ends within a row; expected complete rows: it is truncated, copy or "
                "export it again."
            )
        cells = [cell for line in first for cell in split(line, delimiter)]
        comma = delimiter != "," and any(re.fullmatch(r"[+-]?\d*,\d+.*", c) for c in cells)
        self.decimal = "," if comma else "."

    @cached_property
    def _frame(self) -> pd.DataFrame:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", pd.errors.ParserWarning)
                return pd.read_csv(
                    io.StringIO(self._rows), sep=self._delimiter, header=None,
                    names=list(range(self._width)), index_col=False, skipinitialspace=True,
                    # With a decimal comma pandas would read 1.234 as a number.
                    dtype=str if self.decimal == "," else None, skip_blank_lines=False,
                    keep_default_na=self.decimal == ".", low_memory=False,
                )  # fmt: skip
        except (ValueError, pd.errors.ParserError, pd.errors.ParserWarning) as error:
            raise DataError(
                f"{self.path.name} has rows that do not fit its header ({one_line(error)}); expected "
                f"{len(self.labels)} columns: it is damaged, export it again."
            ) from error

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return len(self._frame)

    def numbers(self, k: int) -> np.ndarray:
        """Return a column as float64, NaN for empty cells; DataError for a cell of text."""
        if k not in self._numbers:
            self._numbers[k] = self._converted(k)
        return self._numbers[k]

    def _converted(self, k: int) -> np.ndarray:
        column = self._frame[k]
        if column.dtype.kind in "iuf":
            return column.to_numpy(dtype=np.float64)
        cells = ["" if pd.isna(cell) else str(cell).strip() for cell in column]
        values = np.full(len(cells), np.nan)
        for row, cell in enumerate(cells):
            if cell.lower() in _MISSING:
                continue
            number = NUMBER.fullmatch(cell) and ("." if self.decimal == "," else ",") not in cell
            if not number:
                label = self.labels[k] if k < len(self.labels) else f"column {k + 1}"
                raise DataError(
                    f"{self.path.name}, row {self.skip + row + 1}, column {label!r} contains "
                    f"{cell!r}; expected a number or an empty cell: repair it, or export it again."
                )
            values[row] = float(cell.replace(",", "."))
        return values

    def used(self, k: int) -> int:
        """Return the number of rows up to the last number of a column."""
        seen = np.flatnonzero(np.isfinite(self.numbers(k)))
        return int(seen[-1]) + 1 if seen.size else 0
