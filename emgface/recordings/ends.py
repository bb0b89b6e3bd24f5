"""Test if the last line of a table of numbers is incomplete, for example because the disk was full.

A cut within a line leaves no line end, and usually fewer cells, or fewer decimals or digits in the
last cell than the lines before have. The number is then valid text, but its value is wrong.
"""

import re
from typing import Final

from emgface.recordings.findings import Finding

BEFORE: Final = 20  #: lines before the last that it is compared with
_NUMBER: Final = re.compile(r"[+-]?(?=[.,\d]|$)(\d*)(?:[.,](\d*))?(?:[eE]([+-]?\d*))?", re.ASCII)


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
