"""Motion of a jaw compared with a recorded one: aligned paths, scores, and those of baselines."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr

from analysis.errors import AnalysisError
from analysis.flags import FLAGS, flags_of
from analysis.scores import rmse
from analysis.tables import Column, Table
from emgface.anatomy.jaw.model import Floats
from emgface.anatomy.jaw.recorded import LARGEST_SHIFT, aligned, in_skull_of, score_motion
from emgface.anatomy.jaw.skull import rotated

_COLUMNS = (
    Column("motion"),
    Column("point"),
    Column("rho", "1", "1"),
    Column("amplitude ratio", "1", "1"),
    Column("rmse", "m", "mm", 1e3),
    Column("shift", "s", "ms", 1e3, 0),
)
ALIKE = 0.02
"""Difference of rho below which a baseline scores as high."""
_REVERSED, _STILL = "the same, backwards in time", "none (the point rests)"


@dataclass(frozen=True, eq=False)
class JawComparison:
    """A recording compared with a motion, with the scores of the motion and of baselines.

    ``path`` (marker, axis, time) [m] are recorded points at the times of the motion, relative to
    the skull, NaN where nothing was recorded.
    """

    path: xr.DataArray
    scores: Table

    def displacement(self, motion: xr.Dataset, marker: str) -> Floats:
        """Displacement (time, axis) of a recorded point since the start of the simulated one [mm]."""
        x = self.path.sel(marker=marker).transpose("time", "axis").values
        return np.asarray(1e3 * (x - in_skull_of(motion, marker)[0]), dtype=np.float64)

    def at(self, shown: xr.Dataset) -> Floats:
        """Recorded positions (time, marker, 3) at some instants of the motion, NaN without [m]."""
        chosen = self.path.reindex(marker=shown["marker"].values).sel(time=shown["time"].values)
        x = chosen.transpose("time", "marker", "axis").values
        if "skull" not in shown["body"].values:
            return x
        skull = shown.sel(body="skull")
        q = skull["body_quaternion"].transpose("time", "part").values[:, None]
        return rotated(q, x) + skull["body_position"].transpose("time", "axis").values[:, None]


def compare_with_recording(
    recording: xr.Dataset, motion: xr.Dataset, baselines: Mapping[str, xr.Dataset] | None = None
) -> JawComparison:
    """Align a recording with a motion as for the scores, and score it as `compared`.

    Every recorded point is shifted so that the means of both paths are equal, as in the rmse.
    """
    measured, model = aligned(recording, motion)
    measured = measured["position"].transpose("marker", "axis", "time")
    own = model["position"].transpose("marker", "axis", "time")
    placed = measured + (own - measured).mean("time")
    path = placed.reindex(time=motion["time"].values).assign_attrs(units="m")
    return JawComparison(path, compared_jaws(recording, motion, baselines))


def compared_jaws(
    recording: xr.Dataset, motion: xr.Dataset, baselines: Mapping[str, xr.Dataset] | None = None
) -> Table:
    """Scores of a motion, and of baselines that are aligned and scored in the same way.

    Two baselines need no further motion: the same motion backwards in time, which has its path,
    amplitude and frequencies, but not its course, and a point that rests. `baselines` are other
    motions of the same duration by name, such as that of exchanged channels; one that cannot be
    scored states the reason. Errors of the motion are those of
    `emgface.anatomy.jaw.recorded.score_motion`.
    """
    scores = score_motion(recording, motion)
    rows = _rows("simulated", scores)
    others = {_REVERSED: _backwards(motion)} | dict(baselines or {})
    for name, other in others.items():
        try:
            rows += _rows(name, score_motion(recording, other))
        except AnalysisError as error:
            rows.append((name, str(error), *[np.nan] * 4))
    measured, model = aligned(recording, motion)
    path, nothing = measured["position"], xr.zeros_like(model["position"])
    covered = np.isfinite(path.transpose("time", ...).values).all(axis=(1, 2))
    away = rmse(path.isel(time=covered), nothing.isel(time=covered))
    rows += [
        (_STILL, str(m), np.nan, 0.0, float(away.sel(marker=m)), np.nan)
        for m in away["marker"].values
    ]
    backwards = np.array([row[2] for row in rows if row[0] == _REVERSED], dtype=np.float64)
    origin = str(recording.attrs["origin"])
    return Table(
        f"Scores of the simulated motion, {origin} recording",
        _COLUMNS,
        tuple(rows),
        origin,
        " ".join(_notes(motion, scores, backwards)),
    )


def _backwards(motion: xr.Dataset) -> xr.Dataset:
    return motion.isel(time=slice(None, None, -1)).assign_coords(
        time=("time", motion["time"].values, motion["time"].attrs)
    )


def _rows(name: str, scores: xr.Dataset) -> list[tuple[object, ...]]:
    kinds, shift = ("rho", "amplitude_ratio", "rmse"), float(scores["shift"])
    return [
        (name, str(m), *(float(scores[kind].sel(marker=m)) for kind in kinds), shift)
        for m in scores["marker"].values
    ]


def _notes(motion: xr.Dataset, scores: xr.Dataset, backwards: Floats) -> list[str]:
    """State how both were paired, what the baseline shows, the numerical error, reasons and flags."""
    rho = scores["rho"].values
    driven = "recorded_start" in motion.attrs
    notes = [
        "The motion is compared with the recording at the times of the sEMG that drives it, shifted by "
        f"at most {LARGEST_SHIFT:g} s."
        if driven
        else "No recording drives the motion: the recording was stretched to its duration, and the "
        "scores state how similar the paths are."
    ]
    if (backwards > rho - ALIKE).any():
        notes.append(
            "The motion backwards in time has an equally high score: this recording does not "
            "distinguish the "
            "course of the motion."
        )
    error = motion.attrs.get("numerical_error")
    notes.append(
        "The error of the time steps was not estimated."
        if error is None
        else f"Estimated error of the time steps: {1e3 * error:.2g} mm."
    )
    notes += [
        f"{m}: rho is undefined, {reason}."
        for m in scores["marker"].values
        if (reason := str(scores["reason"].sel(marker=m).item()))
    ]
    return notes + [f"Flag {name}: {FLAGS[name]}." for name in flags_of(scores)]
