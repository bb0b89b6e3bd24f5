"""Positions of the electrodes: ``*_electrodes.tsv`` and ``*_coordsystem.json`` of a BIDS dataset."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import pandas as pd

from emgface.errors import DataError
from emgface.muscles import AXES
from emgface.recordings.bids.sidecars import read_json, read_tsv, sidecar_path
from emgface.texts import finite

LINKS: Final = ("signal_electrode", "reference", "target_muscle")
"""Columns of ``*_channels.tsv`` that are read for each channel."""


def read_electrodes(path: Path, channels: pd.DataFrame) -> str | None:
    """Read the electrodes of an EMG file from a dataset, with the table of its channels.

    The JSON object is the attribute ``electrodes`` of a recording: ``channels`` (electrodes and
    muscle of each channel, by the labels of the table), ``positions`` (of each electrode, null if
    unknown), ``spaces`` (label of the coordinate system of each, if stated) and ``system`` (the
    coordinate system). Returns None if electrodes are not specified. Raises DataError if a file is
    damaged, or a position is not a number.
    """
    electrodes: dict[str, Any] = {}
    columns = [name for name in LINKS if name in channels]
    links = {
        str(row["name"]): {name: str(row[name]) for name in columns if str(row[name]) != "n/a"}
        for row in channels.to_dict("records")
    }
    if any("signal_electrode" in link for link in links.values()):
        electrodes["channels"] = links
    table = sidecar_path(path, "electrodes.tsv")
    if table is not None:
        electrodes["positions"] = _positions(table)
        rows = read_tsv(table)
        if "coordinate_system" in rows:
            cells = zip(rows["name"], rows["coordinate_system"], strict=True)
            electrodes["spaces"] = {str(name): str(space) for name, space in cells}
        system = sidecar_path(path, "coordsystem.json")
        if system is not None:
            electrodes["system"] = read_json(system)
    return json.dumps(electrodes, ensure_ascii=False) if electrodes else None


def _positions(table: Path) -> dict[str, list[float | None]]:
    rows = read_tsv(table)
    absent = [name for name in ("name", "x", "y") if name not in rows]
    if absent:
        raise DataError(
            f"{table.name} lacks the column {absent[0]!r}; expected name, x and y: repair it."
        )
    positions: dict[str, list[float | None]] = {}
    for row in rows.to_dict("records"):
        place: list[float | None] = []
        for axis in AXES:
            cell = str(row.get(axis, "n/a"))
            try:
                place.append(None if cell == "n/a" else finite(cell))
            except ValueError as error:
                raise DataError(
                    f"{table.name}: {axis} of the electrode {row['name']!r} is {cell!r}; expected a "
                    "number or n/a: repair it."
                ) from error
        positions[str(row["name"])] = place
    return positions


def electrode_tables(
    attribute: str, names: Sequence[str], original: Mapping[str, str]
) -> tuple[list[tuple[str, ...]], list[tuple[str, ...]], dict[str, Any]]:
    """Return the rows that describe the electrodes (attribute ``electrodes``) of a recording.

    `names` are its channels, `original` the labels in the source of channels that were renamed.
    Returned are the cells of ``LINKS`` for each channel; the rows name, x, y, z, coordinate_system
    of ``*_electrodes.tsv``, empty if no position is known; and the content of
    ``*_coordsystem.json``. Raises DataError if the attribute is not such an object.
    """
    try:
        electrodes = json.loads(attribute)
        links, places = electrodes.get("channels", {}), electrodes.get("positions", {})
        cells = []
        for name in names:
            link = links.get(name, links.get(original.get(name, ""), {}))
            cells.append(tuple(str(link.get(key, "n/a")) for key in LINKS))
        spaces = electrodes.get("spaces", {})
        rows = [
            (
                name,
                *("n/a" if value is None else repr(float(value)) for value in place),
                str(spaces.get(name, "n/a")),
            )
            for name, place in places.items()
        ]
        return cells, rows, dict(electrodes.get("system", {}))
    except (json.JSONDecodeError, AttributeError, TypeError, ValueError) as error:
        raise DataError(
            f"The attribute 'electrodes' is {attribute[:60]!r}; expected a JSON object with "
            "channels, positions and system: remove it, or read the recording again."
        ) from error
