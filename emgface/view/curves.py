"""Activation curves by knots: interpolation, editing, and files of them (CSV, netCDF, probe files)."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal, get_args

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from emgface.anatomy.jaw.series import NANOSECONDS
from emgface.errors import DataError
from emgface.files import write_text
from emgface.texts import labelled, read_text

Floats = NDArray[np.float64]
Interpolation = Literal["linear", "cubic", "step"]

MOST_KNOTS, LONGEST_CURVE = 20000, 60.0
"""Largest number of knots of all curves, and largest duration [s]."""
SAMPLING: Final = 1e-3  #: interval at which cubic curves are sampled [s]
STEP_TIME: Final = 1e-6  #: time in which a step curve changes [s]
PROBE: Final = ".txt"  #: suffix of probe files, one for each muscle
MIRRORED_SIDE: Final = {"L": "R", "R": "L"}


@dataclass(frozen=True)
class Curves:
    """Activation of some muscles over time.

    Attributes
    ----------
    knots : mapping
        By muscle, an array (n, 2) of times [s], which ascend, and values [1]. The value is constant
        before the first and after the last knot. Values outside 0 to 1 are kept as they are and
        limited by `at`.
    duration : float
        End of the motion [s].
    interpolation : str
        "linear"; "cubic", a Hermite spline whose slope at a knot is that of the chord of its
        neighbours; or "step", constant until the next knot.

    Raises
    ------
    DataError
        A time or value is not finite, times do not ascend, or there are too many knots.
    """

    knots: Mapping[str, Floats]
    duration: float
    interpolation: Interpolation = "linear"
    clipped: int = field(init=False)  #: number of knots outside 0 to 1

    def same(self, other: "Curves") -> bool:
        """Return True if knots, duration and interpolation are equal."""
        equal = self.knots.keys() == other.knots.keys() and all(
            np.array_equal(rows, other.knots[muscle]) for muscle, rows in self.knots.items()
        )
        return equal and (self.duration, self.interpolation) == (
            other.duration,
            other.interpolation,
        )

    def __post_init__(self) -> None:
        if self.interpolation not in get_args(Interpolation):
            raise DataError(
                f"the interpolation is {str(self.interpolation)[:40]!r}, expected linear, cubic or step"
            )
        knots = {name: _checked(name, rows) for name, rows in self.knots.items()}
        if (count := sum(map(len, knots.values()))) > MOST_KNOTS:
            raise DataError(f"the curves have {count} knots, expected at most {MOST_KNOTS}")
        if not (isinstance(self.duration, float | int) and 0.0 < self.duration <= LONGEST_CURVE):
            raise DataError(
                f"the duration is {self.duration!r}, expected a number of seconds up to "
                f"{LONGEST_CURVE:g}"
            )
        outside = sum(int(((k[:, 1] < 0.0) | (k[:, 1] > 1.0)).sum()) for k in knots.values())
        object.__setattr__(self, "knots", knots)
        object.__setattr__(self, "clipped", outside)

    def at(self, muscle: str, time: Floats) -> Floats:
        """Activation (n,) of a muscle at times [s], limited to 0-1; 0 if it has no curve."""
        if muscle not in self.knots:
            return np.zeros(len(time))
        t, y = self.knots[muscle].T
        inside = np.clip(time, t[0], t[-1])
        if self.interpolation == "step":
            values = y[np.clip(np.searchsorted(t, inside, side="right") - 1, 0, None)]
        elif self.interpolation == "linear" or len(t) < 3:
            values = np.interp(inside, t, y)
        else:
            chord = np.diff(y) / np.diff(t)
            inner = (y[2:] - y[:-2]) / (t[2:] - t[:-2])
            slopes = np.concatenate([chord[:1], inner, chord[-1:]])
            values = CubicHermiteSpline(t, y, slopes)(inside)
        return np.clip(values, 0.0, 1.0)

    def instants(self) -> Floats:
        """Times [s] between which all curves are linear (cubic ones every `SAMPLING`)."""
        if self.interpolation == "cubic":
            return np.linspace(0.0, self.duration, round(self.duration / SAMPLING) + 1)
        own = [rows[:, 0] for rows in self.knots.values()]
        if self.interpolation == "step":  # the former value holds until just before a knot
            own += [rows[:, 0] - STEP_TIME for rows in self.knots.values()]
        every = np.concatenate([[0.0, self.duration], *own])
        return np.unique(every[(every >= 0.0) & (every <= self.duration)])

    def activation(self, muscles: Sequence[str]) -> tuple[Floats, Floats]:
        """Times (n,) [s] and activations (n, n_muscles), in the order of the muscles of a face.

        Raises DataError if a curve belongs to none of them.
        """
        if foreign := [name for name in self.knots if name not in muscles]:
            raise DataError(
                f"the face has no muscle {', '.join(foreign)[:200]}, expected some of "
                f"{', '.join(muscles)}"
            )
        time = self.instants()
        return time, np.column_stack([self.at(name, time) for name in muscles])

    def mirrored(self) -> "Curves":
        """The same curves with left and right muscles exchanged."""
        return replace(self, knots={mirrored(name): rows for name, rows in self.knots.items()})

    def moved(self, shift: float = 0.0, stretch: float = 1.0) -> "Curves":
        """The same curves at times ``stretch t + shift`` [s]."""
        change = np.array([stretch, 1.0]), np.array([shift, 0.0])
        return replace(self, knots={k: v * change[0] + change[1] for k, v in self.knots.items()})


def mirrored(muscle: str) -> str:
    """Name of the muscle of the other side."""
    stem, _, side = muscle.rpartition("_")
    return f"{stem}_{MIRRORED_SIDE[side]}" if stem and side in MIRRORED_SIDE else muscle


def _checked(name: str, rows: Any) -> Floats:
    """Knots (n, 2) of a curve."""
    try:
        knots = np.asarray(rows, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        knots = np.empty((0, 0))
    if knots.ndim != 2 or knots.shape[1:] != (2,) or not len(knots):
        raise DataError(f"the curve of {name[:60]!r} contains no pairs of time and value")
    if not np.isfinite(knots).all() or np.abs(knots).max() > 1e6:
        raise DataError(f"the curve of {name[:60]!r} contains a time or value that is not a number")
    if (np.diff(knots[:, 0]) <= 0.0).any():
        at = int(np.argmax(np.diff(knots[:, 0]) <= 0.0)) + 1
        raise DataError(
            f"the times of the curve of {name[:60]!r} do not ascend: {knots[at, 0]:g} s follows "
            f"{knots[at - 1, 0]:g} s at knot {at + 1}"
        )
    return knots


def curves_from(message: Mapping[str, Any], muscles: Sequence[str]) -> Curves:
    """Curves of a message of a page; DataError names what is not valid."""
    knots = message.get("knots")
    if not isinstance(knots, Mapping):
        raise DataError("the message contains no knots by muscle")
    curves = Curves(knots, message.get("duration", 0.0), message.get("interpolation", "linear"))
    curves.activation(muscles)
    return curves


def read_curves(path: Path) -> Curves:
    """Read curves of a table (``.csv``), an activation (``.nc``) or probe files (a folder).

    A table has the columns ``muscle``, ``time`` [s] and ``value`` [1], or ``time`` and one column for
    each muscle. In a folder, each file ``MUSCLE.txt`` has a line with start, stop [ns] and scale, a
    line with the interpolation, the number of values and ``explicit``, and rows of time and value.

    Raises
    ------
    DataError
        The file is absent or has another content.
    """
    try:
        if path.is_dir():
            return _read_probes(path)
        if path.suffix.lower() == ".nc":
            from emgface.schema.netcdf import read_netcdf

            return curves_of(read_netcdf(path, "activation"))
        return curves_in(read_text(path), str(path))
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path} contains no curves ({error})") from error


def curves_in(text: str, name: str) -> Curves:
    """Curves of the text of a table (`read_curves`); `name` is used in messages."""
    try:
        table = pd.read_csv(labelled(io.StringIO(text)))
    except (ValueError, pd.errors.ParserError) as error:
        why = str(error).splitlines()[0][:200]
        raise DataError(f"{name} contains no table of curves ({why})") from error
    if "time" not in table:
        raise DataError(
            f"{name} has the columns {', '.join(map(str, table.columns))[:200]}, expected time [s] and "
            "either muscle and value, or one column for each muscle"
        )
    try:
        time = table["time"].to_numpy(dtype=np.float64)
    except ValueError as error:
        raise DataError(f"{name} contains a time that is not a number ({error})") from error
    last = float(time.max(initial=0.0))
    if {"muscle", "value"} <= set(table.columns):
        if table["muscle"].isna().any():
            row = int(table["muscle"].isna().to_numpy().argmax())
            raise DataError(
                f"{name} names no muscle in row {row + 2}, expected a name such as ZYG_L"
            )
        for column in {"duration", "interpolation"} & set(table.columns):
            if len(values := table[column].unique()) > 1:
                raise DataError(
                    f"{name} has several values of {column} ({values[0]} and {values[1]}), expected one "
                    "for all curves"
                )
        named = {
            str(k): g[["time", "value"]].to_numpy() for k, g in table.groupby("muscle", sort=False)
        }
        first = table.iloc[0] if len(table) else {}
        duration = first.get("duration", last)
        numeric = isinstance(duration, float | int | np.number)
        return Curves(
            named, float(duration) if numeric else 0.0, first.get("interpolation", "linear")
        )
    columns = {str(k): np.column_stack([time, c]) for k, c in table.items() if k != "time"}
    return Curves(columns, last)


def curves_of(activation: xr.Dataset) -> Curves:
    """Curves of an activation (muscle, time) [1], with a knot at each of its samples."""
    values = activation["activation"].transpose("muscle", "time")
    time = values["time"].values - values["time"].values[0]
    rows = {
        str(m): np.column_stack([time, v])
        for m, v in zip(values["muscle"].values, values.values, strict=True)
    }
    return Curves(rows, float(time[-1]))


def _read_probes(folder: Path) -> Curves:
    knots, last, kinds = dict[str, Any](), 0.0, set[str]()
    for path in sorted(folder.glob(f"*{PROBE}")):
        try:
            lines = [line.split() for line in read_text(path).splitlines()]
            head, (kind, count, spacing), *rows = [words for words in lines if words]
            if count != "1" or kind not in ("Linear", "Cubic", "Step"):
                raise ValueError(f"interpolation {kind} of {count} values")
            if not rows:
                raise ValueError("no rows of time and value")
            curve = np.array(rows, dtype=np.float64)
            if spacing != "explicit":
                curve = np.column_stack([float(spacing) * np.arange(len(curve)), curve])
            start, stop = int(head[0]) / NANOSECONDS, int(head[1]) / NANOSECONDS
            curve[:, 0] = start + float(head[2]) * curve[:, 0]
        except (ValueError, IndexError, OverflowError) as error:
            raise DataError(
                f"{path} is not a probe file ({str(error)[:200]}), expected a line with start, stop and "
                "scale, one with Linear, Cubic or Step, 1 and explicit, then rows of time and value"
            ) from error
        knots[path.stem] = curve
        last = max(last, stop, float(curve[-1, 0]))
        kinds.add(kind.lower())
    if not knots:
        raise DataError(f"{folder} contains no probe files such as ZYG_L{PROBE}")
    if len(kinds) > 1:
        raise DataError(f"{folder} mixes the interpolations {', '.join(sorted(kinds))}")
    return Curves(knots, last, kinds.pop())  # pyright: ignore[reportArgumentType]


def write_curves(curves: Curves, path: Path) -> Path:
    """Write curves as a table (``.csv``) that `read_curves` reads without loss."""
    rows = [
        (name, repr(float(t)), repr(float(v)), curves.interpolation, repr(float(curves.duration)))
        for name, knots in curves.knots.items()
        for t, v in knots
    ]
    table = pd.DataFrame(rows, columns=["muscle", "time", "value", "interpolation", "duration"])
    write_text(path, table.to_csv(index=False))
    return path
