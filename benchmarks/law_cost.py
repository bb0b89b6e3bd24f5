"""Cost of every law per evaluation of force and of force with tangent, relative to Mooney-Rivlin.

    python benchmarks/law_cost.py [--cells 18] [--repeats 7]

One block of hexahedra, at a random deformation, without muscles; the summation into nodes and matrix is
counted, as every law needs it. Processor time, on one thread; the laws take turns, so that a drift of
the machine hits all of them. Set NUMBA_NUM_THREADS=1.
"""

import argparse
import statistics
import time

import numpy as np

import sim

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


def block(cells):
    """Cube of cells^3 hexahedra of 1 mm."""
    axis = np.arange(cells + 1) * 1e-3
    X = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    index = np.arange((cells + 1) ** 3).reshape(X.shape[:3])
    low, high = slice(0, cells), slice(1, cells + 1)
    corners = ((low, low), (high, low), (high, high), (low, high))
    nodes = [index[a, b, c].ravel() for c in (low, high) for a, b in corners]
    return sim.mesh_from_arrays(X.reshape(-1, 3), hex8=np.stack(nodes, axis=1))


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=18)
    parser.add_argument("--repeats", type=int, default=7)
    options = parser.parse_args()
    mesh = block(options.cells)
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
    for _ in range(options.repeats):
        for name, pair in calls.items():
            for call, found in zip(pair, times[name], strict=True):
                start = time.process_time()
                call()
                found.append(time.process_time() - start)
    median = {name: [1e3 * statistics.median(x) for x in pair] for name, pair in times.items()}
    reference = median["MooneyRivlin (first loop)"]
    print(f"{mesh.n_elements} hexahedra, medians of {options.repeats}")
    print(f"{'law':28s}{'force ms':>10s}{'ratio':>7s}{'with tangent ms':>17s}{'ratio':>7s}")
    for name, (force, tangent) in median.items():
        print(
            f"{name:28s}{force:10.1f}{force / reference[0]:7.2f}{tangent:17.1f}"
            f"{tangent / reference[1]:7.2f}"
        )


if __name__ == "__main__":
    main()
