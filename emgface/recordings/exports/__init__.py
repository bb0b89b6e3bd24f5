"""Text exports of recording programs: `EXPORTS` lists the layouts, one module each."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from emgface.recordings.exports import (
    acqknowledge,
    emgworks,
    noraxon,
    opensignals,
    trigno_discover,
)
from emgface.recordings.exports.contract import HEADER_LINES, Layout
from emgface.texts import decoded, read_bytes

EXPORTS: Final[tuple[Layout, ...]] = (
    opensignals,
    acqknowledge,
    noraxon,
    trigno_discover,
    emgworks,
)
"""Layouts, in the order in which they are tried."""
SUFFIXES: Final = (".csv", ".txt", ".asc", ".gz")
"""Suffixes of exports; other tables with these suffixes need a sidecar."""
_START: Final = 1 << 18  #: bytes in which a layout is recognised


def head_of(text: str) -> list[str]:
    """Return the first lines of a text, which contain the header."""
    return [line.rstrip("\r") for line in text[:_START].split("\n", HEADER_LINES)[:HEADER_LINES]]


def layout_of(path: Path) -> Layout | None:
    """Return the layout of an export; None for another file or one that cannot be read."""
    if path.suffix.lower() not in SUFFIXES:
        return None
    try:
        text = decoded(read_bytes(path, _START), fallback="latin-1")
    except (OSError, ValueError):  # DataError is a ValueError; read_recording states it
        return None
    return layout_in(head_of(text))


def layout_in(head: Sequence[str]) -> Layout | None:
    """Return the layout to which the first lines of a file belong, None for no known one."""
    return next((one for one in EXPORTS if one.matches(head)), None)
