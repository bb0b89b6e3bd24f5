"""Area functions of the vocal tract: tables, idealised vowels, and the lips of a moving face."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from emgface.acoustics import CLOSURE_AREA
from emgface.anatomy.airway.parameters import LIP_SECTION_LENGTH, TractParameters
from emgface.anatomy.airway.sections import centre_line, sections
from emgface.errors import DataError, listed
from emgface.face.artisynth_contact import read_obj
from emgface.schema.netcdf import read_netcdf
from emgface.texts import labelled, open_text

Floats = NDArray[np.float64]

IDEAL: Final = {
    "u": ((0.02, 1.5), (0.065, 9.0), (0.03, 0.8), (0.045, 8.0), (0.01, 0.6)),
    "a": ((0.02, 1.5), (0.07, 1.0), (0.07, 7.0), (0.01, 5.0)),
    "i": ((0.02, 1.5), (0.075, 9.0), (0.06, 0.7), (0.01, 3.0)),
}
"""Tubes (length [m], area [cm^2]) from the glottis to the lips, idealised by this package: two or three
cavities of the size of an adult's, as textbooks draw them. They are no person's measures."""
SECTION_LENGTH: Final = 0.005
"""Length of a section of the idealised vowels [m]."""
SECTION: Final = 0.0025
"""Length of the sections of tubes whose parts move [m]."""
SHORTEST_LIPS: Final = 1e-3
"""Length to which lips can be retracted [m]."""
SURFACE_UNITS: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
"""Units of surfaces [m]."""
FRAME_INTERVAL: Final = 0.01
"""Time between the instants to which the frames of a trajectory are interpolated [s]."""
TUBE_ONLY: Final = (
    "waves are one-dimensional (valid to 4-5 kHz); piriform sinuses, side branches and turbulence in "
    "three dimensions are not simulated"
)


def area_function(
    areas: Floats, length: Floats, time: Floats, *, origin: str = "simulated", assumptions: str = ""
) -> xr.Dataset:
    """Dataset of the kind "sound" of areas (time, section) [m^2] and lengths (time,) [m]."""
    return xr.Dataset(
        {
            "area": (("time", "section"), np.asarray(areas, np.float64), {"units": "m2"}),
            "length": ("time", np.asarray(length, np.float64), {"units": "m"}),
        },
        {"time": ("time", np.asarray(time, np.float64), {"units": "s"})},
        {"origin": origin, "assumptions": "; ".join(filter(None, (assumptions, TUBE_ONLY)))},
    )


LEAST_WIDEST: Final = 0.05  #: area that the widest section of any vocal tract exceeds [cm2]
_AREA = re.compile(r"A(0|[1-9][0-9]*)_cm2")
"""Name of a column of areas."""


def ideal_vowel(name: str) -> xr.Dataset:
    """Area function of an idealised vowel of `IDEAL`.

    Raises
    ------
    DataError
        The vowel is unknown.
    """
    if name not in IDEAL:
        raise DataError(f"unknown vowel {name!r}, expected {listed(IDEAL)}, or a table of areas")
    counts = [round(length / SECTION_LENGTH) for length, _ in IDEAL[name]]
    areas = np.repeat([1e-4 * area for _, area in IDEAL[name]], counts)
    description = f"idealised vowel {name!r}, no person's measures"
    return area_function(
        areas[None], np.array([SECTION_LENGTH * len(areas)]), np.zeros(1), assumptions=description
    )


def read_areas(path: Path, row: str | None = None, *, from_lips: bool = False) -> xr.Dataset:
    """Read an area function (kind "sound") from a CSV table, with one row per shape.

    Columns are A0_cm2, A1_cm2, ... (areas of sections of equal length, from the glottis unless
    `from_lips`) and length_m. Rows with a column time_s are instants of one changing shape;
    otherwise `row` chooses one by the column label or index. Raises DataError if the table cannot
    be read or is not valid.
    """
    try:
        table = pd.read_csv(labelled(open_text(path)), dtype={"label": str, "index": str})
    except (OSError, ValueError) as error:
        raise DataError(f"{path} cannot be read as a CSV table: {error}") from error
    numbers = sorted(int(m[1]) for c in table.columns if (m := _AREA.fullmatch(str(c))))
    if numbers != list(range(len(numbers))):
        absent = sorted(set(range(numbers[-1])) - set(numbers))
        raise DataError(
            f"{path.name} has no column A{(absent or numbers)[0]}_cm2, expected A0_cm2 to "
            f"A{numbers[-1]}_cm2 once each, without gaps"
        )
    names = [f"A{k}_cm2" for k in numbers]
    if not names or "length_m" not in table:
        raise DataError(
            f"{path.name} has the columns {listed(table.columns)}; expected A0_cm2, A1_cm2, ... and "
            "length_m, in one row per shape"
        )
    if "time_s" in table and row is not None:
        raise DataError(
            f"{path.name} has a column time_s, whose rows are instants of one shape, expected one shape "
            f"per row to choose {row!r}: leave the row out, or the column"
        )
    if "time_s" not in table:
        if row is not None:
            match = [
                name for name in ("label", "index") if name in table and (table[name] == row).any()
            ]
            table = table[table[match[0]] == row] if match else table.iloc[:0]
        if len(table) != 1:
            raise DataError(
                f"{path.name} has {len(table)} rows{f' {row!r}' if row else ''}, expected one shape or "
                "a column time_s: choose a row by its label or index"
            )
    values = table[names].to_numpy(dtype=float)[:, :: -1 if from_lips else 1]
    length = table["length_m"].to_numpy(dtype=float)
    if not (np.isfinite(values).all() and (values >= 0.0).all() and np.isfinite(length).all()):
        raise DataError(f"{path.name} contains areas or lengths that are negative or not finite")
    if values.max() < LEAST_WIDEST:
        raise DataError(
            f"{path.name} contains areas up to {values.max():.2g} cm2, expected those of a vocal tract, "
            f"the widest above {LEAST_WIDEST:g} cm2: check the unit, 1 m2 is 1e4 cm2"
        )
    if not (length > 0.0).all():
        raise DataError(f"{path.name} contains the length {length.min():g} m, expected lengths > 0")
    time = table["time_s"].to_numpy(dtype=float) if "time_s" in table else np.zeros(1)
    if not (np.isfinite(time).all() and (np.diff(time) > 0.0).all()):
        raise DataError(f"{path.name} contains times that are absent or do not ascend in time_s")
    return area_function(1e-4 * values, length, time, assumptions=f"areas of {path.name}")


def areas_of_surface(
    path: Path,
    start: Sequence[float],
    *,
    end: Sequence[float] | None = None,
    unit: str = "m",
    count: int = 40,
) -> xr.Dataset:
    """Area function (kind "sound") of `count` sections of a surface (``.obj`` of triangles).

    `start` and `end` are points at the glottis and at the lips in the unit of the file (m, cm or
    mm); without `end`, the centre line goes to the farthest point of the surface. Raises DataError
    if the file cannot be read, the unit is unknown, or no tube surrounds the line.
    """
    if unit not in SURFACE_UNITS:
        raise DataError(f"unknown unit {unit!r}, expected {listed(SURFACE_UNITS)}")
    position, triangle = read_obj(path)
    position = SURFACE_UNITS[unit] * position
    first, last = (
        None if at is None else SURFACE_UNITS[unit] * np.array(at) for at in (start, end)
    )
    assert first is not None, "start is specified"
    line = centre_line(position, triangle, first, end=last, levels=2 * count)
    cuts = sections(position, triangle, line, count=count)
    description = f"sections of {path.name} across a centre line from {tuple(start)} {unit}"
    areas, length = cuts.area[None], np.array([cuts.length])
    return area_function(areas, length, np.zeros(1), origin="measured", assumptions=description)


def tract_of(
    parameters: TractParameters, row: str | None = None, *, from_lips: bool = False
) -> xr.Dataset:
    """Area function of an idealised vowel, or of a file; `row` and `from_lips` as in `read_areas`."""
    if parameters.areas is None:
        return ideal_vowel(parameters.vowel)
    if parameters.areas.suffix.lower() == ".nc":
        return read_netcdf(parameters.areas, "sound")
    return read_areas(parameters.areas, row, from_lips=from_lips)


def equal_sections(
    area: Floats, length: Floats, *, count: int | None = None
) -> tuple[Floats, Floats]:
    """Areas (frames, count) of sections of equal length, and lengths (frames,) of tubes of parts.

    `area` and `length` (frames, parts) [m^2], [m] change with time; without `count`, sections are
    about `SECTION` long. A section that spans several parts has their harmonic mean, which keeps the
    inertia of the air and is continuous in time, unlike the area at its middle.
    """
    total = length.sum(axis=1)
    n = count or max(2, round(float(total.max()) / SECTION))
    edge = np.linspace(0.0, 1.0, n + 1)[None] * total[:, None]
    inertia = np.cumsum(length / np.maximum(area, CLOSURE_AREA), axis=1)
    own = np.cumsum(length, axis=1)
    sums = [
        np.interp(at, np.append(0.0, x), np.append(0.0, y))
        for at, x, y in zip(edge, own, inertia, strict=True)
    ]
    return np.diff(edge, axis=1) / np.diff(sums, axis=1), total


def with_lips(
    tract: xr.Dataset,
    area: Floats,
    protrusion: Floats,
    time: Floats,
    *,
    lips: float = LIP_SECTION_LENGTH,
) -> xr.Dataset:
    """Put moving lips in front of a tract that does not move.

    The tube of the tract ends `lips` metres before its end. There the section of the lips begins, whose
    area is that of the opening between the lips seen from the front and whose length is `lips` plus
    the protrusion. The lip plane is therefore that of the margins in the midline; the corners, which
    lie further back, are not represented.

    Parameters
    ----------
    tract : Dataset
        Area function of one instant.
    area, protrusion : ndarray, shape (frames,)
        Area between the lips [m^2] and forward displacement of their margins [m].
    time : ndarray, shape (frames,)
        [s]
    lips : float
        Length of the lips' section at rest [m].

    Returns
    -------
    Dataset
        Sections of 2.5 mm at rest, which are stretched together with the length; a section that spans
        two areas has their harmonic mean, which keeps the inertia of the air.

    Raises
    ------
    DataError
        The tract moves, or is not longer than the lips.
    """
    L = float(tract["length"].values[0])
    if tract.sizes["time"] != 1 or L <= lips:
        raise DataError(
            f"the tract has {tract.sizes['time']} instants and a length of {L:.3g} m, expected one "
            f"instant and more than the {lips:g} m of the lips: choose a shape that does not move"
        )
    given = tract["area"].values[0]
    own = np.linspace(0.0, L, len(given) + 1)
    behind = np.diff(np.minimum(own, L - lips))
    parts = np.hstack([np.tile(given, (len(time), 1)), area[:, None]])
    front = np.maximum(lips + protrusion, SHORTEST_LIPS)[:, None]
    ways = np.hstack([np.tile(behind, (len(time), 1)), front])
    areas, total = equal_sections(parts, ways, count=max(len(given), round(L / SECTION)))
    description = (
        f"only the lips move, in front of a tract that does not ({tract.attrs['assumptions']})"
    )
    return area_function(areas, total, time, assumptions=description.replace(f"; {TUBE_ONLY}", ""))


def lips_of_trial(trajectory: xr.Dataset) -> tuple[Floats, Floats, Floats]:
    """Area between the lips [m^2], protrusion of their margins [m] and time [s] of a trajectory.

    Outputs that are farther apart than `FRAME_INTERVAL` are interpolated by monotone cubics,
    because corners of a piecewise linear opening would be heard as clicks. Raises DataError without
    ``mouth_area``.
    """
    names = ("mouth_area", "lip_protrusion")
    if any(name not in trajectory for name in names):
        raise DataError(
            "the trajectory has no mouth_area, expected a trajectory of a face with a mouth opening: "
            "simulate it again with this version"
        )
    at = np.asarray(trajectory["time"].values, np.float64)
    pair = np.stack([np.asarray(trajectory[name].values, np.float64) for name in names], axis=1)
    if len(at) > 1 and float(np.diff(at).max()) > FRAME_INTERVAL:
        time = np.linspace(at[0], at[-1], round((at[-1] - at[0]) / FRAME_INTERVAL) + 1)
        at, pair = time, np.asarray(PchipInterpolator(at, pair, axis=0)(time))
    return np.maximum(pair[:, 0], 0.0), pair[:, 1], at
