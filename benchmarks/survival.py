"""Largest sigma_max at which each solver succeeds on a face, for every muscle pair and all muscles.

    python -m benchmarks survival FACE.nc survival.csv [--step 0.01] [--duration 0.5]

The activation rises from 0 to 1 over 0.1 s and is held, from rest, without gravity and contact. A
run survives if every step ends with det F > 0 at every Gauss point; the value is found by bisection
on a grid, assuming that survival is monotone in sigma_max. Every attempt is appended to a CSV file
at once; attempts in the file are not repeated.
"""

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

import sim
from benchmarks.report import markdown
from emgface.face.contact_parameters import NO_CONTACT
from emgface.face.file import load_face
from emgface.face.recipe import compose_scene, named_elements
from emgface.face.simulation_parameters import SimulationParameters
from emgface.muscles import MODELLED

GRID_KPA = (25, 50, 75, 100, 125, 150, 200, 250, 300, 400, 500, 600, 800, 1000)
RISE = 0.1
HALVINGS = 4
SOLVERS = {
    "linearly implicit, current damping": (sim.LinearlyImplicitEuler, sim.Rayleigh),
    "linearly implicit, damping at rest": (sim.LinearlyImplicitEuler, sim.RestRayleigh),
    "converged, damping at rest": (sim.ConvergedEuler, sim.RestRayleigh),
}
COLUMNS = ("face", "step_s", "duration_s", "incompressibility", "muscle", "solver",
           "sigma_max_kPa", "survived", "failure", "failed_at_s", "smallest_J",
           "largest_marker_displacement_mm", "rejected_steps", "wall_s")  # fmt: skip


def attempt(face, muscle, solver, kilopascal, options):
    """One run as a row of the table."""
    integrator, damping = SOLVERS[solver]
    pointwise = options.incompressibility == "pointwise"
    parameters = SimulationParameters(
        sigma_max=1e3 * kilopascal,
        sigma_max_policy={"minimum": 1e3},
        gravity=False,
        contact=NO_CONTACT,
        incompressibility=options.incompressibility,
        bulk_potential="logarithmic" if pointwise else "quadratic",
    )
    step = options.step
    scene = replace(compose_scene(face, parameters), damping=damping())
    system = sim.compile_scene(scene)
    level = np.array([muscle in ("all", name[:-2]) for name in system.muscles], dtype=float)
    converged = integrator is sim.ConvergedEuler
    node = face["marker_node"].values.astype(np.int64)
    row = {"muscle": muscle, "solver": solver, "sigma_max_kPa": kilopascal}
    start = time.perf_counter()
    try:
        with named_elements(face):
            trajectory, state = sim.simulate(
                system,
                sim.Activation(np.array([0.0, RISE]), np.stack([0.0 * level, level])),
                duration=options.duration,
                integrator=integrator(),
                steps=sim.HalvingStep(step, HALVINGS) if converged else sim.FixedStep(step),
                probes=(sim.SmallestJ(), sim.Iterations()),
            )
    except sim.SimulationError as error:
        row |= {"survived": False, "failure": type(error).__name__}
        row["failed_at_s"] = round(getattr(error, "time", float("nan")), 6)
    else:
        moved = np.linalg.norm((state.q - system.scene.mesh.X)[node], axis=1).max()
        row |= {
            "survived": True,
            "smallest_J": f"{float(trajectory.smallest_J.min()):.4f}",
            "largest_marker_displacement_mm": f"{1e3 * moved:.3f}",
            "rejected_steps": int(trajectory.rejected.sum()),
        }
    row["wall_s"] = f"{time.perf_counter() - start:.1f}"
    return row


class Attempts:
    """The CSV file of all attempts on one face with the same options."""

    def __init__(self, face, options):
        self.path, self.face, self.options = options.out, face, options
        path = self.path
        self.fixed = {
            "face": str(face.attrs["name"]),
            "step_s": f"{options.step:g}",
            "duration_s": f"{options.duration:g}",
            "incompressibility": options.incompressibility,
        }
        self.known = {}
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            pd.DataFrame(columns=COLUMNS).to_csv(path, index=False)
        table = pd.read_csv(path, dtype=str)
        for row in table[
            (table[list(self.fixed)] == pd.Series(self.fixed)).all(axis=1)
        ].itertuples():
            key = row.muscle, row.solver, float(row.sigma_max_kPa)
            self.known[key] = row.survived == "True"

    def survives(self, muscle, solver, kilopascal):
        """Return the stored result of an attempt, or compute and store it."""
        key = muscle, solver, float(kilopascal)
        if key not in self.known:
            row = self.fixed | attempt(self.face, muscle, solver, kilopascal, self.options)
            line = pd.DataFrame([row], columns=COLUMNS)
            line.to_csv(self.path, mode="a", header=False, index=False)
            self.known[key] = row["survived"]
            print(
                f"{muscle:6s} {solver:36s} {kilopascal:5d} kPa  "
                f"{'survived' if row['survived'] else row['failure']}  {row['wall_s']} s",
                flush=True,
            )
        return self.known[key]

    def largest(self, muscle, solver):
        """Largest surviving value of the grid [kPa], 0 if none."""
        low, high = -1, len(GRID_KPA)
        middle = high - 1  # one run suffices if the largest value is survived
        while high - low > 1:
            if self.survives(muscle, solver, GRID_KPA[middle]):
                low = middle
            else:
                high = middle
            middle = (low + high) // 2
        return GRID_KPA[low] if low >= 0 else 0


@dataclass(frozen=True)
class Options:
    """Options of all runs of a table, and its file."""

    out: Path
    step: float
    duration: float
    incompressibility: str


def main(
    face: Path,
    out: Path,
    step: float = 0.01,
    duration: float = 0.5,
    incompressibility: str = "pointwise",
    muscle: list[str] = [*MODELLED, "all"],  # noqa: B006
):
    """Complete the table and print it."""
    attempts = Attempts(load_face(face), Options(out, step, duration, incompressibility))
    rows = [{"muscle": m} | {s: attempts.largest(m, s) for s in SOLVERS} for m in muscle]
    print("largest sigma_max survived [kPa]")
    print(markdown(pd.DataFrame(rows)))
