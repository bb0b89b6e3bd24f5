"""Step time of a face by bulk law and integrator, divided into phases, in milliseconds and in units U.

    python -m benchmarks step_time FACE.nc

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

STEPS, REPEATS = 40, 5
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


def run(case, activation):
    """Milliseconds per step in total and by phase, and the counts per step."""
    work = sim.Workspace(case.system)
    start = time.perf_counter()
    trajectory, _ = sim.simulate(
        case.system,
        activation,
        duration=STEPS * 0.01,
        integrator=case.integrator,
        steps=sim.FixedStep(0.01),
        probes=(sim.SmallestJ(), sim.Iterations()),
        work=work,
    )
    row = {"step": 1e3 * (time.perf_counter() - start) / STEPS}
    row |= {name: 1e3 * work.seconds.get(name, 0.0) / STEPS for name in PHASES}
    for name in ("iterations", "factorisations", "indefinite"):
        row[name] = float(trajectory[name].sum()) / STEPS
    return row | {"smallest J": float(trajectory.smallest_J.min())}


def cases(face):
    """Every configuration, compiled."""
    found = []
    for bulk, options in BULK.items():
        parameters = SimulationParameters(
            sigma_max=100e3, gravity=False, contact=NO_CONTACT, **options
        )
        scene = compose_scene(face, parameters)
        for name, (integrator, damping) in INTEGRATORS.items():
            system = sim.compile_scene(replace(scene, damping=damping))
            found.append(Case(f"{name}, {bulk}", system, integrator))
    return found


def main(face: Path, out: Path | None = None):
    """Measure, print and store."""
    chosen = cases(load_face(face))
    alone = chosen[0].system
    level = np.array([0.5 * m.startswith("ZYG") for m in alone.muscles])
    activation = sim.Activation(np.array([0.0, 0.1]), np.array([0.0 * level, level]))
    units = []
    for _ in range(REPEATS):
        units.append(1e3 * unit_seconds(alone))
        for case in chosen:
            try:
                row = run(case, activation)
                case.rows.append(row | {"U": row["step"] / units[-1]})
            except sim.SimulationError as error:
                print(f"  {case.name}: {error}")
    print(
        f"{alone.pattern.n} unknowns, {alone.scene.mesh.n_elements} elements, {os.cpu_count()} cores, "
        f"U = {statistics.median(units):.1f} ms "
        f"({min(units):.1f} to {max(units):.1f})"
    )
    print(f"ZYG to 0.5 in 0.1 s, {STEPS} steps of 10 ms, medians of {REPEATS} rounds, ms per step:")
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
