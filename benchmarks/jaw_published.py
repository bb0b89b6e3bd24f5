"""Published jaw model: the checks of its specification.

Part of ``python -m benchmarks jaw``; it needs the published model. The stored force of the slow pull
on the incisor rises to 5.25 N in 4.6 s and falls to zero at 10 s. At the same force the jaw is higher
while it rises, so that a stored place belongs to one branch of the ramp, and not to an equilibrium.
"""

import os
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import sim
from benchmarks.bodies_accuracy import moving, run
from benchmarks.jaw_verdicts import basis_of, met_of
from emgface.anatomy.jaw.model import Floats
from emgface.anatomy.jaw.outcomes import interincisal, point_displacement, separation
from emgface.anatomy.jaw.picture import moved_points
from emgface.anatomy.jaw.published import import_jaw
from emgface.anatomy.jaw.run import run_task
from emgface.anatomy.jaw.series import Excitation, read_probes
from emgface.anatomy.jaw.tasks import JAW_TASKS, JawTask
from sim.kinematics import rotations

SHARED = Path(os.environ.get("EMGFACE_SHARED", "../shared"))


PROBES = SHARED / "artisynth_models" / "jaw_larynx" / "probes" / "leftchew"


def published(variant: str, **options: Any) -> xr.Dataset:
    """The published model."""
    return import_jaw(SHARED / "artisynth_models" / "jaw_larynx", variant=variant, **options)  # pyright: ignore[reportArgumentType]


def two_sided(jaw: xr.Dataset) -> xr.Dataset:
    """The model whose condyles cannot leave their path."""
    constrained = jaw.copy(deep=True)
    own = [str(name).startswith("tmj") for name in jaw["joint"].values]
    constrained["joint_one_sided"][:] = np.where(own, 0, constrained["joint_one_sided"])
    return constrained


def models() -> dict[str, xr.Dataset]:
    """Variants of condylar path and hyoid."""
    variants = {
        f"{condyle}, hyoid {hyoid}": published(variant, condyle=condyle)
        for condyle in ("planar", "curved")
        for hyoid, variant in (("fixed", "fixed"), ("free", "larynx"))
    }
    return variants | {"curved two-sided, hyoid free": two_sided(variants["curved, hyoid free"])}


def outcomes(jaw: xr.Dataset) -> dict[str, float | str]:
    """Openings and chewing cycle [mm]; the name of the error of a task that did not finish."""
    results = dict[str, float | str]()

    def measure(
        task: JawTask, read: Callable[[xr.Dataset], dict[str, float]], **options: Any
    ) -> None:
        try:
            values = read(run_task(jaw, task, **options, check=False))
            results.update({name: round(float(x), 3) for name, x in values.items()})
        except sim.SimulationError as error:
            results.update(dict.fromkeys(read(_nothing(jaw)), type(error).__name__))

    for name, task in (("open", "open"), ("open, head 15 degrees back", "open_head")):
        measure(JAW_TASKS[task], lambda m, name=name: {name: separation(m).max()}, duration=2.0)
    measure(JAW_TASKS["chew"], chewed, excitation=read_probes(PROBES), duration=0.7)
    return results


def chewed(motion: xr.Dataset) -> dict[str, float]:
    """Incisor at the largest opening, largest lateral displacement, and hyoid [mm]."""
    d = point_displacement(motion, "lower_incisor")
    k = int(np.argmin(d[:, 2]))
    measures = {"down": -d[k, 2], "back": -d[k, 1], "lateral": abs(d[k, 0])}
    measures |= {"time s": float(motion["time"][k]), "largest lateral": np.abs(d[:, 0]).max()}
    hyoid = point_displacement(motion, "hyoid")[: k + 1]
    measures |= {"hyoid up": hyoid[:, 2].max(), "hyoid forward": hyoid[:, 1].max()}
    return {f"chew, {name}": x for name, x in measures.items()}


def _nothing(jaw: xr.Dataset) -> xr.Dataset:
    """A motion of two instants, whose outcomes have the names of those of a task."""
    return run_task(jaw, JawTask("", 5e-3, {"bi_close": [(0.0, 4e-4)]}), step=5e-3, check=False)


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
    task = JawTask("", float(time[-1]))
    model = with_pull(jaw, float(force.max()))
    motion = run_task(model, task, excitation=drive, output=every, check=False)
    return point_displacement(motion, "lower_incisor")


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
    differences = dict[str, float]()
    ours, known = on_branches(moved), on_branches(stored)
    for axis, way, sign in ((2, "up", 1.0), (1, "back", -1.0)):
        for branch in ours:
            miss = sign * (ours[branch] - known[branch])[:, axis]
            differences[f"{way}, {branch}"] = round(float(miss[np.argmax(np.abs(miss))]), 2)
    apart = np.linalg.norm(moved - stored, axis=1)[time > FALLEN]
    return differences | {"rms over the ramp": round(float(np.sqrt((apart**2).mean())), 2)}


LEVELS = (0.0, 2e-4, 3e-4, 4e-4, 6e-4, 8e-4, 1e-3, 2e-3)
G = 9.8  # of the published program [m/s2]


def checks() -> pd.DataFrame:
    """Values of the seven checks in every variant; lengths in mm."""
    of_all = models()
    rows = [*free_body(of_all["planar, hyoid fixed"])]
    columns = {name: in_variant(jaw, name) for name, jaw in of_all.items()}
    columns["curved, hyoid free, parameters of stored forces"] = chewing_with_stored_parameters()
    names = dict.fromkeys(key for own in columns.values() for key in own)
    rows += [
        {"check": key, "required": WANTED.get(key, "")}
        | {name: own.get(key, "") for name, own in columns.items()}
        for key in names
    ]
    rows.sort(
        key=lambda row: row["check"].partition(" ")[0]
    )  # stable: the order within a check stays
    table = pd.DataFrame(rows, columns=["check", "required", *columns]).fillna("")
    wanted = [*zip(table["check"], table["required"], strict=True)]
    values = table[[*columns]].to_dict("records")
    table["met"] = [
        met_of(required, {str(k): str(v) for k, v in own.items()})
        for (_, required), own in zip(wanted, values, strict=True)
    ]
    table["basis"] = [basis_of(check, required) for check, required in wanted]
    return table


WANTED = {
    "1 energy over 1 s, relative": "1e-8",
    "1 angular momentum over 1 s, relative": "1e-8",
    "1 order of RK4 with rotation": "4",
    "2 condyles, distance from their plane in 10 s, mm": "1e-6",
    "2 residual forces at rest, N": "1e-9",
    **{
        f"3 pull, error {way}, {branch}": "2 planar fixed, 1 curved free"
        for way in ("up", "back")
        for branch in ("rising", "falling")
    },
    "3 pull, error rms over the ramp": "",
    "4 separation decreases with closing activity": "yes",
    "4 activity for 3 to 5 mm, %": "at least one of 0.03 to 0.10",
    "4 rest at 0.04 %, from contact": "reported only",
    "4 rest at 0.04 %, down": "reported only",
    "4 rest at 0.04 %, between edges": "reported only",
    "5 chew, down": "20.1 +- 10 %",
    "5 chew, back": "5.8 +- 10 %",
    "5 chew, lateral": "2.3 +- 10 %",
    "5 chew, largest lateral": "6.1 +- 10 %",
    "5 chew, time s": "0.334 +- 0.02",
    "5 chew, hyoid up": "3.4 +- 30 %",
    "5 chew, hyoid forward": "1.6 +- 30 %",
    "5 distance of the teeth, 0.56 to 0.70 s": "closed",
    "5 right and mirrored left chew": "1e-6",
    "5 right and mirrored left chew, symmetric bodies": "1e-6",
    "6 open": "35 to 38",
    "6 open, head 15 degrees back": "50 to 51",
    "7 thyroid up": "not published",
    "7 thyroid forward": "not published",
    "7 thyroid, distance from rest at the end": "0",
}


def free_body(jaw: xr.Dataset) -> list[dict[str, Any]]:
    """Torque-free rotation of the mandible for one second, steps of 1 ms (check 1)."""
    inertia = jaw["body_inertia"].sel(body="jaw").values
    system = sim.compile_scene(
        sim.Scene(sim.NO_TISSUE, (), bodies=(sim.Body("jaw", 0.2, inertia),))
    )
    start = moving(system, 0.0, 0.0, 0.0, 3.0, 5.0, 4.0)

    def momentum(state: sim.State) -> tuple[Floats, float]:
        Q = rotations.matrices(state.frames[:, 3:])[0]
        L = Q @ (inertia @ (Q.T @ state.twists[0, 3:]))
        return L, float(state.twists[0, 3:] @ L)

    ends = [run(system, start, 1.0, n, sim.RungeKutta4()) for n in (250, 500, 1000)]
    (L0, E0), (L1, E1) = momentum(start), momentum(ends[-1])
    apart = [np.abs(a.frames - b.frames).max() for a, b in pairwise(ends)]
    results = {
        "1 energy over 1 s, relative": abs(E1 / E0 - 1.0),
        "1 angular momentum over 1 s, relative": np.abs(L1 - L0).max() / np.abs(L0).max(),
        "1 order of RK4 with rotation": np.log2(apart[0] / apart[1]),
    }
    return [
        {"check": key, "required": WANTED[key], "planar, hyoid fixed": f"{value:.3g}"}
        for key, value in results.items()
    ]


def in_variant(jaw: xr.Dataset, name: str) -> dict[str, Any]:
    """Checks 2 to 7 of one variant."""
    results = at_rest(jaw, planar=name.startswith("planar"), free="free" in name)
    stored = outcomes(jaw)
    results |= {f"3 pull, error {key}": value for key, value in misses(ramp(jaw)).items()}
    results |= closing(jaw)
    results |= {f"5 {key}": value for key, value in stored.items() if key.startswith("chew")}
    results |= after_chewing(jaw)
    results["6 open"] = stored["open"]
    results["6 open, head 15 degrees back"] = stored["open, head 15 degrees back"]
    results |= swallowing(jaw)
    return results


def at_rest(jaw: xr.Dataset, *, planar: bool, free: bool) -> dict[str, Any]:
    """Drift of the condyles in 10 s, and the force that remains on the jaw at rest (check 2)."""
    task = JawTask("", 10.0, {"bi_close": [(0.0, 4e-4)]})
    motion = run_task(jaw, task, output=0.05, check=False)
    results = dict[str, Any]()
    if planar:
        off = 0.0
        for side in "LR":
            joint = jaw.sel(joint=f"tmj_{side}")
            x = motion["position"].sel(marker=f"condyle_{side}").transpose("time", "axis").values
            apart = (x - joint["joint_origin"].values) @ joint["joint_normal"].values
            off = max(off, float(np.abs(apart).max()))
        results["2 condyles, distance from their plane in 10 s, mm"] = f"{1e3 * off:.1g}"
    if not free:
        last = motion.isel(time=[0, -1])
        ends, bodies = last["muscle_position"].values, last["muscle_body"].values
        a, b = (moved_points(last, ends[:, k], bodies[:, k])[-1] for k in (0, 1))
        along = (b - a) / np.linalg.norm(b - a, axis=1)[:, None]
        own = [str(n) for n in motion["body"].values].index("jaw")
        tension = motion["muscle_force"].isel(time=-1).values[:, None] * along
        pull = sum(s * tension[bodies[:, k] == own].sum(axis=0) for k, s in ((0, 1.0), (1, -1.0)))
        joints = motion["joint_force"].isel(time=-1).transpose("joint", "axis").values
        mass = float(jaw["body_mass"].sel(body="jaw"))
        rest = pull + np.nansum(joints, axis=0) - np.array([0.0, 0.0, mass * G])
        results["2 residual forces at rest, N"] = f"{np.linalg.norm(rest):.1g}"
    return results


def closing(jaw: xr.Dataset) -> dict[str, Any]:
    """Separation at rest over the activity of the closers (check 4)."""
    gaps = list[tuple[float, float, float]]()
    for level in LEVELS:
        motion = run_task(jaw, JawTask("", 3.0, {"bi_close": [(0.0, level)]}), check=False)
        down = -float(point_displacement(motion, "lower_incisor")[-1, 2])
        gaps.append((separation(motion)[-1], interincisal(motion)[-1], down))
    apart = np.array(gaps)
    k = LEVELS.index(4e-4)
    fits = [100.0 * u for u, (gap, _, _) in zip(LEVELS, gaps, strict=True) if 3.0 <= gap <= 5.0]
    return {
        "4 separation decreases with closing activity": "yes"
        if (np.diff(apart[:, 0]) < 1e-6).all()
        else "no",
        "4 activity for 3 to 5 mm, %": ", ".join(f"{u:.2g}" for u in fits) or "none",
        "4 rest at 0.04 %, from contact": round(apart[k, 0], 2),
        "4 rest at 0.04 %, down": round(apart[k, 2], 2),
        "4 rest at 0.04 %, between edges": round(apart[k, 1], 2),
    }


def after_chewing(jaw: xr.Dataset) -> dict[str, Any]:
    """Closed teeth after the chewing stroke, and the mirror image of the chew (check 5)."""
    task = replace(JAW_TASKS["chew"], duration=0.7)
    left = run_task(jaw, task, excitation=read_probes(PROBES), check=False)
    late = left["time"].values >= 0.56 - 1e-9
    return {
        "5 distance of the teeth, 0.56 to 0.70 s": round(float(separation(left)[late].max()), 2),
        "5 right and mirrored left chew": f"{mirror_error(jaw, 0.7):.1g}",
        "5 right and mirrored left chew, symmetric bodies": f"{mirror_error(symmetric(jaw), 0.7):.1g}",
    }


def mirror_error(jaw: xr.Dataset, duration: float, **options: Any) -> float:
    """Largest distance of the incisor in a right chew from the mirror image of the left one [mm]."""
    series = read_probes(PROBES)
    names = {n: n[:-1] + {"L": "R", "R": "L"}[n[-1]] for n in series.values}
    other = Excitation(series.time, {names[n]: u for n, u in series.values.items()})
    a, b = (
        point_displacement(
            run_task(
                jaw, JawTask("", duration, morsel=side), excitation=own, check=False, **options
            ),
            "lower_incisor",
        )
        for side, own in (("L", series), ("R", other))
    )
    return float(np.abs(a * [-1.0, 1.0, 1.0] - b).max())


def symmetric(jaw: xr.Dataset) -> xr.Dataset:
    """The model with bodies that are their own mirror images.

    The surface of the imported hyoid is not quite symmetric: at uniform density its centre lies 1.4 um
    off the midline, that of the mandible 0.7 nm.
    """
    jaw = jaw.copy(deep=True)
    jaw["body_centre"] = jaw["body_centre"] * [0.0, 1.0, 1.0]
    signs = np.array([-1.0, 1.0, 1.0])
    jaw["body_inertia"] = jaw["body_inertia"] * (np.outer(signs, signs) > 0.0)
    return jaw


def swallowing(jaw: xr.Dataset) -> dict[str, Any]:
    """Thyroid in a swallow, and at its end relative to the same time without it (check 7)."""
    task, times = JAW_TASKS["swallow"], {"duration": 3.0, "check": False}
    motion = run_task(jaw, task, **times)
    if "thyroid" not in motion["marker"].values:
        return {}
    without = {n: c for n, c in task.excitation.items() if n != "bi_suprahyoid"}
    still = run_task(jaw, replace(task, excitation=without), **times)
    d = point_displacement(motion, "thyroid")
    left = d[-1] - point_displacement(still, "thyroid")[-1]
    return {
        "7 thyroid up": round(d[:, 2].max(), 2),
        "7 thyroid forward": round(d[:, 1].max(), 2),
        "7 thyroid, distance from rest at the end": f"{np.linalg.norm(left):.1g}",
    }


TONE, MORSEL = 1e-3, 30.0
"""Excitation of the closers, and force of the morsel [N], of the stored forces of a chewing cycle."""
STORED_FORCES = {"ip_": 0.74, "sp_": 0.58}
"""Active forces of the lateral pterygoids in the stored forces, over those of the law."""


def chewing_with_stored_parameters() -> dict[str, Any]:
    """Chewing with the parameters that the stored forces state (check 5)."""
    series, jaw = read_probes(PROBES), published("larynx")
    for m, factor in STORED_FORCES.items():
        own = [str(n).startswith(m) for n in jaw["muscle"].values]
        jaw["muscle_force_max"][own] = factor * jaw["muscle_force_max"][own]
    jaw["body_damping"][:] = 1.5 * jaw["body_damping"]
    jaw["muscle_damping"][:] = 1.0
    tone = np.full(len(series.time), TONE)
    drive = Excitation(series.time, {**series.values, "bi_close": tone})
    motion = run_task(
        jaw, JawTask("", 0.7, morsel="L"), excitation=drive, resistance=MORSEL, check=False
    )
    late = motion["time"].values >= 0.56 - 1e-9
    apart = float(separation(motion)[late].max())
    results = {f"5 {key}": round(float(x), 3) for key, x in chewed(motion).items()}
    return results | {"5 distance of the teeth, 0.56 to 0.70 s": round(apart, 2)}
