"""Time per step of a scene of four bodies, 20 joint rows and 45 line muscles, and its memory.

    python -m benchmarks bodies

A chain of four bodies hangs on line muscles that run to space and between bodies. Processor time of one
thread, kernels warm; "fused" is the step of `sim._kernels.multibody` within `simulate` with an output
every 10 steps, "single" the same called step by step, "general" the path of all other scenes. Memory is
the growth of the peak of the process during the last repeat.
"""

import resource
import statistics
import time
from pathlib import Path

import numpy as np
import pandas as pd

import sim
from benchmarks.report import finish
from sim.joints import Limit, PointOnPlane, Revolute, Spherical

STEP, BODIES, MUSCLES = 1e-3, 4, 45


def scene() -> sim.Scene:
    """Four bodies in a chain; 5 + 5 + 3 + 3 rows, two planes and two limits; 45 muscles."""
    rng = np.random.default_rng(0)
    centres = np.array([[0.0, 0.03 * b, -0.02 * b] for b in range(BODIES)])
    inertia = np.diag([3.0, 5.0, 4.0]) * 1e-5
    bodies = tuple(sim.Body(f"b{b}", 0.1, inertia, centres[b], (0.5, 1e-4)) for b in range(BODIES))
    origins = centres + rng.normal(size=(BODIES, 3)) * 0.05 + np.array([0.0, 0.0, 0.08])
    ends, members, fibres = [], [], []
    for k in range(MUSCLES):
        body, other = k % BODIES, (k % BODIES + 1) if k % 3 == 0 else -1
        first = origins[body] + rng.normal(size=3) * 0.01
        if 0 <= other < BODIES:
            first = centres[other] + rng.normal(size=3) * 0.02
            members.append(sim.OnBody(f"b{other}", np.array([2 * k])))
        else:
            members.append(sim.Fixed(np.array([2 * k])))
        members.append(sim.OnBody(f"b{body}", np.array([2 * k + 1])))
        ends += [first, centres[body] + rng.normal(size=3) * 0.02]
        fibres.append(sim.LineFibre(k, np.array([2 * k, 2 * k + 1])))
    guided = 2 * MUSCLES + np.arange(2)
    ends += [centres[3] + [0.02, 0.0, 0.0], centres[3] - [0.02, 0.0, 0.0]]
    members.append(sim.OnBody("b3", guided))
    laws = [
        sim.Peck(5.0 + k, tendon_ratio=0.2, stretch_max=1.3, passive_fraction=0.015)
        for k in range(MUSCLES)
    ]
    names = tuple(f"m{k}" for k in range(MUSCLES))
    lines = sim.LineMuscles(names, fibres, laws, damping=1.0)
    joints = (
        Revolute("h0", None, "b0", centres[0] + [0, -0.02, 0.01], (1.0, 0.0, 0.0)),
        Revolute("h1", "b0", "b1", centres[1] + [0, -0.015, 0.01], (1.0, 0.1, 0.0)),
        Spherical("s2", "b1", "b2", centres[2] + [0, -0.015, 0.01]),
        Spherical("s3", "b2", "b3", centres[3] + [0, -0.015, 0.01]),
        PointOnPlane("p0", int(guided[0]), None, ends[-2], (0.3, 0.2, 1.0)),
        PointOnPlane("p1", int(guided[1]), None, ends[-1], (0.2, 0.1, 1.0), unilateral=True),
        Limit("l0", None, "b0", centres[0] + [0, -0.02, 0.01], (1.0, 0.0, 0.0), -0.2, 0.2),
    )
    return sim.Scene(
        sim.NO_TISSUE,
        (sim.Gravity(), lines),
        tuple(members),
        bodies=bodies,
        points=np.array(ends),
        joints=joints,
    )


def drive(seconds: float) -> sim.Activation:
    """Smooth activations, sampled at 100 Hz."""
    t = np.arange(0.0, seconds + 0.02, 0.01)
    phase = np.arange(MUSCLES)
    return sim.Activation(t, 0.05 + 0.05 * np.sin(2.0 * np.pi * 2.0 * t[:, None] + phase))


def stepped(system, activation, steps, general):
    """Seconds of processor time per call of the integrator's step."""
    work = sim.Workspace(system)
    if general:
        work.bodies = None
    control = sim.activation.Driven(system, activation)
    state, integrator = system.rest_state(), sim.LinearlyImplicitEuler()
    start = time.process_time()
    for _ in range(steps):
        state, _ = integrator.step(system, state, control, STEP, work)
    return (time.process_time() - start) / steps, state


def simulated(system, activation, steps):
    """Seconds of processor time per step of a simulation."""
    start = time.process_time()
    _, state = sim.simulate(
        system,
        activation,
        duration=steps * STEP,
        steps=sim.FixedStep(STEP),
        every=10 * STEP,
        integrator=sim.LinearlyImplicitEuler(),
        probes=(sim.Frames(tuple(body.name for body in system.scene.bodies)),),
    )
    return (time.process_time() - start) / steps, state


def main(out: Path | None = None):
    """Measure, print and store."""
    system = sim.compile_scene(scene())
    steps, few = 2000, 100
    activation = drive(steps * STEP)
    simulated(system, activation, few)  # compiles
    seconds = {"fused": [], "single": [], "general": []}
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        time_of, end = simulated(system, activation, steps)
        growth = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        seconds["fused"].append(time_of)
        seconds["single"].append(stepped(system, activation, steps, False)[0])
        seconds["general"].append(stepped(system, activation, few // 5, True)[0])
    same = [stepped(system, activation, few // 5, general)[1] for general in (False, True)]
    rows = [
        {
            "path": name,
            "us per step": 1e6 * statistics.median(times),
            "least": 1e6 * min(times),
            "largest": 1e6 * max(times),
            "times real time": STEP / statistics.median(times),
        }
        for name, times in seconds.items()
    ]
    print(
        f"{system.pattern.n} velocities, {len(system.rows.names)} rows, {MUSCLES} muscles; "
        f"memory grew by {growth} KiB in the last repeat; paths differ by "
        f"{np.abs(same[0].q - same[1].q).max():.1e} m after {few // 5} steps; largest displacement "
        f"{1e3 * np.abs(end.q - system.mesh.X).max():.1f} mm"
    )
    finish("bodies", pd.DataFrame(rows), out)
