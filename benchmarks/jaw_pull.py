"""Published jaw model: slow pull on the lower incisor without activation, beside its stored result.

A part of ``python -m benchmarks jaw``; it needs the published model. The stored force rises to 5.25 N in
4.6 s and falls to zero at 10 s. At the same force the jaw is higher while it rises, so that a stored
place belongs to one branch of the ramp, and not to an equilibrium.
"""

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from benchmarks.jaw_variants import SHARED, models
from emgface.anatomy.jaw.outcomes import displacement
from emgface.anatomy.jaw.run import run_task
from emgface.anatomy.jaw.series import Excitation
from emgface.anatomy.jaw.tasks import Task

FOLDER = SHARED / "artisynth_models" / "jaw_larynx" / "stored_results" / "incisorForce"
FORCES = 1.14, 2.28, 3.42, 4.56
"""Downward forces of the table [N]."""
FAR = 9.0
"""Distance of the fixed end of the line that pulls [m]; its direction changes by 0.3 degrees."""
FALLEN = 0.3
"""Time of the first fall from closed teeth, which the comparison leaves out [s]."""


def stored_pull() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (n,) [s], downward force (n,) [N] and displacement (n, 3) of the incisor [mm]."""

    def rows(name: str) -> np.ndarray:
        lines = (FOLDER / name).read_text(encoding="utf-8").splitlines()[2:]
        return np.array([[float(x) for x in line.split()] for line in lines if line.strip()])

    force, moved = rows("incForce.raw"), rows("incDisp.raw")
    down = -1e-3 * force[:, 3]
    down[0] = 0.0  # the first row holds the direction
    return force[:, 0], down, moved[:, 1:] * [-1.0, -1.0, 1.0]


def with_pull(jaw: xr.Dataset, largest: float) -> xr.Dataset:
    """The model with a line of constant force along the vertical, the exciter ``pull``."""
    names, exciters = (jaw[d].values.tolist() for d in ("muscle", "exciter"))
    pulled = jaw.reindex(muscle=[*names, "pull"], exciter=[*exciters, "pull"], fill_value=0)
    bodies = jaw["body"].values.tolist()
    at = jaw["point_position"].sel(point="lower_incisor").values
    pulled["muscle_body"][-1] = [bodies.index("skull"), bodies.index("jaw")]
    pulled["muscle_position"][-1] = [at - [0.0, 0.0, FAR], at]
    pulled["exciter_gain"][-1, -1] = 1.0
    pulled["muscle_force_max"][-1] = largest
    pulled["muscle_stretch_max"][-1] = 1.5
    return pulled


def ramp(jaw: xr.Dataset, every: float = 1e-2) -> np.ndarray:
    """Displacement (n, 3) of the incisor under the stored force at the stored times [mm]."""
    time, force, _ = stored_pull()
    drive = Excitation(time, {"pull": force / force.max()})
    task = Task("", float(time[-1]))
    model = with_pull(jaw, float(force.max()))
    motion = run_task(model, task, excitation=drive, output=every, check=False)
    return displacement(motion, "lower_incisor")


def inclined(jaw: xr.Dataset, degrees: float, passive: float) -> xr.Dataset:
    """The model with condylar planes of another inclination and another passive fraction."""
    jaw, angle = jaw.copy(deep=True), np.radians(degrees)
    own = np.array([str(name).startswith("tmj") for name in jaw["joint"].values])
    jaw["joint_normal"][own] = [0.0, -np.sin(angle), -np.cos(angle)]
    jaw["muscle_passive_fraction"][:] = passive * jaw["muscle_passive_fraction"]
    return jaw


FITTED = {"34.9 degrees, passive x 1.1": (34.9, 1.1), "30 degrees, passive x 1.2": (30.0, 1.2)}
"""Planes and passive fractions that were chosen after the stored ramp; 34.9 degrees is the angle whose
slope is 40 degrees in radians, as the program takes it."""


def on_branches(moved: np.ndarray) -> dict[str, np.ndarray]:
    """Displacement (force, 3) at the forces of the table on both branches [mm]."""
    _, force, _ = stored_pull()
    top = int(np.argmax(force))
    parts = {"rising": slice(0, top + 1), "falling": slice(len(force) - 1, top - 1, -1)}
    return {
        name: np.column_stack([np.interp(FORCES, force[part], x) for x in moved[part].T])
        for name, part in parts.items()
    }


def misses(moved: np.ndarray) -> dict[str, float]:
    """Largest signed difference from the stored result on both branches, and its rms [mm]."""
    time, _, stored = stored_pull()
    found = dict[str, float]()
    ours, known = on_branches(moved), on_branches(stored)
    for axis, way, sign in ((2, "up", 1.0), (1, "back", -1.0)):
        for branch in ours:
            miss = sign * (ours[branch] - known[branch])[:, axis]
            found[f"{way}, {branch}"] = round(float(miss[np.argmax(np.abs(miss))]), 2)
    apart = np.linalg.norm(moved - stored, axis=1)[time > FALLEN]
    return found | {"rms over the ramp": round(float(np.sqrt((apart**2).mean())), 2)}


def pull() -> pd.DataFrame:
    """Incisor of every variant on both branches of the ramp beside the stored one [mm]."""
    _, _, stored = stored_pull()
    of_all = models()
    of_all |= {n: inclined(of_all["planar, hyoid fixed"], *own) for n, own in FITTED.items()}
    paths = {"stored": stored} | {name: ramp(jaw) for name, jaw in of_all.items()}
    places = {name: on_branches(moved) for name, moved in paths.items()}
    rows: list[dict[str, Any]] = [
        {"outcome": f"{force} N {branch}, {way}"}
        | {name: f"{sign * own[branch][k, axis]:.2f}" for name, own in places.items()}
        for k, force in enumerate(FORCES)
        for branch in ("rising", "falling")
        for axis, way, sign in ((2, "up", 1.0), (1, "back", -1.0))
    ]
    far = {name: misses(moved) for name, moved in paths.items()}
    rows += [
        {"outcome": f"miss {key}"} | {name: f"{own[key]:g}" for name, own in far.items()}
        for key in far["stored"]
    ]
    return pd.DataFrame(rows)
