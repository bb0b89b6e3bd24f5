"""Step time of a face, split into its phases, in milliseconds and in units U.

U is one numerical factorisation plus one solution of the face's matrix, measured in the same run with
the same threads, so that figures from different machines compare.

    python benchmarks/step_time.py FACE.nc [--steps 40] [--repeats 5] [--muscle OOP] [--peak 0.5]
"""

import argparse
import statistics
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import sim
from emgface.face.file import load_face
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters

PHASES = ("force", "tangent", "factorisation", "solution")


def seconds(function, repeats):
    """Median wall time of a call."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def pieces(system, repeats):
    """Median milliseconds of every piece of a step, and U."""
    control = system.control(np.zeros(len(system.muscles)))
    q, h = system.scene.mesh.X, 0.01
    work = sim.Workspace(system)
    K = system.tangent(q, control)[1]
    A = h * system.damping(q, control, K) + h * h * K
    A[system.pattern.diagonal] += system.mass
    work.linear.factorise(A)
    rhs = np.ones(system.pattern.n)
    found = {
        "force": seconds(lambda: system.force(q, control), repeats),
        "tangent and assembly": seconds(lambda: system.tangent(q, control), repeats),
        "smallest J": seconds(lambda: system.smallest_J(q), repeats),
        "factorisation": seconds(lambda: work.linear.factorise(A), repeats),
        "solution": seconds(lambda: work.linear.solve(rhs), repeats),
    }
    return found, found["factorisation"] + found["solution"], work.linear.name


def run(system, integrator, activation, steps):
    """Milliseconds per step in all and by phase, with the counts per step."""
    work = sim.Workspace(system)
    start = time.perf_counter()
    trajectory, _ = sim.simulate(
        system,
        activation,
        duration=steps * 0.01,
        integrator=integrator,
        steps=sim.FixedStep(0.01),
        probes=(sim.SmallestJ(), sim.Iterations()),
        work=work,
    )
    wall = (time.perf_counter() - start) / steps
    split = {name: work.seconds.get(name, 0.0) / steps for name in PHASES}
    counts = {
        name: float(trajectory[name].sum()) / steps for name in ("iterations", "factorisations")
    }
    return wall, split, counts, float(trajectory.smallest_J.min())


def main():
    """Print the two tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("face", type=Path)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--muscle", default="ZYG")
    parser.add_argument("--peak", type=float, default=0.5)
    parser.add_argument("--sigma-max", type=float, default=100e3)
    options = parser.parse_args()

    parameters = SimulationParameters(sigma_max=options.sigma_max, gravity=False)
    scene = compose_scene(load_face(options.face), parameters)
    systems = {
        sim.LinearlyImplicitEuler: sim.compile_scene(replace(scene, damping=sim.Rayleigh())),
        sim.ConvergedEuler: sim.compile_scene(replace(scene, damping=sim.RestRayleigh())),
    }
    system = systems[sim.LinearlyImplicitEuler]
    found, U, solver = pieces(system, 3 * options.repeats)
    print(f"{system.pattern.n} unknowns, {system.scene.mesh.n_elements} elements, {solver}")
    for name, value in found.items():
        print(f"  {name:22s}{1e3 * value:8.1f} ms {value / U:6.2f} U")
    print(f"  U = {1e3 * U:.1f} ms")

    peak = np.array([options.peak * m.startswith(options.muscle) for m in system.muscles])
    activation = sim.Activation(np.array([0.0, 0.1]), np.array([0.0 * peak, peak]))
    results = {cls: [] for cls in systems}
    for _ in range(options.repeats):  # alternating, so that a drift of the machine hits both
        for cls, own in systems.items():
            try:
                results[cls].append(run(own, cls(), activation, options.steps))
            except sim.SimulationError as error:
                print(f"  {cls.__name__:22s}{error}")
    print(
        f"{options.muscle} to {options.peak:g} in 0.1 s, {options.steps} steps of 10 ms, medians:"
    )
    for cls, rows in results.items():
        if not rows:
            continue
        wall = statistics.median(row[0] for row in rows)
        split = {name: statistics.median(row[1][name] for row in rows) for name in PHASES}
        counts, least = rows[0][2], rows[0][3]
        print(
            f"  {cls.__name__:22s}{1e3 * wall:8.1f} ms {wall / U:6.2f} U  "
            + "  ".join(f"{name} {1e3 * value:.1f}" for name, value in split.items())
            + f"  ({counts['iterations']:.2f} iterations, {counts['factorisations']:.2f} "
            f"factorisations per step, smallest J {least:.3f})"
        )


if __name__ == "__main__":
    main()
