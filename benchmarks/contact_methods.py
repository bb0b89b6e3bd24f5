"""Error of contact against run time, over method and step, in trials driven by EMG that close the lips.

    python -m benchmarks contact_methods OUT                          # 20 trials of a second
    python -m benchmarks contact_methods OUT --trials 3 --setting "study|sdirk2, 10 ms"
    python -m benchmarks contact_methods OUT --trials 0               # tables and figure of OUT alone
    python -m benchmarks contact_methods OUT --renewals 0             # normals of the start of a stage

Activations are estimated from the EMG of simulated volunteers (`error_coverage`), of the instructions
that close the lips, in random order, on the generated face. Every trial is computed by each method and
step, and by two references: SDIRK2 in steps of 2 and 1 ms, iterated to 0.1 and 0.01 um, with a tenth of
the tolerance of contact. Errors are relative to the second reference. The distance of both references is
their error, if they converge, or shows that the motion depends on the steps. The motion of the true
activation, with contact, is what rho compares with. Times are processor times of the steps, relative to
those of the preset "study" of the same trial without contact. Every motion is stored when it ends;
motions that OUT contains are not computed again.
"""

import time
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

import sim
from analysis.figures import save
from analysis.figures.style import COLOURS, blank, grid, styled
from analysis.scores import correlation_3d
from benchmarks.error_coverage import emg_trials
from benchmarks.report import face_of, finish, say, shrink
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

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

CLOSING: Final = ("A", "C", "E", "F")  #: instructions whose gesture closes the lips
OUTPUT, TRUE_STEPS = 0.01, (2e-3, 1e-3)  # s
TRUE_ITERATION: Final = (1e-7, 1e-8)  #: tolerances of the iteration of the references [m]
FINER: Final = 0.1  #: tolerance of contact of the references, relative to the default
WANTED: Final = 1e-4  #: error [m] that the presets are to reach
DEPTHS_EVERY: Final = 5  #: outputs between depths, which cost as much as a step
WARM: Final = 0.25  #: duration of a motion that loads the kernels of a method [s]
ALONE: Final = "study, without contact"
FREE: Final[dict[str, Any]] = {"contact": {"method": "none"}}
STEPS: Final = (0.01, 0.005, 0.0025)  # s
METHODS: Final = ("sdirk2", "converged", "linearly_implicit", "linearly_implicit_trapezoidal")
PRESETS: Final = ("draft", "study", "reference")


def settings() -> dict[str, dict[str, Any]]:
    """Parameters by the name of a setting: presets, and every method with fixed steps."""
    named = {name: accuracy_settings(name) for name in PRESETS}
    for method in METHODS:
        for step in STEPS:
            fixed = {"solver": method, "step": step, "error_tolerance": None}
            named[f"{method}, {1e3 * step:g} ms"] = accuracy_settings("study") | fixed
    return named


def closing_trials() -> Iterator[tuple[str, xr.DataArray, xr.DataArray]]:
    """Trials of `emg_trials` whose instruction closes the lips."""
    assert set(CLOSING) <= set(INSTRUCTIONS)
    return (trial for trial in emg_trials() if trial[0].split()[1] in CLOSING)


@dataclass(frozen=True, eq=False)
class Motion:
    """Positions of the markers at the outputs, depths, processor time and number of the steps."""

    markers: xr.DataArray  #: (marker, axis, time) [m]
    lips: float  #: largest depth of the lips in each other [m]
    teeth: float  #: the same of lips and cheeks in teeth, beyond that at rest [m]
    seconds: float
    steps: int

    def save(self, path: Path) -> None:
        """Store as a file."""
        about = {"lips": self.lips, "teeth": self.teeth, "seconds": self.seconds}
        whole = self.markers.rename("markers").to_dataset().drop_attrs()
        whole.assign_attrs(steps=self.steps, **about).to_netcdf(path)

    @classmethod
    def load(cls, path: Path) -> "Motion":
        """Read a stored one."""
        with xr.open_dataset(path) as whole:
            about = whole.attrs
            own = (float(about[name]) for name in ("lips", "teeth", "seconds"))
            markers = whole["markers"].load().assign_attrs(units="m")
            return cls(markers, *own, int(about["steps"]))


Job = tuple[str, xr.DataArray, xr.DataArray]


class Bench:
    """A settled face on which every trial of a process is computed."""

    def __init__(
        self, out: Path, face: Path | None, chosen: tuple[str, ...], duration: float, renewals: int
    ) -> None:
        warnings.simplefilter("ignore")
        self.out, self.renewals = out, renewals
        self.face, self.duration = face_of(face), duration
        self.settings = {name: settings()[name] for name in chosen}
        self.base: dict[str, Any] = {"sigma_max": SIGMA_MAX, "output": OUTPUT}
        self.penetration = Penetration(self.face)
        self.systems: dict[tuple[bool, bool], tuple[System, sim.State]] = {}
        self.warm: set[tuple[str, bool]] = set()

    def system(self, p: SimulationParameters, exact: bool) -> tuple[System, sim.State]:
        """Compiled face with its state at rest; contact of a reference has a smaller tolerance."""
        key = (p.contact.method == "none", exact)
        if key not in self.systems:
            scene = compose_scene(self.face, p)
            terms = list(scene.terms)
            for i, term in enumerate(terms):
                if isinstance(term, sim.ConstraintContact):
                    tolerance = (FINER if exact else 1.0) * term.tolerance
                    terms[i] = replace(term, tolerance=tolerance, renewals=self.renewals)
            system = sim.compile_scene(replace(scene, terms=tuple(terms)))
            rest = system.rest_state()
            q = np.ascontiguousarray(settle_face(self.face, p)["node_position"].values)
            self.systems[key] = system, sim.State(0.0, q, rest.v, rest.memory)
        return self.systems[key]

    def moved(
        self, name: str, drive: xr.DataArray, values: Mapping[str, Any], exact: bool = False
    ) -> Motion:
        """Motion of the face by an activation (muscle, time), stored under a name."""
        path = self.out / f"{name.replace(' ', '-').replace(',', '')}.nc"
        if path.exists():
            return Motion.load(path)
        p = configure(SimulationParameters, self.base | dict(values))
        if (key := (p.solver, p.contact.method == "none")) not in self.warm:  # loads the kernels
            self.warm.add(key)
            self._moved(drive, p, False, WARM)
        say(name)
        motion = self._moved(drive, p, exact, self.duration)
        motion.save(path)
        return motion

    def _moved(
        self, drive: xr.DataArray, p: SimulationParameters, exact: bool, duration: float
    ) -> Motion:
        system, start = self.system(p, exact)
        control, lasts, _ = control_of(drive.sel(muscle=list(system.muscles)), system.muscles, p)
        names = tuple(str(name) for name in self.face["marker"].values)
        markers = sim.Markers(self.face["marker_node"].values.astype(np.int64), names)
        work = sim.Workspace(system, p.linear_solver)
        before = time.process_time()
        trajectory, _ = sim.simulate(
            system,
            control,
            duration=min(lasts, duration) if duration else lasts,
            integrator=integrator_of(p),
            steps=steps_of(self.face, p),
            every=OUTPUT,
            probes=(markers, sim.Positions(), sim.Iterations()),
            initial=start,
            work=work,
        )
        seconds, steps = time.process_time() - before, int(trajectory["steps"].sum())
        q = trajectory["node_position"].transpose("time", "node", "axis").values[::DEPTHS_EVERY]
        lips, teeth = (
            max(map(depth, q)) for depth in (self.penetration.lips, self.penetration.teeth)
        )
        position = trajectory["position"].transpose(..., "time")
        return Motion(position, lips, teeth, seconds, steps)

    def rows(self, job: Job) -> list[dict[str, object]]:
        """One row per setting of a trial, after those of both references and of no contact."""
        label, drive, truth = job
        names = [f"sdirk2, {1e3 * step:g} ms (reference)" for step in TRUE_STEPS]
        how = zip(names, TRUE_STEPS, TRUE_ITERATION, strict=True)
        coarse, exact = (
            self.moved(f"{label} {name}", drive, _true(*values), exact=True)
            for name, *values in how
        )
        span = truth.sel(time=slice(float(drive["time"][0]), float(drive["time"][-1])))
        goal = self.moved(f"{label} goal", span, accuracy_settings("study"))
        free = self.moved(f"{label} {ALONE}", drive, FREE | accuracy_settings("study"))
        about = {"trial": label, "motion_mm": 1e3 * _apart(exact, None)}
        about["reference_mm"] = 1e3 * _apart(coarse, exact)
        about["passing_mm"] = 1e3 * free.lips
        named = dict(zip((*names, ALONE), (coarse, exact, free), strict=True))
        table = [self._row(about, name, m, exact, goal, free) for name, m in named.items()]
        for name, values in self.settings.items():
            try:
                motion = self.moved(f"{label} {name}", drive, values)
            except sim.SimulationError as error:
                status = f"{type(error).__name__}: {error}"
                table.append(about | {"setting": name, "status": status})
                continue
            table.append(self._row(about, name, motion, exact, goal, free))
        return table

    def _row(
        self,
        about: dict[str, Any],
        name: str,
        motion: Motion,
        exact: Motion,
        goal: Motion,
        free: Motion,
    ) -> dict[str, object]:
        rho = [_rho(goal, m) for m in (motion, exact)]
        return about | {
            "setting": name,
            "status": "ok",
            "error_mm": 1e3 * _apart(motion, exact),
            "mean_error_mm": 1e3 * float(_distances(motion, exact).mean()),
            "change_of_rho": float(np.abs(rho[0] - rho[1]).max()),
            "lips_mm": 1e3 * motion.lips,
            "teeth_mm": 1e3 * motion.teeth,
            "steps": motion.steps,
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


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """One row per setting, over all trials and over those whose references agree."""
    summaries: list[dict[str, object]] = []
    for name, group in rows.groupby("setting", sort=False):
        ok = group[group["status"] == "ok"]
        summaries.append(
            {
                "setting": name,
                "trials": len(group),
                "failed": len(group) - len(ok),
                "error mm": ok["error_mm"].median(),
                "90 %": ok["error_mm"].quantile(0.9),
                "worst": ok["error_mm"].max(),
                "within 0.1 mm": f"{(ok['error_mm'] <= 1e3 * WANTED).sum()} of {len(group)}",
                "change of rho": ok["change_of_rho"].median(),
                "worst change": ok["change_of_rho"].max(),
                "lips in lips mm": ok["lips_mm"].max(),
                "lips in teeth mm": ok["teeth_mm"].max(),
                "steps": ok["steps"].median(),
                "time over no contact": ok["time_over_free"].median(),
            }
        )
    return pd.DataFrame(summaries).round(4)


@styled
def error_figure(rows: pd.DataFrame) -> "Figure":
    """Draw the error of a marker against the run time: every trial, and medians with 90 % of trials."""
    ok = rows[(rows["status"] == "ok") & (rows["error_mm"] > 0.0) & (rows["setting"] != ALONE)]
    figure = blank(7.0, 4.4)
    panel = grid(figure, 1, 1)[0][0]
    for k, (method, own) in enumerate(ok.groupby(ok["setting"].map(_method), sort=False)):
        colour = COLOURS[k % len(COLOURS)]
        panel.plot(own["time_over_free"], own["error_mm"], ".", color=colour, alpha=0.3)
        groups = own.groupby("setting")[["time_over_free", "error_mm"]]
        middle = groups.median().sort_values("time_over_free")
        x, y = (middle[name].to_numpy() for name in ("time_over_free", "error_mm"))
        most = groups.quantile(0.9)["error_mm"].loc[middle.index].to_numpy()
        up = [np.zeros_like(y), np.maximum(most - y, 0.0)]
        panel.errorbar(x, y, yerr=up, fmt="o-", color=colour, capsize=3, label=method)
        for setting, a, b in zip(middle.index, x, y, strict=True):
            label = str(setting).removeprefix(f"{method}, ").removesuffix(" (reference)")
            panel.annotate(label, (a, b), textcoords="offset points", xytext=(4, 4), fontsize=7)
    panel.axhline(1e3 * WANTED, color="0.5", linewidth=0.8, linestyle="--")
    panel.axvline(3.0, color="0.5", linewidth=0.8, linestyle="--")
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_xlabel('processor time, relative to the preset "study" without contact')
    panel.set_ylabel("largest error of a marker, mm")
    panel.xaxis.set_major_formatter("{x:g}")
    panel.xaxis.set_minor_formatter("{x:g}")
    panel.legend(fontsize=8)
    figure.suptitle(f"Trials with contact (simulated, {ok['trial'].nunique()} trials)")
    return figure


def _method(setting: str) -> str:
    """Method of a setting; the presets are one."""
    return "presets" if setting in PRESETS else setting.split(",")[0]


def main(
    out: Path,
    face: Path | None = None,
    setting: str = "",
    trials: int = 20,
    duration: float = 0.0,
    renewals: int = 1,
) -> None:
    """Measure, store after every trial, print.

    `setting` limits the settings to those given, separated by `|`. `duration` [s] cuts the trials
    (0: whole). `renewals` are those of `sim.ConstraintContact`, also of the references. `trials` = 0
    prints OUT again.
    """
    stored = out / "contact-methods-trials.csv"
    rows = pd.read_csv(stored).to_dict("records") if stored.exists() else []
    known = {str(row["trial"]) for row in rows}
    chosen = tuple(setting.split("|")) if setting else tuple(settings())
    jobs = [job for job in islice(closing_trials(), trials) if job[0] not in known]
    out.mkdir(parents=True, exist_ok=True)
    bench = Bench(out, face, chosen, duration, renewals)
    for job in jobs:
        rows += bench.rows(job)
        pd.DataFrame(rows).to_csv(stored, index=False)
    table = pd.DataFrame(rows)
    finish("contact-methods", summary(table), out)
    shrink(save(error_figure(table), out / "contact-methods.png"))
