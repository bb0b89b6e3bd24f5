"""Text exports of BIOPAC AcqKnowledge: rate, number of channels, label and unit line by line.

The header has the name of the file, the interval (``1 msec/sample``), the number of channels, two
lines per channel, a row of channel numbers (``CH1``, ``CH2``), which a column of instants may
precede, and a row of sample counts. Analog inputs are numbered 1 to 16, digital ones from 28, and
calculation channels from 40. Source: BIOPAC Systems, AcqKnowledge software guide (saving as text),
and published exports.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from emgface.errors import DataError
from emgface.recordings.exports.contract import (
    Block,
    Column,
    Export,
    delimiter_of,
    header_rate,
    seconds_in,
    split,
)

NAME: str = "AcqKnowledge"
DIGITAL, CALCULATED = 28, 40  #: first numbers of digital inputs, and of calculation channels

_INTERVAL: Final = re.compile(
    r"\s*([\d.,]+(?:e[+-]?\d+)?)\s*(usec|msec|sec|min)/sample\b.*", re.IGNORECASE
)
_COUNT: Final = re.compile(r"\s*(\d+)\s+channels?\b.*", re.IGNORECASE)
_NUMBERED: Final = re.compile(r"CH\s?(\d+)", re.IGNORECASE)
_SECONDS: Final = {"usec": 1e-6, "msec": 1e-3, "sec": 1.0, "min": 60.0}
_CLOCKS: Final = {"millisec": "ms", "msec": "ms", "sec": "s", "seconds": "s", "min": "min",
                  "minutes": "min", "usec": "us", "time": "s"}  # fmt: skip


def matches(head: Sequence[str]) -> bool:
    """Return True if one of the first lines states an interval per sample, and the next a count."""
    return _interval_row(head) is not None


def _interval_row(head: Sequence[str]) -> int | None:
    for k, line in enumerate(head[:6]):
        if _INTERVAL.fullmatch(line) and any(_COUNT.fullmatch(one) for one in head[k + 1 : k + 3]):
            return k
    return None


def read(path: Path, text: str, head: Sequence[str]) -> Export:
    """Return the channels; digital and calculation channels are set apart."""
    row = _interval_row(head)
    assert row is not None  # the file matches
    interval = _INTERVAL.fullmatch(head[row])
    assert interval is not None
    period = header_rate(path, "interval", interval.group(1)) * _SECONDS[interval.group(2).lower()]
    rate = 1.0 / period
    at = next(k for k in range(row + 1, row + 3) if _COUNT.fullmatch(head[k]))
    number = _COUNT.fullmatch(head[at])
    count = int(number.group(1)) if number else 0
    numbered = at + 1 + 2 * count
    if count < 1 or numbered >= len(head):
        raise DataError(
            f"{path.name} declares {count} channels in a header of {len(head)} lines; expected a "
            "label and a unit for each: it is truncated or damaged, export it again."
        )
    labels = [head[at + 1 + 2 * k].strip() for k in range(count)]
    units = [head[at + 2 + 2 * k].strip() for k in range(count)]
    delimiter = delimiter_of(head[numbered])
    cells = [cell for cell in split(head[numbered], delimiter) if cell]
    numbers = [_NUMBERED.fullmatch(cell) for cell in cells]
    ahead = len(cells) - count  # 1 if a column of instants precedes the channels
    if ahead not in (0, 1) or any(one is None for one in numbers[ahead:]):
        raise DataError(
            f"{path.name} declares {count} channels, and the row of their numbers is "
            f"{head[numbered][:60]!r}; expected CH1 and so on: the header is damaged, export it again."
        )
    stated = _counts(head[numbered + 1 :], delimiter, ahead)
    start = numbered + 1 + (stated is not None)
    block = Block(path, text, start, delimiter, cells)
    time = None
    if ahead:
        unit = _CLOCKS.get(cells[0].lower(), cells[0])
        time = seconds_in(path, block.numbers(0), unit)
    columns: list[Column] = []
    for k, (label, unit) in enumerate(zip(labels, units, strict=True)):
        n = block.used(ahead + k)
        one = numbers[ahead + k]
        apart = _apart(int(one.group(1)) if one else 0)
        if n < block.n_rows and not apart:
            apart = f"has {n} of {block.n_rows} samples: it was recorded at another rate"
        values, instants = (
            np.array(block.numbers(ahead + k)[:n]),
            None if time is None else time[:n],
        )
        count = stated[k] if stated is not None and k < len(stated) else None
        columns.append(Column(label, unit, values, rate, instants, apart, count))
    return Export(columns, "BIOPAC")


def _counts(below: Sequence[str], delimiter: str, ahead: int) -> list[int] | None:
    """Return the counts of samples in the line below the channel numbers, None if it has none."""
    if not below:
        return None
    cells = [cell for cell in split(below[0], delimiter) if cell]
    # With instants the first cell of this row is empty, and that of a row of numbers is not.
    whole = bool(cells) and all(re.fullmatch(r"\d+", cell) for cell in cells)
    led = not ahead or below[0].startswith(delimiter)
    following = [cell for cell in split(below[1], delimiter) if cell] if len(below) > 1 else []
    fractions = any(not re.fullmatch(r"[+-]?\d+", cell) for cell in following)
    if whole and led and (min(map(int, cells)) > 1 or fractions):
        return list(map(int, cells))
    return None


def _apart(number: int) -> str:
    if number >= CALCULATED:
        return f"calculation channel CH{number}: processed, not recorded"
    if number >= DIGITAL:
        return f"digital input CH{number}, not EMG"
    return ""
