"""Cost of every law per evaluation of force and of force with tangent, relative to Mooney-Rivlin.

    python -m benchmarks law_cost

One block of hexahedra at a random deformation, without muscles, including the assembly, which is
common to all laws. Processor time on one thread (set NUMBA_NUM_THREADS=1); the laws are evaluated
alternately, so that changes of the machine's speed affect all of them.
"""

import statistics
import time
from pathlib import Path

import numpy as np
import pandas as pd

import sim
from benchmarks.report import finish

CELLS, REPEATS = 18, 7
CASES = {
    "MooneyRivlin (first loop)": (sim.MooneyRivlin(), None),
    "NeoHooke (first loop)": (sim.NeoHooke(), None),
    "FiveTermMooneyRivlin": (sim.FiveTermMooneyRivlin(2500.0, 800.0, 1175.0, 300.0, 150.0), None),
    "Ogden, 1 term": (sim.Ogden((2500.0,), (4.0,)), None),
    "Ogden, 3 terms": (sim.Ogden((1250.0, -250.0, 40.0), (6.0, -10.0, 1.3)), None),
    "Fung": (sim.Fung(), None),
    "LinearElastic": (sim.LinearElastic(), None),
    "CoRotational": (sim.CoRotational(), None),
    "MooneyRivlin, viscoelastic": (sim.MooneyRivlin(), sim.Prony((0.2, 0.2), (0.1, 1.0))),
}


def main(out: Path | None = None):
    """Measure, print and store."""
    axis = np.arange(CELLS + 1) * 1e-3
    mesh = sim.grid_mesh(np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1))
    q = mesh.X + np.random.default_rng(0).normal(size=mesh.X.shape) * 5e-5
    axes = np.broadcast_to(np.eye(3), (mesh.n_elements, 3, 3))
    times, calls = {}, {}
    for name, (law, relaxation) in CASES.items():
        solid = sim.Solid((sim.Material(law, relaxation=relaxation),), axes=axes)
        system = sim.compile_scene(sim.Scene(mesh, (solid,)))
        control = system.control(np.zeros(0))
        system = system.during(system.rest_state(), 0.01)
        calls[name] = (
            lambda s=system, c=control: s.force(q, c),
            lambda s=system, c=control: s.tangent(q, c),
        )
        times[name] = ([], [])
        for call in calls[name]:
            call()
    for _ in range(REPEATS):
        for name, pair in calls.items():
            for call, seconds in zip(pair, times[name], strict=True):
                start = time.process_time()
                call()
                seconds.append(time.process_time() - start)
    median = {name: [1e3 * statistics.median(x) for x in pair] for name, pair in times.items()}
    table = pd.DataFrame.from_dict(median, orient="index", columns=["force ms", "with tangent ms"])
    relative = (table / table.loc["MooneyRivlin (first loop)"]).set_axis(
        ["ratio", "its ratio"], axis=1
    )
    table = table.join(relative).iloc[:, [0, 2, 1, 3]].rename_axis("law").reset_index()
    finish("law-cost", table, out)
