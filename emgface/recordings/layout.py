"""Layout of a text table, from its contents: encoding, delimiter, decimal sign, labels, units."""

import codecs
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from emgface.errors import DataError
from emgface.recordings.readers._build import require_few
from emgface.schema.units import quantity_of, spelling
from emgface.texts import marked_encoding, read_bytes

INSPECTED_BYTES: Final = 1 << 20  #: bytes of a file that are looked at
_DELIMITERS: Final = ("\t", ";", ",", "|", r"\s+")
_NUMBER: Final = {
    sign: re.compile(
        rf"[+-]?(\d+({re.escape(sign)}\d*)?|{re.escape(sign)}\d+)([eE][+-]?\d+)?|[nN]a[nN]"
    )
    for sign in (".", ",")
}
_UNIT: Final = re.compile(r"([\[(/_ ])\s*([^\[\]()/_ ]{1,6})\s*[\])]?\s*$")


@dataclass(frozen=True)
class Layout:
    """Format of a text table."""

    encoding: str | None  #: None for UTF-8 or with a byte order mark
    delimiter: str  #: as in a sidecar
    decimal: Literal[".", ","]  #: as in a sidecar
    skip_rows: int  #: lines before the labels, or before the numbers unless `labelled`
    labelled: bool  #: the line after them contains the labels
    #: labels of the columns; ``column 1`` and so on if the file contains none
    labels: tuple[str, ...]
    #: unit of each column by its label or a line of units, empty if none is specified
    units: tuple[str, ...]
    sure: bool  #: no other delimiter fits equally
    skipped: int = 0  #: rows of numbers among the lines that are skipped


def text_layout(path: Path) -> Layout:
    """Determine the layout of a text table, which may be compressed by gzip.

    Raises DataError if the file is not text, or no delimiter separates rows of numbers.
    """
    text, encoding = _text(path)
    lines = text.splitlines()
    tail = [line for line in lines[len(lines) // 2 :] if line.strip()][:200] or [""]
    tried: list[tuple[float, int, int, str, str]] = []
    for rank, delimiter in enumerate(_DELIMITERS):
        for sign in (".", ","):
            if delimiter == sign:
                continue
            share, count = _numbers(tail, delimiter, sign)
            tried.append((share, count, -2 * rank - (sign == ","), delimiter, sign))
    share, count, _, delimiter, sign = max(tried)
    if share < 0.5 or count < 1:
        raise DataError(
            f"{path.name} has no rows of numbers that tabs, semicolons, commas, bars or blanks "
            "separate; expected a table: export it as one."
        )
    # Blanks always fit if tabs do; only another number of columns is an alternative.
    sure = not any(other == share and 0 < n != count for other, n, *_ in tried)
    rows = [_cells(line, delimiter) for line in lines]
    width = Counter(len(_cells(line, delimiter)) for line in tail).most_common(1)[0][0]
    if width > 1 and all(not row[-1] for row in rows if len(row) == width):
        rows = [row[:-1] if len(row) == width else row for row in rows]  # every line ends with one
        width -= 1
    first = next(
        k
        for k, row in enumerate(rows)
        if len(row) == width and _share(row, sign) >= share - 0.25 and _share(row, sign) > 0
    )
    before = [k for k in range(first) if len(rows[k]) == width and any(rows[k])]
    units, label_row = [""] * width, before[-1] if before else None
    if label_row is not None and len(before) > 1 and _are_units(rows[label_row]):
        units, label_row = [spelling(cell) for cell in rows[label_row]], before[-2]
    labels = [f"column {k + 1}" for k in range(width)]
    labelled = label_row is not None and label_row == first - 1
    if label_row is not None:
        labels = [cell or f"column {k + 1}" for k, cell in enumerate(rows[label_row])]
        units = [stated or unit_in(label) for stated, label in zip(units, labels, strict=True)]
    start = first if not labelled or label_row is None else label_row
    decimal: Literal[".", ","] = "," if sign == "," and _has_fractions(tail, delimiter) else "."
    if delimiter == ",":
        decimal = "."
    skipped = sum(_share(row, sign) == 1.0 and any(row) for row in rows[:start])
    return Layout(
        encoding, delimiter, decimal, start, labelled, tuple(labels), tuple(units), sure, skipped
    )  # fmt: skip


def unit_in(label: str) -> str:
    """Return the unit of voltage, length or time at the end of a label, empty without one.

    Examples
    --------
    >>> unit_in("Zyg L [µV]"), unit_in("time (ms)"), unit_in("EMG1")
    ('uV', 'ms', '')
    """
    match = _UNIT.search(label)
    if match is None:
        return ""
    unit = spelling(match.group(2))
    # A single letter after a blank or an underscore is ambiguous, for example an axis or a side.
    certain = match.group(1) in "[(/" or len(unit) > 1
    return unit if certain and quantity_of(unit) else ""


def _text(path: Path) -> tuple[str, str | None]:
    """Beginning of a file as text without its last, possibly truncated, line; and its encoding."""
    try:
        data = read_bytes(path, INSPECTED_BYTES)
    except OSError as error:
        raise DataError(f"{path.name} cannot be read ({error}); expected a text table.") from error
    whole = len(data) < INSPECTED_BYTES
    marked = marked_encoding(data)
    if marked is None and b"\x00" in data[:4096]:
        raise DataError(
            f"{path.name} contains binary data; expected a table of text: export it as CSV."
        )
    encoding = None
    if marked is not None:
        text = data.decode(marked, "replace")
    else:
        try:
            text = codecs.getincrementaldecoder("utf-8")().decode(data, whole)
        except UnicodeDecodeError:
            text, encoding = data.decode("latin-1"), "latin-1"
    text = text.replace("\r\n", "\n").replace("\r", "\n")  # lines of old programs end in a return
    widest = max(map(_width_of, text.split("\n", 400)[:400]), default=0)
    require_few(widest, f"{path.name} has", "columns")
    return (text if whole else text.rpartition("\n")[0]), encoding


def _width_of(line: str) -> int:
    """Most cells that a delimiter separates in a line, except blanks and decimal commas."""
    return 1 + max(line.count(sign) for sign in "\t;,|")


def _cells(line: str, delimiter: str) -> list[str]:
    """Cells of a line."""
    parts = line.split() if delimiter == r"\s+" else line.split(delimiter)
    return [cell.strip().strip('"').strip() for cell in parts]


def _share(row: list[str], sign: str) -> float:
    """Fraction of numbers among the cells of a row that are not empty."""
    filled = [cell for cell in row if cell]
    return sum(bool(_NUMBER[sign].fullmatch(cell)) for cell in filled) / max(1, len(filled))


def _numbers(lines: list[str], delimiter: str, sign: str) -> tuple[float, int]:
    """Fraction of numbers among all cells, to a tenth, and columns; empty if rows differ."""
    rows = [_cells(line, delimiter) for line in lines]
    width, often = Counter(map(len, rows)).most_common(1)[0]
    if often < 0.9 * len(rows):
        return 0.0, 0
    shares = [_share(row, sign) for row in rows if len(row) == width]
    return round(sum(shares) / len(shares), 1), width


def _has_fractions(lines: list[str], delimiter: str) -> bool:
    return any("," in cell for line in lines for cell in _cells(line, delimiter))


def _are_units(row: list[str]) -> bool:
    """Return True if a line between labels and numbers contains units."""
    quantities = [quantity_of(cell.strip("[]()")) for cell in row if cell]
    return bool(quantities) and sum(quantity is not None for quantity in quantities) >= 0.5 * len(
        quantities
    )
