"""Published jaw model: unstated parameters, and the outcomes of all tasks with them.

It needs the published model. The sources state no values of these parameters, or several. The bounds of
their uniform priors contain all stated values and those found in stored forces (docs/jaw_published.md).
"""

import csv
from pathlib import Path

import numpy as np
import xarray as xr

import sim
from benchmarks.jaw_variants import PROBES, chewed, published
from benchmarks.report import say
from emgface.anatomy.jaw.outcomes import displacement, separation
from emgface.anatomy.jaw.run import run_task
from emgface.anatomy.jaw.series import Excitation, read_probes
from emgface.anatomy.jaw.tasks import TASKS, Task
from emgface.errors import EmgfaceError, JawError

STEP = 2e-3
"""Time step [s]; a set whose matrix is indefinite with it is computed with a quarter of it."""
OPEN, RESTED = 0.8, 4.0
"""Durations of opening and rest [s]; in six random sets 2.5 s change openings by at most 0.008 mm."""

PRIOR = {
    "curved path": (0.0, 1.0),
    "passive fraction": (0.005, 0.03),
    "closers when opening": (0.0, 1.0),
    "tone %": (0.0, 0.2),
    "lateral pterygoids": (0.5, 1.0),
    "muscle damping N s/m": (0.0, 8.0),
    "body damping": (1.0, 3.0),
    "hyoid lower mm": (0.0, 8.0),
    "hyoid back mm": (0.0, 8.0),
    "depressors": (0.0, 0.5),
    "membranes, log": (0.0, 1.0),
    "centre forward mm": (-20.0, 20.0),
    "centre up mm": (-20.0, 20.0),
    "morsel N": (30.0, 35.0),
}
"""Bounds of uniform priors.

The condyles are on a plane below 0.5 of "curved path" (Stavness et al. 2006), else on a curve (Hannam
et al. 2008). Factors apply to the passive forces of closers in opening, whose reduction is not
quantified, to the force of the lateral pterygoids (stored forces: 0.56 to 0.76) and to the damping of
bodies. Membranes have 385.6 N/m as run at 0, and the 6000 N/m of the class at 1 of their logarithm.
The hyoid at rest, the activity of its depressors in opening and the centre of rotation of the head are
not stated. The morsel has 35 or 30 N.
"""

WANTED = {
    "rest": (3.0, 5.0),
    "open": (35.0, 38.0),
    "head back": (50.0, 51.0),
    "larynx down": (0.5, 1.5),
    "down": (18.1, 22.1),
    "back": (5.2, 6.4),
    "lateral": (2.07, 2.53),
    "largest lateral": (5.5, 6.7),
    "time s": (0.314, 0.354),
    "hyoid up": (2.4, 4.4),
    "hyoid forward": (1.1, 2.1),
}
"""Published outcomes [mm]; chewing with 10 %, the hyoid with 30 %, the time with 20 ms."""

Values = dict[str, float]


def changed(jaw: xr.Dataset, own: Values) -> xr.Dataset:
    """The model with the parameters of a set."""
    jaw = jaw.copy(deep=True)
    names = jaw["muscle"].values.astype(str)
    lateral = np.array([n[:3] in ("ip_", "sp_") for n in names])
    jaw["muscle_passive_fraction"][:] = own["passive fraction"]
    jaw["muscle_damping"][:] = own["muscle damping N s/m"]
    jaw["muscle_force_max"][lateral] = own["lateral pterygoids"] * jaw["muscle_force_max"][lateral]
    jaw["body_damping"][:] = own["body damping"] * jaw["body_damping"]
    membranes = np.array(["Mem" in str(n) for n in jaw["spring"].values])
    stiffer = (6000.0 / 385.6) ** own["membranes, log"]
    jaw["spring_stiffness"][membranes] = stiffer * jaw["spring_stiffness"][membranes]
    hyoid = [str(b) for b in jaw["body"].values].index("hyoid")
    moved = -1e-3 * np.array([0.0, own["hyoid back mm"], own["hyoid lower mm"]])
    on = (jaw["muscle_body"] == hyoid).values[..., None]
    jaw["muscle_position"][:] = np.where(on, jaw["muscle_position"] + moved, jaw["muscle_position"])
    centre = jaw["point_position"].sel(point="head_centre").values
    turned = [0.0, 1e-3 * own["centre forward mm"], 1e-3 * own["centre up mm"]]
    jaw["point_position"].loc[{"point": "head_centre"}] = centre + turned
    return jaw


def outcomes_of(jaw: xr.Dataset, own: Values, step: float = STEP) -> Values:
    """Outcomes of rest, opening and chewing with the parameters of a set [mm, s].

    Rest is an equilibrium, which depends on neither damping nor steps: it is computed with the damping
    of `jaw` and twice the step.
    """
    quick = {"muscle damping N s/m": 1.0, "body damping": 1.0}
    still = {"duration": RESTED, "step": 2.0 * step, "output": 0.1, "check": False}
    rest = run_task(changed(jaw, own | quick), TASKS["rest"], **still)
    found = {"rest": float(separation(rest)[-1])}
    jaw = changed(jaw, own)
    found |= openings_of(jaw, own, step)
    series = read_probes(PROBES)
    tone = np.full(len(series.time), 0.01 * own["tone %"])
    drive = Excitation(series.time, {**series.values, "bi_close": tone})
    options = {"resistance": own["morsel N"], "step": step, "output": STEP, "check": False}
    chew = run_task(jaw, Task("", 0.5, morsel="L"), excitation=drive, **options)
    found |= {name.removeprefix("chew, "): float(x) for name, x in chewed(chew).items()}
    return found | {"time s": _lowest(displacement(chew, "lower_incisor")[:, 2], chew["time"])}


def _lowest(z: np.ndarray, time: xr.DataArray) -> float:
    """Time of the smallest value [s], between outputs that of a parabola."""
    k = int(np.clip(np.argmin(z), 1, len(z) - 2))
    before, here, after = z[k - 1 : k + 2]
    curved = before - 2.0 * here + after
    between = float(np.clip(0.5 * (before - after) / curved, -1.0, 1.0)) if curved > 0.0 else 0.0
    return float(time[k]) + between * float(time[k + 1] - time[k])


def without_numbers(jaw: xr.Dataset, own: Values) -> Values:
    """Outcomes of closing, protrusion and swallowing, for which no numbers are published [mm]."""
    jaw = changed(jaw, own)
    options = {"step": 0.5 * STEP, "check": False}
    close = separation(run_task(jaw, TASKS["close"], **options))
    alone = Task("", 2.0, {"bi_ip": [(0.0, 0.0), (0.2, 1.0)]})
    forward = displacement(run_task(jaw, alone, **options), "lower_incisor")
    swallow = displacement(run_task(jaw, TASKS["swallow"], **options), "thyroid")
    return {
        "close, distance from contact at the end": float(close[-1]),
        "protrusion, forward": float(forward[:, 1].max()),
        "protrusion, forward in the last 0.2 s": float(np.ptp(forward[-40:, 1])),
        "protrusion, sideways": float(np.abs(forward[:, 0]).max()),
        "swallow, thyroid up": float(swallow[:, 2].max()),
        "swallow, thyroid forward": float(swallow[:, 1].max()),
        "swallow, thyroid away at the end": float(np.linalg.norm(swallow[-1])),
    }


def openings_of(jaw: xr.Dataset, own: Values, step: float = STEP, duration: float = OPEN) -> Values:
    """Openings with the head still and back, and lowering of the larynx, of a changed model [mm]."""
    found = dict[str, float]()
    weak = jaw.copy(deep=True)
    closers = [n[:3] in ("at_", "mt_", "pt_", "sm_", "dm_", "mp_") for n in jaw["muscle"].values]
    weak["muscle_passive_fraction"][closers] = own["passive fraction"] * own["closers when opening"]
    wide = dict(TASKS["open"].excitation) | {
        "bi_infrahyoid": [(0.0, 0.0), (0.2, own["depressors"])]
    }
    for name, head in (("open", 0.0), ("head back", 15.0)):
        task = Task("", duration, wide, head=head)
        motion = run_task(weak, task, step=step, output=0.02, check=False)
        found[name] = float(separation(motion).max())
        if not head:
            found["larynx down"] = -float(displacement(motion, "thyroid")[-1, 2])
    return found


def excess(found: Values) -> Values:
    """Distance of every outcome from its published range, in units of 10 % of its middle."""
    far = {n: max(low - found[n], found[n] - high, 0.0) for n, (low, high) in WANTED.items()}
    return {n: far[n] / (0.05 * sum(WANTED[n])) for n in WANTED}


class Sets:
    """Sets of parameters and their outcomes, kept in a table that a later run continues.

    A set without outcomes, because its motion could not be computed, has NaN.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._known = path, dict[tuple[str, ...], Values]()
        self._models = [published("larynx", condyle=c) for c in ("planar", "curved")]
        surfaces = [str(v) for v in self._models[0] if str(v).startswith("surface")]
        self._models = [jaw.drop_vars(surfaces) for jaw in self._models]
        if path.exists():
            with path.open(encoding="utf-8", newline="") as file:
                for row in csv.DictReader(file):
                    key = tuple(row[name] for name in PRIOR)
                    self._known[key] = {name: float(row[name]) for name in WANTED}

    def outcomes(self, own: Values) -> Values:
        """Outcomes of a set [mm, s]."""
        key = tuple(f"{own[name]:.12g}" for name in PRIOR)
        if key not in self._known:
            found = self._computed({n: float(x) for n, x in zip(PRIOR, key, strict=True)})
            self._known[key] = {n: float(f"{found[n]:.9g}") for n in WANTED}  # as in the table
            self._write(key)
        return self._known[key]

    def model(self, own: Values) -> xr.Dataset:
        """The published model with the condylar path of a set."""
        return self._models[int(own["curved path"] >= 0.5)]

    def _computed(self, own: Values) -> Values:
        jaw = self.model(own)
        try:
            try:
                return outcomes_of(jaw, own)
            except JawError:
                return outcomes_of(jaw, own, 0.25 * STEP)
        except (EmgfaceError, sim.SimulationError) as error:
            say(f"{own}: {error}")
            return dict.fromkeys(WANTED, np.nan)

    def _write(self, key: tuple[str, ...]) -> None:
        new = not self._path.exists()
        with self._path.open("a", encoding="utf-8", newline="") as file:
            table = csv.writer(file)
            if new:
                table.writerow([*PRIOR, *WANTED])
            table.writerow([*key, *(f"{self._known[key][name]:.9g}" for name in WANTED)])
