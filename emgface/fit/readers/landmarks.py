"""Landmarks: CSV, markups of 3D Slicer (.mrk.json, .fcsv) and Amira (.landmarkAscii).

CSV has a header with a column of names (name, label or landmark) and x, y, z, whose unit may follow
as in ``x_mm`` or ``x [mm]``. Slicer states millimetres; points in the frame RAS (right, anterior,
superior) are turned into LPS (left, posterior, superior), in which Slicer stores surfaces, too. Amira
has no names and no unit; the points are numbered from 1.
"""

import csv
import io
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from emgface.errors import FitError
from emgface.fit.readers.guard import FACE, Content, Floats, content_of, metres

MOST_LANDMARK_BYTES: Final = 20_000_000
MOST_LANDMARKS: Final = 5000  #: largest number of landmarks
_COLUMN: Final = re.compile(r"\s*([xyz])\s*(?:[_ ]\s*\[?|\[)?\s*(um|mm|cm|m|in)?\s*\]?\s*", re.I)
_TO_LPS: Final = np.array([-1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Landmarks:
    """Named points (n, 3) [m], with the source and its digest."""

    names: tuple[str, ...]
    position: Floats
    source: str = "given as numbers"
    digest: str = ""


def plain(name: str) -> str:
    """Name in lower case with underscores, as landmarks are compared."""
    return re.sub(r"[\s\-.]+", "_", str(name).strip().lower())


def read_landmarks(
    path: str | os.PathLike[str], *, unit: str | None = None, least: float = FACE[0]
) -> Landmarks:
    """Read landmarks from a file; FitError with the place of the fault if it is unusable.

    `least` [m] is the smallest extent of the points.
    """
    content = content_of(path, MOST_LANDMARK_BYTES)
    lower = content.name.lower()
    for ending, reader in _READERS.items():
        if lower.endswith(ending):
            names, points, stated = reader(content)
            return _checked(names, points, unit, content.name, content.digest, stated, least)
    raise FitError(
        f"{content.name} has an unknown ending, expected one of {', '.join(_READERS)}: export the "
        "landmarks as one of them"
    )


def landmarks_of(
    given: "Landmarks | Mapping[str, Sequence[float]] | pd.DataFrame | str | os.PathLike[str]",
    unit: str | None = None,
    *,
    least: float = FACE[0],
) -> Landmarks:
    """Landmarks from a file, or from numbers by name, which are in metres without a unit.

    `least` [m] is the smallest extent of the points.
    """
    if isinstance(given, Landmarks):
        return given
    if isinstance(given, str | os.PathLike):
        return read_landmarks(given, unit=unit, least=least)
    table = (
        {str(k): row.tolist() for k, row in zip(given.index, given.to_numpy(), strict=True)}
        if isinstance(given, pd.DataFrame)
        else given
    )
    try:
        given_points = [[_real(v) for v in p] for p in table.values()]
        points = np.array(given_points, dtype=np.float64).reshape(-1, 3)
    except (TypeError, ValueError, AttributeError) as error:
        raise FitError(
            f"landmarks are not points of three numbers ({error}), expected {{name: (x, y, z)}}"
        ) from error
    return _checked(list(table), points, unit, "landmarks", "", None if unit else "m", least)


def _real(value: Any) -> float:
    if np.iscomplexobj(value):
        raise TypeError(f"{value} is complex")
    return float(value)


def _checked(
    names: list[str], points: Floats, unit: str | None, source: str, digest: str,
    stated: str | None, least: float,
) -> Landmarks:  # fmt: skip
    if not 0 < len(points) <= MOST_LANDMARKS:
        raise FitError(
            f"{source} has {len(points)} landmarks, expected 1 to {MOST_LANDMARKS}: export them again"
        )
    own = [plain(n) for n in names]
    for k, name in enumerate(own):
        if not name or name in own[:k]:
            what = f"the name {names[k]!r} twice" if name else f"no name for point {k + 1}"
            raise FitError(f"{source} has {what}, expected one name per landmark: correct it")
    return Landmarks(
        tuple(own), metres(points, unit, source, stated=stated, least=least), source, digest
    )


def _csv(content: Content) -> tuple[list[str], Floats, str | None]:
    text = content.text
    first = text.splitlines()[0]
    delimiter = max(",;\t", key=first.count)
    rows = list(csv.reader(io.StringIO(text), delimiter=delimiter))
    header = [cell.strip() for cell in rows[0]]
    columns: dict[str, tuple[int, str | None]] = {}
    for k, cell in enumerate(header):
        if match := _COLUMN.fullmatch(cell):
            columns[match[1].lower()] = k, match[2].lower() if match[2] else None
    label = next(
        (k for k, c in enumerate(header) if plain(c) in ("name", "label", "landmark")), None
    )
    if label is None or set(columns) != {"x", "y", "z"}:
        raise FitError(
            f"{content.name}: the header is {', '.join(header[:8])}; expected the columns name, x, y, "
            "z, with a unit as in x_mm"
        )
    units = {unit for _, unit in columns.values()}
    if len(units) > 1:
        raise FitError(f"{content.name}: x, y and z have different units, expected one unit")
    names, points = [], []
    for line, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        try:
            points.append([float(row[columns[axis][0]]) for axis in "xyz"])
            names.append(row[label])
        except (ValueError, IndexError) as error:
            raise FitError(
                f"{content.name}, line {line}: {delimiter.join(row)[:60]!r} has no three numbers, "
                "expected name, x, y, z"
            ) from error
    return names, np.array(points, dtype=np.float64).reshape(-1, 3), units.pop()


def _markups(content: Content) -> tuple[list[str], Floats, str | None]:
    try:
        lists = json.loads(content.text)["markups"]
        one = lists[0]
        points = [
            p for p in one["controlPoints"] if p.get("positionStatus", "defined") == "defined"
        ]
        names = [str(p.get("label") or p.get("id")) for p in points]
        position = np.array([[float(v) for v in p["position"]] for p in points]).reshape(-1, 3)
        system = one.get("coordinateSystem", "LPS")
        stated = _millimetres(one.get("coordinateUnits", "mm"), content.name)
    except FitError:
        raise
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError) as error:
        raise FitError(
            f"{content.name} is no markups file of 3D Slicer ({type(error).__name__}: "
            f"{str(error)[:80]}), expected markups with controlPoints: save it again"
        ) from error
    if len(lists) > 1:
        raise FitError(
            f"{content.name} has {len(lists)} lists of points, expected one: save one alone"
        )
    return names, _lps(position, str(system), content.name), stated


def _millimetres(unit: Any, name: str) -> str:
    text = unit[0] if isinstance(unit, list) and unit else unit
    if text not in ("mm", "cm", "m", "um"):
        raise FitError(f"{name} states the unit {str(text)[:20]!r}, expected mm")
    return str(text)


def _lps(position: Floats, system: str, name: str) -> Floats:
    if system in ("LPS", "1"):
        return position
    if system in ("RAS", "0"):
        return position * _TO_LPS
    raise FitError(f"{name} has the coordinate system {system[:20]!r}, expected LPS or RAS")


def _fcsv(content: Content) -> tuple[list[str], Floats, str | None]:
    system, columns = "RAS", "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID"
    names, points = [], []
    for line, text in enumerate(content.text.splitlines(), start=1):
        if text.startswith("#"):
            key, _, value = text[1:].partition("=")
            system = value.strip() if key.strip() == "CoordinateSystem" else system
            columns = value.strip() if key.strip() == "columns" else columns
            continue
        if not text.strip():
            continue
        row = next(csv.reader([text]))
        at = columns.split(",")
        try:
            points.append([float(row[at.index(axis)]) for axis in "xyz"])
            names.append(row[at.index("label")] or row[0])
        except (ValueError, IndexError) as error:
            raise FitError(
                f"{content.name}, line {line}: {text[:60]!r} does not fit the columns {columns[:60]}, "
                "expected a file of fiducials of 3D Slicer"
            ) from error
    position = np.array(points, dtype=np.float64).reshape(-1, 3)
    return names, _lps(position, system, content.name), "mm"


def _amira(content: Content) -> tuple[list[str], Floats, str | None]:
    text = content.text
    declared = re.search(r"define\s+Markers\s+(\d{1,9})", text)
    head, mark, body = text.rpartition("\n@1")
    if "AmiraMesh" not in text[:200] or not declared or not mark or "@1" not in head:
        raise FitError(
            f"{content.name} is no landmark set of Amira in ASCII, expected AmiraMesh with Markers"
        )
    values = body.split("@")[0].split()
    try:
        points = np.array([float(v) for v in values]).reshape(-1, 3)
    except ValueError as error:
        raise FitError(f"{content.name}: {error}, expected x, y, z of each landmark") from error
    if len(points) != int(declared[1]):
        raise FitError(
            f"{content.name} declares {declared[1]} landmarks and has {len(points)}, expected the same"
        )
    return [str(k + 1) for k in range(len(points))], points, None


_READERS: Final = {
    ".csv": _csv, ".mrk.json": _markups, ".fcsv": _fcsv, ".landmarkascii": _amira,
}  # fmt: skip
"""Readers by ending; each returns names, points and the stated unit."""
