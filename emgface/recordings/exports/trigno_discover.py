"""Exports of Delsys Trigno Discover: rows of sensors, modes, names, rates, then pairs of columns.

Rows ``Application:``, ``Date/Time:`` and ``Collection Length (seconds):`` precede a row of sensors,
one of their modes, one of names (``EMG 1 Time Series (s)``, ``EMG 1 (mV)``), one of rates in Hz
and, in later versions, one of sampling intervals. Every signal has the instants of its own column
or shares those of the signal to its left. Markers may follow in further columns. Source: layout
of versions 1.5 to 2.1 as documented by the programs that read it.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from emgface.errors import DataError
from emgface.recordings.exports.contract import (
    NUMBER,
    Block,
    Column,
    Export,
    delimiter_of,
    header_rate,
    split,
)

NAME: str = "Trigno Discover"

COLLECTION_END: Final = 0.1  #: time [s] by which sensors may end before the stated length
_CLOCK: Final = re.compile(r"(.*?)\s*Time Series \((s|ms)\)(?:[ .]\d+)?", re.IGNORECASE)
_SIGNAL: Final = re.compile(r"(.*?)\s*\(([^()]*)\)(?:[ .]\d+)?")
_RATE: Final = re.compile(r"([\d.,]+)\s*Hz", re.IGNORECASE)
_PERIOD: Final = re.compile(r"[\d.,]+(e-?\d+)?\s*s", re.IGNORECASE)


def matches(head: Sequence[str]) -> bool:
    """Return True if one of the first lines names a column ``... Time Series (s)``."""
    return _names_row(head) is not None


def _names_row(head: Sequence[str]) -> int | None:
    for k, line in enumerate(head[:40]):
        if "time series (" in line.lower():
            return k
    return None


def read(path: Path, text: str, head: Sequence[str]) -> Export:
    """Return the signals, labelled by sensor and name."""
    row = _names_row(head)
    assert row is not None  # the file matches
    delimiter = delimiter_of(head[row])
    names = split(head[row], delimiter)
    start, rates = row + 1, [""] * len(names)
    for line in head[row + 1 : row + 4]:  # rates, intervals, and an empty line in some versions
        cells = split(line, delimiter)
        if any(_RATE.fullmatch(cell) for cell in cells):
            rates = (cells + [""] * len(names))[: len(names)]
        elif any(NUMBER.fullmatch(cell) for cell in cells[: len(names)]) and not any(
            _PERIOD.fullmatch(cell) for cell in cells
        ):
            break
        start += 1
    sensors = _sensors(head[:row], delimiter, len(names))
    block = Block(path, text, start, delimiter, names)
    columns: list[Column] = []
    clocks: dict[str, int] = {}
    last: int | None = None
    for k, name in enumerate(names):
        match = _CLOCK.fullmatch(name)
        if match:
            clocks[match.group(1)], last = k, k
            continue
        signal = _SIGNAL.fullmatch(name)
        if signal is None:
            continue  # a column of markers, or a delimiter at the end
        clock = clocks.get(signal.group(1), last)
        if clock is None:
            raise DataError(
                f"{path.name} has the column {name!r} before any column of instants; expected "
                "'... Time Series (s)' to its left: it is damaged, export it again."
            )
        n = block.used(clock)
        stated = _RATE.fullmatch(rates[k]) or _RATE.fullmatch(rates[clock])
        scale = 1e-3 if "(ms)" in names[clock].lower() else 1.0
        label = ": ".join(part for part in (sensors[k], signal.group(1)) if part)
        columns.append(
            Column(
                label,
                signal.group(2),
                np.array(block.numbers(k)[:n]),
                None if stated is None else header_rate(path, "rate", stated.group(1)),
                scale * block.numbers(clock)[:n],
            )
        )
    return Export(
        [_counted(column, _length(head[:row], delimiter)) for column in columns], "Delsys Trigno"
    )


def _length(above: Sequence[str], delimiter: str) -> float | None:
    """Collection length [s] that the header states."""
    for line in above:
        cells = split(line, delimiter)
        if cells[0].lower().startswith("collection length") and len(cells) > 1:
            return float(cells[1].replace(",", ".")) if NUMBER.fullmatch(cells[1]) else None
    return None


def _counted(column: Column, length: float | None) -> Column:
    """Column with the number of samples of a stated length [s], if it differs clearly."""
    if length is None or column.rate is None:
        return column
    count = round(length * column.rate)
    differs = abs(count - column.values.size) > COLLECTION_END * column.rate
    return replace(column, stated=count if differs else None)


def _sensors(above: Sequence[str], delimiter: str, width: int) -> list[str]:
    """Name of the sensor of each column: the last one at or left of it in the row of sensors."""
    mode = next((k for k, line in enumerate(above) if "sensor mode" in line.lower()), len(above))
    row = next(
        (
            split(line, delimiter)
            for line in reversed(above[:mode])
            if line.strip(f"{delimiter} \r") and ":" not in line.partition(delimiter)[0]
        ),
        [],
    )
    named, last = list[str](), ""
    for k in range(width):
        last = row[k] if k < len(row) and row[k] else last
        named.append(last)
    return named
