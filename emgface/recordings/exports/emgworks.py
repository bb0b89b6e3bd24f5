"""Exports of Delsys EMGworks: columns of instants ``X[s]``, each followed by its signals.

Every sensor has its own column of instants, because sensors and accelerometers have different
rates; columns of slower signals end with empty cells. Lines ``Label: ... Sampling frequency: ...
Unit: ...``, one per signal, may precede the table. Source: Delsys, EMGworks File Utility (export to
CSV); the page on the Trigno format of the documentation of biosigIO.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from emgface.recordings.exports.contract import (
    Block,
    Column,
    Export,
    delimiter_of,
    header_rate,
    split,
)

NAME: str = "EMGworks"

_CLOCK: Final = re.compile(r"X\s?\[(s|ms)\]", re.IGNORECASE)
_UNIT: Final = re.compile(r"(.*?)\s*\[([^\[\]]*)\]")
_STATED: Final = re.compile(
    r"\s*Label:\s*(?P<label>.*?)[\s,;]+Sampling frequency:\s*(?P<rate>[\d.,]+?)[\s,;]"
    r"(?:.*?Number of points:\s*(?P<points>\d+))?(?:.*?Unit:\s*(?P<unit>\S+?)(?:[\s,;]|$))?",
    re.IGNORECASE,
)


def matches(head: Sequence[str]) -> bool:
    """Return True if a line of labels begins with a column of instants ``X[s]``."""
    return _label_row(head) is not None


def _label_row(head: Sequence[str]) -> int | None:
    for k, line in enumerate(head):
        if any(_CLOCK.fullmatch(cell) for cell in split(line, delimiter_of(line))[:1]):
            return k
    return None


def read(path: Path, text: str, head: Sequence[str]) -> Export:
    """Return the signals; each has the instants of the next column ``X[s]`` to its left."""
    row = _label_row(head)
    assert row is not None  # the file matches
    delimiter = delimiter_of(head[row])
    cells = split(head[row], delimiter)
    stated = [match for line in head[:row] if (match := _STATED.match(line))]
    block = Block(path, text, row + 1, delimiter, cells)
    columns: list[Column] = []
    clock = 0
    for k, cell in enumerate(cells):
        if _CLOCK.fullmatch(cell):
            clock = k
            continue
        n = block.used(k)
        if not cell or (n == 0 and block.used(clock) == 0):
            continue  # an empty pair of columns, or a delimiter at the end
        match = _UNIT.fullmatch(cell)
        label, unit = (match.group(1), match.group(2)) if match else (cell, "")
        entry = next((one for one in stated if one["label"].strip() in (label, cell)), None)
        if entry is None and len(stated) == len(cells) // 2:
            entry = stated[len(columns)]
        rate = None if entry is None else header_rate(path, "Sampling frequency", entry["rate"])
        unit = unit or (entry["unit"] or "" if entry else "")
        n = max(n, block.used(clock))  # a signal may end with missing values
        scale = 1e-3 if "ms" in cells[clock].lower() else 1.0
        time = scale * block.numbers(clock)[:n]
        values = np.array(block.numbers(k)[:n])
        points = entry["points"] if entry else None
        count = int(points) if points else None
        columns.append(Column(label, unit, values, rate, time, stated=count))
    return Export(columns, "Delsys")
