"""Excitation over time: from published probe files, CSV and netCDF files, and piecewise linear ramps."""

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr
from scipy.interpolate import CubicHermiteSpline

from emgface.anatomy.jaw.exciters import excited_activation
from emgface.anatomy.jaw.model import Floats
from emgface.errors import DataError, FeatureWarning, JawError
from emgface.files import existing_file
from emgface.schema.clocks import long_and_coarse, too_slow
from emgface.schema.rules import one_line
from emgface.schema.units import to_si
from emgface.texts import labelled, open_text, read_text

NANOSECONDS = 1e9
_DRIVES = {"am": "my", "pd": "retracthyoid"}
"""Exciters of published series that drive a group; the others drive the muscle of their name."""
_SWITCHED_OFF = ("th", "oh")
"""Series that the published chewing demonstration holds but does not use."""


@dataclass(frozen=True, eq=False)
class Excitation:
    """Excitations [1] of exciters over common times [s], linear in between and held outside.

    ``recorded_start`` is the instant at time 0 of the recording that they were computed from [s],
    if any.
    """

    time: Floats
    values: Mapping[str, Floats]
    recorded_start: float | None = None

    def known_to(self, jaw: xr.Dataset) -> tuple["Excitation", tuple[str, ...]]:
        """Excitations of the exciters that a model has, and the names of the others."""
        names = set(jaw["exciter"].values.tolist())
        known = {name: u for name, u in self.values.items() if name in names}
        absent = tuple(name for name in self.values if name not in names)
        return Excitation(self.time, known, self.recorded_start), absent

    def activation(self, jaw: xr.Dataset) -> tuple[xr.DataArray, float]:
        """Activation (muscle, time) of a jaw model, and the most negative value set to zero."""
        a, negative = excited_activation(jaw, self.values)
        a = np.broadcast_to(a, (len(self.time), jaw.sizes["muscle"]))  # also without any exciter
        coords = {"muscle": jaw["muscle"].values, "time": ("time", self.time, {"units": "s"})}
        return xr.DataArray(a.T, coords, ("muscle", "time"), attrs={"units": "1"}), negative


def ramps(corners: Mapping[str, list[tuple[float, float]]]) -> Excitation:
    """Piecewise linear excitations from corners (time [s], value) of every exciter."""
    time = np.unique([t for series in corners.values() for t, _ in series] or [0.0])
    values = {
        name: np.interp(time, *np.array(series, dtype=np.float64).T)
        for name, series in corners.items()
    }
    return Excitation(time.astype(np.float64), values)


def started(
    path: Path, head: Sequence[str], offset: Floats, error: type[DataError] = JawError
) -> Floats:
    """Times (n,) [s] of a published series from the words of its first line: start, stop and scale.

    The time of a row is start + scale offset. Whole numbers of start and stop are nanoseconds, and
    numbers with a point seconds. Raises the `error` if the numbers are not finite, the scale is not
    positive, the rows do not ascend, or begin after the stop.
    """
    try:
        start, stop = (float(w) if "." in w else int(w) / NANOSECONDS for w in head[:2])
        time = start + float(head[2]) * offset
    except (IndexError, ValueError) as wrong:
        raise error(
            f"{path} begins with {' '.join(head)!r}, expected start, stop and scale of its times"
        ) from wrong
    good = np.isfinite([start, stop]).all() and np.isfinite(time).all()
    if not (good and len(time) and (np.diff(time) > 0.0).all() and start <= stop):
        raise error(
            f"{path}: its times, from {start:g} s to {stop:g} s with the scale {head[2]}, do not "
            "ascend, expected whole nanoseconds or seconds with a point, in order"
        )
    if time[0] > stop + 1e-6:
        raise error(
            f"{path}: its first value is at {time[0]:g} s, after its stop at {stop:g} s, expected both "
            "in the same unit: whole nanoseconds, or seconds with a point"
        )
    return time


def read_probe(path: str | os.PathLike[str], time: Floats) -> Floats:
    """Values (n,) of a published input series at times [s].

    The first line holds start, stop and scale of the times, whole numbers in nanoseconds; the
    second the interpolation, the number of values and ``explicit`` or the interval of the rows;
    rows follow. Cubic series are Hermite splines whose slope at a row is that of the chord of its
    neighbours, at the ends of the first and last chord. Before the first row the value is 0, after
    the last it is held. Raises JawError if the file is absent or has another form.
    """
    path = Path(path)
    try:
        lines = [line.split() for line in read_text(path).splitlines()]
        lines = [words for words in lines if words]
        order, n_values, spacing = lines[1]
        rows = np.array(lines[2:], dtype=np.float64)
        if int(n_values) != 1 or order not in ("Linear", "Cubic"):
            raise ValueError(f"interpolation {order} of {n_values} values")
        if spacing != "explicit":
            rows = np.column_stack([float(spacing) * np.arange(len(rows)), rows])
    except (OSError, ValueError, IndexError) as error:
        raise JawError(
            f"{path} is not an excitation series ({one_line(error)}): expected a line with start, stop "
            "and scale, one with Linear or Cubic, 1, explicit, then time and value"
        ) from error
    t, y = started(path, lines[0], rows[:, 0].astype(np.float64)), rows[:, 1]
    at = np.clip(time, t[0], t[-1])
    if order == "Linear" or len(t) < 3:
        values = np.interp(at, t, y)
    else:
        ends = np.diff(y)[[0, -1]] / np.diff(t)[[0, -1]]
        inner = (y[2:] - y[:-2]) / (t[2:] - t[:-2])
        values = CubicHermiteSpline(t, y, np.concatenate([ends[:1], inner, ends[1:]]))(at)
    return np.where(time < t[0], 0.0, values)


SERIES_INTERVAL: Final = 1e-3
"""Sampling period of published series [s]."""


def read_probes(folder: str | os.PathLike[str], *, duration: float = 1.0) -> Excitation:
    """Excitations of a folder of published series, sampled every `SERIES_INTERVAL`.

    The files are called by side and muscle, such as ``lsm.txt``. Those of the mylohyoid drive both
    of its parts, those of the posterior digastric all retractors of the hyoid, as published;
    thyrohyoid and omohyoid are switched off there. Raises JawError if there is no series, or one
    cannot be read.
    """
    folder = Path(folder)
    time = (np.arange(round(duration / SERIES_INTERVAL) + 1) * SERIES_INTERVAL).astype(np.float64)
    values = dict[str, Floats]()
    sides = {"l": "_L", "r": "_R"}
    for path in sorted(folder.glob("*.txt")):
        side, muscle = sides.get(path.stem[:1]), path.stem[1:]
        if side is None or muscle in _SWITCHED_OFF or not 2 <= len(muscle) <= 4:
            continue  # settings of the display and of the bite plane lie in the same folder
        values[_DRIVES.get(muscle, muscle) + side] = read_probe(path, time)
    if not values:
        raise JawError(f"{folder} contains no excitation series such as lsm.txt")
    return Excitation(time, values)


INCLINATIONS: Final = (("L", "lbitecant.txt"), ("R", "rbitecant.txt"))
"""Side and file of the inclinations of the bite plane."""


def morsel_side(folder: str | os.PathLike[str]) -> str | None:
    """Side of the morsel in a folder of published series, "L" or "R"; None if it does not state one.

    The series ``lbitecant.txt`` and ``rbitecant.txt`` incline the bite plane on the side of the morsel
    and are zero on the other side. Raises JawError if one cannot be read, or both are not zero.
    """
    time = (np.arange(round(1.0 / SERIES_INTERVAL) + 1) * SERIES_INTERVAL).astype(np.float64)
    inclined = [
        side
        for side, name in INCLINATIONS
        if (path := Path(folder) / name).is_file() and np.any(read_probe(path, time))
    ]
    if len(inclined) > 1:
        raise JawError(
            f"{folder} inclines the bite plane on both sides, expected that of the morsel alone: "
            "specify the side, 'L' or 'R'"
        )
    return inclined[0] if inclined else None


def read_excitation(path: str | os.PathLike[str]) -> Excitation:
    """Excitations of a CSV table with a column ``time`` [s], or of a netCDF file, by exciter.

    A netCDF file holds ``excitation`` or ``activation`` over ``exciter`` or ``muscle``, and
    ``time``, as `emgface activate` writes it for a jaw. Raises JawError if there is no such series or
    its times do not ascend or cannot be in seconds; warns (FeatureWarning) if it begins after time 0,
    or is so long and coarse that its times may be in milliseconds.
    """
    path = existing_file(path, "a table or netCDF file", JawError)
    try:
        if path.suffix == ".nc":
            with xr.open_dataset(path, engine="netcdf4", decode_times=False) as opened:
                given = excitation_in(opened.load())
        else:
            table = pd.read_csv(labelled(open_text(path))).set_index("time").astype(np.float64)
            values = {str(name): column.to_numpy() for name, column in table.items()}
            given = Excitation(table.index.to_numpy(dtype=np.float64), values)
    except (OSError, KeyError, ValueError, RuntimeError) as error:
        raise JawError(
            f"{path} contains no excitations ({one_line(error)}): expected a table with a column time "
            "in seconds and one per exciter, or a netCDF file with activation over muscle and time"
        ) from error
    _check_times(path, given)
    return given


def _check_times(path: Path, given: Excitation) -> None:
    """Refuse times that do not ascend or cannot be in seconds; warn of a late start."""
    t = given.time
    if len(t) < 2:
        raise JawError(f"{path} contains {len(t)} instants, expected at least two")
    steps = np.diff(t)
    if not (steps > 0.0).all():
        row = int(np.argmin(steps > 0.0)) + 1
        raise JawError(
            f"{path}: the times do not ascend, {t[row]:g} s follows {t[row - 1]:g} s in row {row + 1}: "
            "expected every instant once, in order"
        )
    if slow := too_slow(t):
        raise JawError(
            f"{path} contains {len(t)} instants every {slow[0]:g} s, expected at most {slow[1]:g} s: "
            "divide times in milliseconds by 1000, or add instants in between"
        )
    if coarse := long_and_coarse(t):
        warnings.warn(
            f"{path.name} lasts {coarse[0]:g} s with an instant every {coarse[1]:g} s: check that its "
            "times are in seconds",
            FeatureWarning,
            stacklevel=3,
        )
    if t[0] > 0.0:
        warnings.warn(
            f"{path.name} begins at {t[0]:g} s: its first values are used from time 0 until then",
            FeatureWarning,
            stacklevel=3,
        )


def duration_of(excitation: Excitation, output: float, wanted: float | None = None) -> float:
    """Duration of the motion by excitations of a file [s]: a wanted one, or that of whole outputs.

    Warns (FeatureWarning) if it is longer than the excitations, whose last values are then held.
    """
    end = float(excitation.time[-1])
    if wanted is None:
        return output * int(end / output + 1e-9)
    if wanted > end + output:
        warnings.warn(
            f"the excitations end at {end:g} s: their last values are held until {wanted:g} s",
            FeatureWarning,
            stacklevel=3,
        )
    return wanted


def excitation_in(dataset: xr.Dataset) -> Excitation:
    """Excitations of a Dataset with ``excitation`` or ``activation`` over time and one other dim.

    Raises JawError if they are no fractions, UnitsError if the unit of the time is absent or is
    not one of time.
    """
    rows = dataset["excitation" if "excitation" in dataset else "activation"]
    if (unit := str(rows.attrs.get("units", "1"))) not in ("1", ""):
        raise JawError(
            f"the unit of {rows.name} is {unit!r}, expected 1: divide percentages by 100"
        )
    rows = rows.assign_coords(time=to_si(rows["time"], "time"))
    (row,) = (dim for dim in rows.dims if dim != "time")
    values = rows.transpose(row, "time").values.astype(np.float64)
    names, start = map(str, rows[row].values), dataset.attrs.get("recorded_start")
    return Excitation(
        rows["time"].values.astype(np.float64),
        dict(zip(names, values, strict=True)),
        None if start is None else float(start),
    )
