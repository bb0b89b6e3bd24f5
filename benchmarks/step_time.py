"""Step time of a face by bulk law and integrator, divided into phases, in milliseconds and in units U.

    python -m benchmarks step_time FACE.nc [--steps 40] [--repeats 5] [--muscle OOP] [--peak 0.5]
        [--bulk nodal] [--linear pardiso]

U is one numerical factorisation plus one solution in double precision of the face's matrix with
pointwise bulk, measured in every round with the same threads, so that values from different
machines and times can be compared. Each round measures all configurations; medians are printed.
Damping follows the current tangent for the linearly implicit steps, as in the published simulator,
and the tangent at rest for the converged ones, whose error is at most 1e-3 mm.
"""

import os
import resource
import statistics
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

import sim
from benchmarks.report import finish, say
from benchmarks.unit import unit_seconds
from emgface.face.contact_parameters import NO_CONTACT
from emgface.face.file import load_face
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters

PHASES = ("force", "tangent", "factorisation", "solution")
BULK = {
    "pointwise": {},
    "element": {"incompressibility": "element", "bulk_potential": "quadratic"},
    "nodal": {"incompressibility": "nodal", "bulk_potential": "quadratic"},
}
INTEGRATORS = {
    "linearly implicit": (sim.LinearlyImplicitEuler(), sim.Rayleigh()),
    "converged": (sim.ConvergedEuler(), sim.RestRayleigh()),
}


@dataclass
class Case:
    """One configuration and the measurements of its rounds."""

    name: str
    system: sim.System
    integrator: sim.integrators.TimeIntegrator
    rows: list[dict[str, float]] = field(default_factory=list)


def run(case, activation, steps, linear):
    """Milliseconds per step in total and by phase, and the counts per step."""
    work = sim.Workspace(case.system, linear)
    start = time.perf_counter()
    trajectory, _ = sim.simulate(
        case.system,
        activation,
        duration=steps * 0.01,
        integrator=case.integrator,
        steps=sim.FixedStep(0.01),
        probes=(sim.SmallestJ(), sim.Iterations()),
        work=work,
    )
    row = {"step": 1e3 * (time.perf_counter() - start) / steps}
    row |= {name: 1e3 * work.seconds.get(name, 0.0) / steps for name in PHASES}
    for name in ("iterations", "factorisations", "indefinite"):
        row[name] = float(trajectory[name].sum()) / steps
    return row | {"smallest J": float(trajectory.smallest_J.min())}


def cases(face, bulks, integrators, sigma_max):
    """Every configuration, compiled."""
    found = []
    for bulk in bulks:
        parameters = SimulationParameters(
            sigma_max=sigma_max, gravity=False, contact=NO_CONTACT, **BULK[bulk]
        )
        scene = compose_scene(face, parameters)
        for name in integrators:
            integrator, damping = INTEGRATORS[name]
            system = sim.compile_scene(replace(scene, damping=damping))
            found.append(Case(f"{name}, {bulk}", system, integrator))
    return found


def main(
    face: Path,
    steps: int = 40,
    repeats: int = 5,
    muscle: str = "ZYG",
    peak: float = 0.5,
    sigma_max: float = 100e3,
    bulk: list[str] = list(BULK),  # noqa: B006
    integrator: list[str] = list(INTEGRATORS),  # noqa: B006
    linear: str = "auto",
    out: Path | None = None,
):
    """Measure, print and store."""
    model = load_face(face)
    alone = cases(model, ["pointwise"], ["linearly implicit"], sigma_max)[0].system
    chosen = cases(model, bulk, integrator, sigma_max)
    level = np.array([peak * m.startswith(muscle) for m in alone.muscles])
    activation = sim.Activation(np.array([0.0, 0.1]), np.array([0.0 * level, level]))
    units = []
    for _ in range(repeats):
        units.append(1e3 * unit_seconds(alone))
        for case in chosen:
            try:
                row = run(case, activation, steps, linear)
                case.rows.append(row | {"U": row["step"] / units[-1]})
            except sim.SimulationError as error:
                print(f"  {case.name}: {error}")
    print(
        f"{alone.pattern.n} unknowns, {alone.scene.mesh.n_elements} elements, {os.cpu_count()} cores, "
        f"linear solver {linear}; U = {statistics.median(units):.1f} ms "
        f"({min(units):.1f} to {max(units):.1f})"
    )
    print(
        f"{muscle} to {peak:g} in 0.1 s, {steps} steps of 10 ms, medians of "
        f"{repeats} rounds, ms per step:"
    )
    columns = ("step", "U", *PHASES, "iterations", "factorisations", "indefinite", "smallest J")
    rows = [
        {"case": case.name}
        | {name: statistics.median(row[name] for row in case.rows) for name in columns}
        for case in chosen
        if case.rows
    ]
    finish("step-time", pd.DataFrame(rows), out)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    say(f"largest memory of the process, with all configurations compiled: {used:.0f} MB")
