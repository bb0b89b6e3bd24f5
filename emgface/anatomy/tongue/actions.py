"""Actions of the muscles of a tongue: each alone, raised and released, and its effect on the shape."""

from collections.abc import Callable

import numpy as np
import pandas as pd
import xarray as xr

import sim
from emgface.anatomy.jaw.series import Excitation, ramps
from emgface.anatomy.tongue.parameters import TongueParameters
from emgface.anatomy.tongue.run import TONGUE_STEP, simulate_tongue
from emgface.errors import TongueError
from emgface.face.parts import Floats

ACTION_LEVEL, ACTION_DURATION = 0.3, 1.0
"""Largest excitation, and time in which it rises and falls [s] (published test of the tongue)."""
FORWARD, UP_AXIS = 1, 2


def muscle_exciters(tongue: xr.Dataset) -> list[str]:
    """Exciters of both sides of every muscle."""
    names = dict.fromkeys(str(m).partition("_")[0] for m in tongue["muscle"].values)
    known = tongue["exciter"].values
    return [f"bi_{name}" if f"bi_{name}" in known else name for name in names]


def raised_muscles(
    *exciters: str, level: float = ACTION_LEVEL, duration: float = ACTION_DURATION
) -> Excitation:
    """Excitations that rise linearly from 0 to a level and fall back within a duration [s]."""
    twice = sorted({name for name in exciters if exciters.count(name) > 1})
    if twice:
        raise TongueError(f"exciter {twice[0]} is given twice, expected every exciter once")
    corners = [(0.0, 0.0), (0.5 * duration, level), (duration, 0.0)]
    return ramps(dict.fromkeys(exciters, corners))


def size_along(motion: xr.Dataset, axis: int) -> Floats:
    """Extent (time,) of the tongue along an axis [m]."""
    x = motion["node_position"].isel(axis=axis).transpose("node", "time").values
    return np.asarray(x.max(axis=0) - x.min(axis=0))


def action(motion: xr.Dataset) -> dict[str, float]:
    """Displacement of tip and back, and change of size, at the largest excitation; volume and inversion.

    ``*_forward`` and ``*_up`` are displacements, ``longer`` and ``wider`` changes of the extents along
    y and x [mm]; ``volume_percent`` is the largest change of the volume over time, ``smallest_J`` the
    smallest det F, and ``left_mm`` the displacement of the tip at the end.
    """
    k = int(motion["activation"].sum("muscle").argmax("time"))
    x = motion["position"].transpose("time", "marker", "axis")
    d = 1e3 * (x - x.isel(time=0))
    measures = dict[str, float]()
    for name in ("tip", "back"):
        at = d.sel(marker=name).values
        measures |= {f"{name}_forward": at[k, FORWARD], f"{name}_up": at[k, UP_AXIS]}
    for name, axis in (("longer", FORWARD), ("wider", 0)):
        size = size_along(motion, axis)
        measures[name] = float(1e3 * (size[k] - size[0]))
    volume = motion["volume"].values
    measures["volume_percent"] = float(100.0 * np.abs(volume / volume[0] - 1.0).max())
    measures["smallest_J"] = float(motion["smallest_J"].min())
    measures["left_mm"] = float(np.linalg.norm(d.sel(marker="tip").values[-1]))
    return measures


def action_table(
    tongue: xr.Dataset,
    parameters: TongueParameters | None = None,
    *,
    level: float = ACTION_LEVEL,
    step: float = TONGUE_STEP,
    check: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> pd.DataFrame:
    """Action of every muscle of both sides, without gravity (`action`).

    ``error_mm`` is the estimated error of the time steps, for which every motion is repeated with
    other steps; without `check` it is not a number. A muscle whose simulation fails has the
    reason in the column ``fails``.
    """
    p = (parameters or TongueParameters()).model_copy(update={"gravity": False})
    names, rows = muscle_exciters(tongue), list[dict[str, object]]()
    for k, name in enumerate(names):
        row: dict[str, object] = {"muscle": name.removeprefix("bi_")}
        try:
            motion = simulate_tongue(
                tongue,
                raised_muscles(name, level=level),
                duration=ACTION_DURATION,
                parameters=p,
                step=step,
                check=check,
            )
            row |= {key: round(value, 4) for key, value in action(motion).items()}
            row["error_mm"] = round(1e3 * motion.attrs.get("numerical_error", np.nan), 4)
        except sim.SimulationError as error:
            row["fails"] = str(error)
        rows.append(row)
        if progress is not None:
            progress(k + 1, len(names))
    return pd.DataFrame(rows)
