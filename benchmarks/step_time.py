"""Step time of a face by bulk law and integrator, split into phases, in milliseconds and in units U.

U is one numerical factorisation plus one solution in double precision of the face's matrix with
pointwise bulk, measured in every round with the same threads, so that figures from different machines
and times compare. The rounds go through all configurations in turn, so that a drift of the machine hits
all alike; medians are printed. Damping follows the current tangent for the linearly implicit steps, as
the published simulator's does, and that at rest for the converged ones, which leave at most 1e-3 mm.

    python benchmarks/step_time.py FACE.nc [--steps 40] [--repeats 5] [--muscle OOP] [--peak 0.5]
        [--bulk nodal] [--linear pardiso]
"""

import argparse
import os
import resource
import statistics
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

import sim
from emgface.bench.unit import unit_seconds
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
    """One configuration and what its rounds have measured."""

    name: str
    system: sim.System
    integrator: sim.integrators.TimeIntegrator
    rows: list[dict[str, float]] = field(default_factory=list)


def run(case, activation, steps, linear):
    """Milliseconds per step in all and by phase, with the counts per step."""
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
        parameters = SimulationParameters(sigma_max=sigma_max, gravity=False, **BULK[bulk])
        scene = compose_scene(face, parameters)
        for name in integrators:
            integrator, damping = INTEGRATORS[name]
            system = sim.compile_scene(replace(scene, damping=damping))
            found.append(Case(f"{name}, {bulk}", system, integrator))
    return found


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("face", type=Path)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--muscle", default="ZYG")
    parser.add_argument("--peak", type=float, default=0.5)
    parser.add_argument("--sigma-max", type=float, default=100e3)
    parser.add_argument("--bulk", action="append", choices=BULK)
    parser.add_argument("--integrator", action="append", choices=INTEGRATORS)
    parser.add_argument("--linear", default="auto", help="name of the linear solver")
    options = parser.parse_args()

    face = load_face(options.face)
    bulks, integrators = options.bulk or [*BULK], options.integrator or [*INTEGRATORS]
    alone = cases(face, ["pointwise"], ["linearly implicit"], options.sigma_max)[0].system
    chosen = cases(face, bulks, integrators, options.sigma_max)
    peak = np.array([options.peak * m.startswith(options.muscle) for m in alone.muscles])
    activation = sim.Activation(np.array([0.0, 0.1]), np.array([0.0 * peak, peak]))
    units = []
    for _ in range(options.repeats):
        units.append(1e3 * unit_seconds(alone))
        for case in chosen:
            try:
                row = run(case, activation, options.steps, options.linear)
                case.rows.append(row | {"U": row["step"] / units[-1]})
            except sim.SimulationError as error:
                print(f"  {case.name}: {error}")
    print(
        f"{alone.pattern.n} unknowns, {alone.scene.mesh.n_elements} elements, {os.cpu_count()} cores, "
        f"linear solver {options.linear}; U = {statistics.median(units):.1f} ms "
        f"({min(units):.1f} to {max(units):.1f})"
    )
    print(
        f"{options.muscle} to {options.peak:g} in 0.1 s, {options.steps} steps of 10 ms, medians of "
        f"{options.repeats} rounds, ms per step:"
    )
    columns = ("step", "U", *PHASES, "iterations", "factorisations", "indefinite", "smallest J")
    print(f"{'':28s}" + "".join(f"{name:>15s}" for name in columns))
    for case in (c for c in chosen if c.rows):
        middle = [statistics.median(row[name] for row in case.rows) for name in columns]
        print(f"{case.name:28s}" + "".join(f"{value:15.2f}" for value in middle))
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"largest memory of the process, with all configurations compiled: {used:.0f} MB")


if __name__ == "__main__":
    main()
