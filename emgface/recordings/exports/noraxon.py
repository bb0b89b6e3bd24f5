"""Text exports of Noraxon MR3, MR4 and MyoResearch XP.

MR3 and MR4 write a row of names (``type,begin_time,frequency,count``), one of values, an empty line,
labels (``time,Activity,Marker,RT ZYG (uV)``), and rows, or one such file per signal; its unit is then
in the row ``units``. MyoResearch XP writes ``Time,s`` and labels with a comma before the unit,
separated by tabs. Source: layouts as documented by the programs that read them.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from emgface.errors import DataError
from emgface.recordings.exports.contract import (
    DELIMITERS,
    Block,
    Column,
    Export,
    delimiter_of,
    header_rate,
    seconds_in,
    split,
)

NAME: str = "Noraxon"

_UNIT: Final = (re.compile(r"(.*?)\s*\(([^()]*)\)"), re.compile(r"(.*?)\s*,\s*([^,\s]+)"))
_TEXTS: Final = ("activity", "marker", "markers")
_XP: Final = re.compile(r'"?time\s*,\s*(s|ms)"?\t', re.IGNORECASE)
_STATED: Final = ("frequency", "begin_time")


def matches(head: Sequence[str]) -> bool:
    """Return True for a row of names with a frequency above labels, or labels of MyoResearch XP."""
    return _stated(head) is not None or _xp_row(head) is not None


def _xp_row(head: Sequence[str]) -> int | None:
    return next((k for k, line in enumerate(head[:30]) if _XP.match(line)), None)


def _stated(head: Sequence[str]) -> tuple[int, dict[str, str]] | None:
    """Line of labels, and the names and values above it."""
    for k, line in enumerate(head[:10]):
        for delimiter in DELIMITERS:
            names = [cell.lower() for cell in split(line, delimiter)]
            if names[:1] != ["type"] or any(name not in names for name in _STATED):
                continue
            values = split(head[k + 1], delimiter) if k + 1 < len(head) else []
            entries = dict(zip(names, values, strict=False))
            for row in range(k + 2, min(k + 12, len(head))):
                if (
                    split(head[row], delimiter)[:1]
                    and split(head[row], delimiter)[0].lower() == "time"
                ):
                    return row, entries
    return None


def read(path: Path, text: str, head: Sequence[str]) -> Export:
    """Return the signals of a table, or the one of a file per signal."""
    stated = _stated(head)
    if stated is None:
        row, entries = _xp_row(head), dict[str, str]()
        assert row is not None  # the file matches
        delimiter = "\t"
    else:
        row, entries = stated
        delimiter = delimiter_of(head[row])
    labels = split(head[row], delimiter)
    block = Block(path, text, row + 1, delimiter, labels)
    time_unit = entries.get("time_units", "") or _parted(labels[0])[1] or "s"
    time = seconds_in(path, block.numbers(0), time_unit)
    if entries.get("count", "").isdigit() and block.n_rows < int(entries["count"]):
        raise DataError(
            f"{path.name} declares {entries['count']} samples but contains {block.n_rows}; expected all "
            "of them: it is truncated, export it again."
        )
    rate = (
        header_rate(path, "frequency", entries["frequency"]) if entries.get("frequency") else None
    )
    single = entries.get("type", "").lower() == "signal"
    columns: list[Column] = []
    for k, cell in enumerate(labels[1:], start=1):
        if not cell:
            continue
        label, unit = _parted(cell)
        if label.lower() in _TEXTS:
            continue
        if single:
            label = entries.get("name") or label
        unit = unit or entries.get("units", "")
        n = block.used(k)
        apart = "" if n else "has no samples"
        if n and n < 0.9 * block.n_rows:
            apart = f"has {n} of {block.n_rows} samples: it was recorded at another rate"
        values = np.array(block.numbers(k))
        count = int(entries["count"]) if entries.get("count", "").isdigit() else None
        columns.append(Column(label, unit, values, rate, time, apart, count))
    return Export(columns, "Noraxon")


def _parted(cell: str) -> tuple[str, str]:
    """Label and unit of a cell, the unit empty if none is stated."""
    for pattern in _UNIT:
        match = pattern.fullmatch(cell)
        if match:
            return match.group(1), match.group(2)
    return cell, ""
