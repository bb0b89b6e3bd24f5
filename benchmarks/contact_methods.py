"""Error of contact against run time, over method and step, in trials driven by EMG that close the lips.

    python -m benchmarks contact_methods OUT                          # 20 trials of a second
    python -m benchmarks contact_methods OUT --trials 3 --settings "study|sdirk2, 10 ms"
    python -m benchmarks contact_methods OUT --trials 0               # tables and figure of OUT alone

Activations are estimated from the EMG of simulated volunteers (`error_coverage`), of the instructions
that close the lips, in random order, on the generated face. Every trial is computed by each method and
step, and by two references: SDIRK2 in steps of 1.25 and 0.625 ms, iterated to 0.1 and 0.01 um, with a
tenth of the tolerance of contact. Errors are relative to the second reference, and their own distance is
the error of the first. Where it exceeds a tenth of the wanted 0.1 mm, the motion itself depends on the
steps, and errors of this size have no exact value; the tables count such trials separately. The motion
of the true activation, with contact, is what rho compares with. Times are processor times of the steps,
relative to those of the preset "study" of the same trial without contact. A trial is stored when it
ends; trials that OUT contains are not computed again.
"""

import time
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

import sim
from analysis.scores import correlation_3d
from benchmarks.error_coverage import emg_trials
from benchmarks.report import face_of, finish, say
from emgface.children import safe_children
from emgface.choices import configure
from emgface.face.accuracy import accuracy_settings
from emgface.face.control import control_of
from emgface.face.integration import integrator_of, steps_of
from emgface.face.motion import settle_face
from emgface.face.muscle_parameters import SIGMA_MAX
from emgface.face.penetration import Penetration
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.muscles import INSTRUCTIONS
from sim.system import System

Floats = NDArray[np.float64]

CLOSING: Final = ("A", "C", "E", "F")  #: instructions whose gesture closes the lips
OUTPUT, TRUE_STEPS = 0.01, (1.25e-3, 0.625e-3)  # s
TRUE_ITERATION: Final = (1e-7, 1e-8)  #: tolerances of the iteration of the references [m]
FINER: Final = 0.1  #: tolerance of contact of the references, relative to the default
WANTED: Final = 1e-4  #: error [m] that the presets are to reach
DEPTHS_EVERY: Final = 5  #: outputs between depths, which cost as much as a step
WARM: Final = 0.25  #: duration of a motion that loads the kernels of a method [s]
FREE: Final[dict[str, Any]] = {"contact": {"method": "none"}}
STEPS: Final = (0.01, 0.005, 0.0025)  # s
METHODS: Final = ("sdirk2", "converged", "linearly_implicit", "linearly_implicit_trapezoidal")
PRESETS: Final = ("draft", "study", "reference")


def settings() -> dict[str, dict[str, Any]]:
    """Parameters by the name of a setting: presets, and every method with fixed steps."""
    found = {name: accuracy_settings(name) for name in PRESETS}
    for method in METHODS:
        for step in STEPS:
            fixed = {"solver": method, "step": step, "error_tolerance": None}
            found[f"{method}, {1e3 * step:g} ms"] = accuracy_settings("study") | fixed
    loose = {"iteration_tolerance": 5e-5}
    found["sdirk2, 10 ms, to 50 um"] = found["sdirk2, 10 ms"] | loose
    found["converged, 10 ms, to 50 um"] = found["converged, 10 ms"] | loose
    return found


def closing_trials() -> Iterator[tuple[str, xr.DataArray, xr.DataArray]]:
    """Trials of `emg_trials` whose instruction closes the lips."""
    assert set(CLOSING) <= set(INSTRUCTIONS)
    return (trial for trial in emg_trials() if trial[0].split()[1] in CLOSING)


@dataclass(frozen=True, eq=False)
class Motion:
    """Positions of all nodes at the outputs, of the markers, and processor time of the steps."""

    nodes: Floats  #: (time, node, axis) [m]
    markers: xr.DataArray  #: (marker, axis, time) [m]
    seconds: float
    steps: int
    rejected: int


Job = tuple[str, xr.DataArray, xr.DataArray]


class Bench:
    """A settled face on which every trial of a process is computed."""

    one: "Bench"

    def __init__(self, face: Path | None, chosen: tuple[str, ...], duration: float) -> None:
        warnings.simplefilter("ignore")
        self.face, self.duration = face_of(face), duration
        self.settings = {name: settings()[name] for name in chosen}
        self.base: dict[str, Any] = {"sigma_max": SIGMA_MAX, "output": OUTPUT}
        self.penetration = Penetration(self.face)
        self.systems: dict[tuple[bool, bool], tuple[System, sim.State]] = {}
        self.warm: set[tuple[str, bool]] = set()
        Bench.one = self

    def system(self, p: SimulationParameters, exact: bool) -> tuple[System, sim.State]:
        """Compiled face with its state at rest; contact of a reference has a smaller tolerance."""
        key = (p.contact.method == "none", exact)
        if key not in self.systems:
            scene = compose_scene(self.face, p)
            terms = list(scene.terms)
            for i, term in enumerate(terms):
                if exact and isinstance(term, sim.ConstraintContact):
                    terms[i] = replace(term, tolerance=FINER * term.tolerance)
            system = sim.compile_scene(replace(scene, terms=tuple(terms)))
            rest = system.rest_state()
            q = np.ascontiguousarray(settle_face(self.face, p)["node_position"].values)
            self.systems[key] = system, sim.State(0.0, q, rest.v, rest.memory)
        return self.systems[key]

    def moved(self, drive: xr.DataArray, values: Mapping[str, Any], exact: bool = False) -> Motion:
        """Motion of the face by an activation (muscle, time), with kernels loaded before."""
        p = configure(SimulationParameters, self.base | dict(values))
        if (key := (p.solver, p.contact.method == "none")) not in self.warm:
            self.warm.add(key)
            self._moved(drive, p, False, WARM)
        return self._moved(drive, p, exact, self.duration)

    def _moved(
        self, drive: xr.DataArray, p: SimulationParameters, exact: bool, duration: float
    ) -> Motion:
        system, start = self.system(p, exact)
        control, lasts, _ = control_of(drive.sel(muscle=list(system.muscles)), system.muscles, p)
        names = tuple(str(name) for name in self.face["marker"].values)
        markers = sim.Markers(self.face["marker_node"].values.astype(np.int64), names)
        probes = (markers, sim.Positions(), sim.Iterations())
        work = sim.Workspace(system, p.linear_solver)
        before = time.process_time()
        trajectory, _ = sim.simulate(
            system,
            control,
            duration=min(lasts, duration) if duration else lasts,
            integrator=integrator_of(p),
            steps=steps_of(self.face, p),
            every=OUTPUT,
            probes=probes,
            initial=start,
            work=work,
        )
        seconds = time.process_time() - before
        counted = (int(trajectory[name].sum()) for name in ("steps", "rejected"))
        q = trajectory["node_position"].transpose("time", "node", "axis").values
        return Motion(q, trajectory["position"].transpose(..., "time"), seconds, *counted)

    def depth(self, motion: Motion) -> tuple[float, float]:
        """Largest depths of the lips in each other, and in teeth beyond that at rest [m]."""
        shown = motion.nodes[::DEPTHS_EVERY]
        lips, teeth = self.penetration.lips, self.penetration.teeth
        return max(map(lips, shown)), max(map(teeth, shown))

    def rows(self, job: Job) -> list[dict[str, object]]:
        """One row per setting of a trial, after those of both references and of no contact."""
        label, drive, truth = job
        how = zip(TRUE_STEPS, TRUE_ITERATION, strict=True)
        coarse, exact = (self.moved(drive, _true(*values), exact=True) for values in how)
        span = truth.sel(time=slice(float(drive["time"][0]), float(drive["time"][-1])))
        goal = self.moved(span, accuracy_settings("study"))
        free = self.moved(drive, FREE | accuracy_settings("study"))
        about = {"trial": label, "motion_mm": 1e3 * _apart(exact, None)}
        about["reference_mm"] = 1e3 * _apart(coarse, exact)
        about["passing_mm"] = 1e3 * max(map(self.penetration.lips, free.nodes[::DEPTHS_EVERY]))
        named = {
            f"sdirk2, {1e3 * s:g} ms (reference)": m
            for s, m in zip(TRUE_STEPS, (coarse, exact), strict=True)
        }
        named["study, without contact"] = free
        found = [self._row(about, name, m, exact, goal, free) for name, m in named.items()]
        for name, values in self.settings.items():
            started = time.process_time()
            try:
                motion = self.moved(drive, values)
            except sim.SimulationError as error:
                spent = time.process_time() - started
                told = f"{type(error).__name__}: {error}"
                found.append(about | {"setting": name, "status": told, "s": spent})
                continue
            found.append(self._row(about, name, motion, exact, goal, free))
        return found

    def _row(
        self,
        about: dict[str, Any],
        name: str,
        motion: Motion,
        exact: Motion,
        goal: Motion,
        free: Motion,
    ) -> dict[str, object]:
        lips, teeth = self.depth(motion)
        rho = [_rho(goal, m) for m in (motion, exact)]
        return about | {
            "setting": name,
            "status": "ok",
            "error_mm": 1e3 * _apart(motion, exact),
            "mean_error_mm": 1e3 * float(_distances(motion, exact).mean()),
            "change_of_rho": float(np.abs(rho[0] - rho[1]).max()),
            "lips_mm": 1e3 * lips,
            "teeth_mm": 1e3 * teeth,
            "steps": motion.steps,
            "rejected": motion.rejected,
            "s": motion.seconds,
            "time_over_free": motion.seconds / free.seconds,
        }


def _true(step: float, iterated: float) -> dict[str, Any]:
    return {
        "solver": "sdirk2",
        "step": step,
        "iteration_tolerance": iterated,
        "error_tolerance": None,
    }


def _distances(one: Motion, two: Motion | None) -> Floats:
    """Distances of the markers between two motions, or from their places at rest [m]."""
    other = one.markers.isel(time=0) if two is None else two.markers.values
    return np.sqrt(((one.markers - other) ** 2).sum("axis")).values


def _apart(one: Motion, two: Motion | None) -> float:
    return float(_distances(one, two).max())


def _rho(goal: Motion, motion: Motion) -> Floats:
    n = min(goal.markers.sizes["time"], motion.markers.sizes["time"])
    a, b = (m.markers.isel(time=slice(0, n)) for m in (goal, motion))
    return correlation_3d(a, b.assign_coords(time=a["time"])).values


def _of(job: Job) -> list[dict[str, object]]:
    say(job[0])
    return Bench.one.rows(job)


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """One row per setting, over all trials and over those whose references agree."""
    told: list[dict[str, object]] = []
    for name, of in rows.groupby("setting", sort=False):
        ok = of[of["status"] == "ok"]
        known = ok[ok["reference_mm"] <= 0.1e3 * WANTED]
        told.append(
            {
                "setting": name,
                "trials": len(of),
                "failed": len(of) - len(ok),
                "error mm": ok["error_mm"].median(),
                "90 %": ok["error_mm"].quantile(0.9),
                "worst": ok["error_mm"].max(),
                "within 0.1 mm": f"{(ok['error_mm'] <= 1e3 * WANTED).sum()} of {len(of)}",
                "same, references agree": f"{(known['error_mm'] <= 1e3 * WANTED).sum()} of {len(known)}",
                "change of rho": ok["change_of_rho"].median(),
                "worst change": ok["change_of_rho"].max(),
                "lips in lips mm": ok["lips_mm"].max(),
                "lips in teeth mm": ok["teeth_mm"].max(),
                "steps": ok["steps"].median(),
                "time over no contact": ok["time_over_free"].median(),
            }
        )
    return pd.DataFrame(told).round(4)


def main(
    out: Path,
    face: Path | None = None,
    setting: str = "",
    trials: int = 20,
    duration: float = 0.0,
    workers: int = 1,
) -> None:
    """Measure, store after every trial, print.

    `setting` limits the settings to those given, separated by `|`. `duration` [s] cuts the trials
    (0: whole). `trials` = 0 prints OUT again.
    """
    stored = out / "contact-methods-trials.csv"
    rows = pd.read_csv(stored).to_dict("records") if stored.exists() else []
    known = {str(row["trial"]) for row in rows}
    chosen = tuple(setting.split("|")) if setting else tuple(settings())
    jobs = [job for job in islice(closing_trials(), trials) if job[0] not in known]
    out.mkdir(parents=True, exist_ok=True)
    begin = (face, chosen, duration)
    if jobs:
        with safe_children(), get_context("spawn").Pool(workers, Bench, begin) as pool:
            for found in pool.imap(_of, jobs):
                rows += found
                pd.DataFrame(rows).to_csv(stored, index=False)
    table = pd.DataFrame(rows)
    finish("contact-methods", summary(table), out)
