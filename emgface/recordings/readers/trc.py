"""TRC files of motion capture: text, three columns for each marker.

Five lines of header (path, names of the next line, counts and units, names of markers, names of
columns), then frame, time and coordinates, separated by tabs, or by commas in some exports. A cell
is empty if the marker was not visible. Source: Motion Analysis Corporation, TRC format, version 4.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from emgface.errors import DataError
from emgface.recordings.ends import doubtful_lines
from emgface.recordings.readers._build import (
    Part,
    assemble_parts,
    position_array,
    positive,
    unique_labels,
)
from emgface.recordings.timebase import TimeBase, of_stamps, with_counter
from emgface.texts import read_text

SUFFIXES = (".trc",)
FORMAT = "TRC"

_COUNTS = ("DataRate", "NumFrames", "NumMarkers", "Units")


def read(path: Path, units: Mapping[str, str]) -> xr.Dataset:
    """Read the markers; empty cells are NaN, and frames that were left out are gaps.

    The column of times determines the rate, and another one in the header is a finding. Raises
    DataError also if counts, frames and times do not agree.
    """
    text = read_text(path, fallback="latin-1")
    rows, header = _rows(path, text)
    rate = positive(path, "DataRate", header["DataRate"])
    frames = int(positive(path, "NumFrames", header["NumFrames"], int))
    count = int(positive(path, "NumMarkers", header["NumMarkers"], int))
    named = [cell.strip() for cell in rows[3][2 : 2 + 3 * count : 3]]
    named += [""] * (count - len(named))
    labels, names = unique_labels(named, "marker")
    table = [row for row in rows[5:] if any(cell.strip() for cell in row)]
    if len(table) != frames:
        raise DataError(
            f"{path.name} declares {frames} frames but contains {len(table)}; expected all of them: "
            "it is truncated, export it again."
        )
    values = _values(path, table, count)
    base = _time_base(path, values[:, 0], values[:, 1], rate)
    base = base.noting(doubtful_lines(text, "\t" if "\t" in text else ","))
    positions = values[:, 2:].reshape(frames, count, 3).transpose(1, 2, 0)
    unit = units.get("position", header["Units"])
    data = position_array(np.ascontiguousarray(positions), labels, base, unit)
    return assemble_parts([Part(data, {"position": header["Units"]}, {}, names)])


def _time_base(path: Path, number: np.ndarray, time: np.ndarray, rate: float) -> TimeBase:
    """Instants of the frames by their times, compared with their numbers and the rate."""
    step = np.diff(number)
    if not (np.isfinite(number).all() and (step == np.rint(step)).all() and (step >= 1).all()):
        at = int(np.argmin(np.nan_to_num(step, nan=-1.0) >= 1)) if step.size else 0
        raise DataError(
            f"{path.name} continues from frame {number[at]:g} to frame "
            f"{number[min(at + 1, number.size - 1)]:g}; expected ascending numbers of frames: it is "
            "damaged, export it again."
        )
    base = of_stamps(
        path.name,
        time,
        nominal=rate,
        by="the column of times",
        nominal_by="the header",
        largest_difference=0.05,
    )
    if not np.array_equal(number - number[0], base.places):
        if base.gaps:
            at = int(np.argmax(number - number[0] != base.places))
            raise DataError(
                f"{path.name}: frame {number[at]:g} is at {time[at]:g} s; expected "
                f"{time[0] + (number[at] - number[0]) / base.rate:g} s at {base.rate:g} Hz: the rate or "
                "the times are wrong, export the file again."
            )
        return with_counter(base, {"frame": number}, least=2)
    return base


def _rows(path: Path, text: str) -> tuple[list[list[str]], dict[str, str]]:
    """Return the cells of all lines, and the counts of the header."""
    lines = text.splitlines()
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        start = lines[0][:20] if lines else ""
        raise DataError(
            f"{path.name} has {len(lines)} lines and begins with {start!r}; expected "
            "'PathFileType', five lines of header and the frames: it is truncated or not a TRC file."
        )
    mark = "\t" if "\t" in lines[1] else ","
    rows = [line.split(mark) for line in lines]
    header = {
        name.strip(): value.strip()
        for name, value in zip(rows[1], rows[2], strict=False)
        if name.strip()
    }
    absent = [name for name in _COUNTS if name not in header]
    if absent:
        raise DataError(
            f"{path.name} specifies no {absent[0]} in its third line; expected "
            f"{', '.join(_COUNTS)}: it is damaged, export it again."
        )
    return rows, header


def _values(path: Path, table: list[list[str]], count: int) -> np.ndarray:
    """Return the numbers of the frames, shape (frames, 2 + 3 markers)."""
    width = 2 + 3 * count
    values = np.full((len(table), width), np.nan)
    for i, row in enumerate(table):
        # Some programs end each line with a separator, others omit empty cells at its end.
        if len(row) > width and any(cell.strip() for cell in row[width:]):
            raise DataError(
                f"{path.name}, frame {row[0]}, has {len(row)} columns; expected {width} for "
                f"{count} markers: the header is damaged, export the file again."
            )
        for j, cell in enumerate(row[:width]):
            text = cell.strip()
            if not text:
                continue
            try:
                values[i, j] = float(text)
            except ValueError:
                raise DataError(
                    f"{path.name}, frame {row[0]}, column {j + 1} contains {text!r}; expected a "
                    "number or an empty cell: repair it."
                ) from None
    if len(table[-1]) < width and not np.isnan(values[:-1, -1]).any():
        raise DataError(f"{path.name} ends within a row; expected complete rows: copy it again.")
    return values
