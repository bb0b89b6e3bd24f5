"""Lines of a table of numbers that were cut, for example because the disk was full, or written twice.

A cut within a line leaves no line end, and usually fewer cells, or fewer decimals or digits in the
last cell than the lines before have. The number is then valid text, but its value is wrong. A line that
was written twice delays everything behind it by one sample.
"""

import re
from itertools import pairwise
from typing import Final

from emgface.recordings.findings import Finding

BEFORE: Final = 20  #: lines before the last that it is compared with
_NUMBER: Final = re.compile(r"[+-]?(?=[.,\d]|$)(\d*)(?:[.,](\d*))?(?:[eE]([+-]?\d*))?", re.ASCII)


_BLANK: Final = re.compile(r"\r?\n(?:[ \t;,]*\r?\n)+(?=[^\r\n])")
SEARCHED: Final = 2000  #: pairs of lines in which successive values are compared
#: most lines that are taken for written twice; more are values that stay the same
REPEATED: Final = 2
LEAST_CHANGING_COLUMNS: Final = 2  #: columns whose successive values must differ everywhere else


def doubtful_lines(text: str, delimiter: str) -> list[Finding]:
    """Findings on the lines of a table: its last one cut, one written twice, or empty ones within."""
    return [
        *cut_line(text, delimiter),
        *repeated_line(text, delimiter),
        *blank_lines(text, delimiter),
    ]


def blank_lines(text: str, delimiter: str) -> list[Finding]:
    """Return a finding on the first empty lines that are within a table of numbers."""
    for gap in _BLANK.finditer(text):
        around = (text[: gap.start()].rpartition("\n")[2], text[gap.end() :].partition("\n")[0])
        cells = [[cell.strip().strip('"') for cell in line.split(delimiter)] for line in around]
        if len(cells[0]) == len(cells[1]) and all(
            any(row) and all(_NUMBER.fullmatch(cell) for cell in row) for row in cells
        ):
            first = text.count("\n", 0, gap.start()) + 2
            values = {"first": first, "last": first + gap[0].count("\n") - 2}
            return [Finding("blank_line", values=values)]
    return []


def repeated_line(text: str, delimiter: str) -> list[Finding]:
    """Return a finding if a line equals the one before, and nowhere else do successive values.

    In at least `LEAST_CHANGING_COLUMNS` columns, successive values differ in all other pairs of
    lines (of the `SEARCHED` nearest ones). Signals of few levels, or at rest, repeat values also
    elsewhere.
    """
    lines = text.rstrip("\x00\x1a\r\n").split("\n")
    same = [k for k, (a, b) in enumerate(pairwise(lines)) if a == b and delimiter in a]
    if not same or len(same) > REPEATED:
        return []
    first = max(0, same[0] - SEARCHED // 2)
    near = [line.split(delimiter) for line in lines[first : first + SEARCHED]]
    own = near[same[0] - first]
    if not all(_NUMBER.fullmatch(cell.strip()) for cell in own):
        return []
    rows = [(k, cells) for k, cells in enumerate(near, first) if len(cells) == len(own)]
    others = [(a, b) for (k, a), (_, b) in pairwise(rows) if k not in same]
    unequal = sum(
        bool(own[k].strip()) and all(a[k] != b[k] for a, b in others) for k in range(len(own))
    )
    if len(others) < BEFORE or unequal < LEAST_CHANGING_COLUMNS:
        return []
    values = {"line": same[0] + 2, "cells": unequal}
    return [Finding("repeated_line", values=values)]


def cut_line(text: str, delimiter: str) -> list[Finding]:
    """Return a finding if the last line has no line end and less than the lines before it.

    Less means fewer cells, or a last number with fewer decimals, fewer digits or a shorter exponent
    than those of all `BEFORE` lines before.
    """
    end = text.rstrip("\x00\x1a")
    lines = [line for line in end[-100_000:].splitlines() if line.strip()]
    if not end or end[-1] in "\r\n" or len(lines) < 4:
        return []
    *before, last = (line.split(delimiter) for line in lines[-BEFORE - 1 :])
    # Lines of a header do not consist of numbers; their last cells may be empty.
    before = [c for c in before if all(_NUMBER.fullmatch(c[k].strip()) for k in (0, -1))] or before
    counts = [len(cells) for cells in before]
    usual = max(counts, key=counts.count)  # a header has another number of cells
    fewer = len(last) < usual
    ends = [cells[-1].strip() for cells in before if len(cells) == usual]
    if not fewer and not (len(last) == usual and _shorter(last[-1].strip(), ends)):
        return []
    why = "fewer cells" if fewer else "a shorter last number"
    return [Finding("cut", values={"line": lines[-1].strip()[-30:], "why": why})]


def _shorter(last: str, before: list[str]) -> bool:
    """Test if a number has less of a part than all numbers before it."""
    if not last or not before:
        return bool(before) and all(before)
    parts = [_NUMBER.fullmatch(cell) for cell in (last, *before)]
    if any(part is None for part in parts):
        return False
    sizes = [tuple(len(group or "") for group in part.groups()) for part in parts if part]
    own, others = sizes[0], sizes[1:]
    # Behind digits or decimals that were cut, the later parts are absent, too.
    return any(own[k] < min(size[k] for size in others) for k in range(3))
