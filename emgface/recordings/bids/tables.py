"""Writing of the tables and JSON files of a BIDS dataset."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from emgface.files import locked, write_text
from emgface.recordings.bids.sidecars import read_tsv


def complete_table(path: Path, columns: Sequence[str], rows: Sequence[tuple[str, ...]]) -> None:
    """Add rows to a table, replacing those with the same first cell, and sort by this cell."""
    with locked(path.parent):  # another process may convert to the same dataset
        _complete(path, columns, rows)


def _complete(path: Path, columns: Sequence[str], rows: Sequence[tuple[str, ...]]) -> None:
    stored: dict[str, tuple[str, ...]] = {}
    names = list(columns)
    if path.is_file():
        table = read_tsv(path)
        names = [str(column) for column in table.columns]
        stored = {str(row[0]): tuple(map(str, row)) for row in table.itertuples(index=False)}
    for row in rows:
        new = dict(zip(columns, row, strict=True))
        old = dict(zip(names, stored.get(row[0], ()), strict=False))
        stored[row[0]] = tuple(new.get(column, old.get(column, "n/a")) for column in names)
    write_table(path, names, [stored[key] for key in sorted(stored)])


def write_table(path: Path, columns: Sequence[str], rows: Sequence[tuple[str, ...]]) -> None:
    """Write a table of texts separated by tabs."""
    frame = pd.DataFrame(list(rows), columns=list(columns))
    write_text(path, frame.to_csv(sep="\t", index=False, lineterminator="\n"))


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file that contains an object."""
    write_text(path, json.dumps(dict(content), indent=2, ensure_ascii=False) + "\n")
