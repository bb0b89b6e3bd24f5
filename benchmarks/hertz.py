"""A deformable sphere on a rigid plane against Hertz: force over indentation, mesh by mesh.

    python benchmarks/hertz.py [--cells 8 12 16 20 24] [--depth 0.0004] [--method constraint]
        [--figure hertz.png]

A quarter of a sphere of radius 1 m, cut off at its equator, where it is held; small strain, E = 10
kPa, nu = 0.3. The plane rises by `depth` radii; the indentation is the rise of the pole, the force the
normal force that the contact reports, times four. Hertz (1881):

    F = 4/3 E* sqrt(R) delta^(3/2),   E* = E/(1 - nu^2),

for a half-space of the sphere's curvature. A sphere held a radius away differs from it: a half-space
under the same force still moves there, by about 0.64 a/R of delta (Boussinesq; a: radius of the
contact), which holding forbids, while the sides, free at 0.7 R, give way more. At a depth of 0.0004 R,
a = 0.02 R, either is 1 to 2 % of the force, and they oppose each other. The radius is large because
contact is solved to 1e-6 m, the scale of a face: the indentation is 400 times that. Simulated data.
"""

import argparse
import time

import numpy as np

import sim
from sim.grids import grid_mesh

RADIUS, YOUNG, POISSON = 1.0, 1e4, 0.3
WIDTH = 0.7  # of the radius: sides of the part that is modelled
STEPS = 4
DISTANCE = 1e-5  # of the barrier [m]


def sphere(cells):
    """Quarter of the lower half of a sphere, x, y >= 0, graded towards its pole at the origin."""
    t = np.linspace(0.0, 1.0, cells + 1)
    near = (np.exp(3.5 * t) - 1.0) / (np.exp(3.5) - 1.0)
    x, y, s = np.meshgrid(WIDTH * near, WIDTH * near, near, indexing="ij")
    below = 1.0 - np.sqrt(1.0 - x**2 - y**2)  # height of the surface over the pole
    return grid_mesh(RADIUS * np.stack([x, y, below + s * (1.0 - below)], axis=-1))


def pressed(cells, depth, contact=sim.ConstraintContact, steps=STEPS):
    """Indentations [m] and forces of the whole sphere [N].

    Parameters
    ----------
    cells : int
        Cells along every edge.
    depth : float
        Last rise, in radii.
    contact : type
        Method of contact.
    """
    mesh = sphere(cells)
    X, low = mesh.X, np.flatnonzero(np.arange(len(mesh.X)) % (cells + 1) == 0)
    outer = sim.boundary_surface(mesh).triangles
    pole = sim.NodeSurface(outer[np.isin(outer, low).all(axis=1)], "sphere")
    corners = 2.0 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    start = 0.0 if contact is sim.ConstraintContact else -DISTANCE
    plane = sim.RigidShell(
        corners + [0.0, 0.0, start],
        np.array([[0, 1, 2], [0, 2, 3]]),
        "plane",
        lambda t: (np.eye(3), np.array([0.0, 0.0, depth * RADIUS * t])),
    )
    held = (
        sim.Fixed(np.flatnonzero(X[:, 0] == 0.0), (0,)),
        sim.Fixed(np.flatnonzero(X[:, 1] == 0.0), (1,)),
        sim.Fixed(np.flatnonzero(X[:, 2] > RADIUS * (1.0 - 1e-9))),
    )
    solid = sim.Solid((sim.Material(sim.LinearElastic(YOUNG, POISSON)),))
    more = {} if contact is sim.ConstraintContact else {"distance": DISTANCE}
    scene = sim.Scene(mesh, (solid, contact((sim.Pairing(pole, plane),), **more)), held)
    record, _ = sim.simulate(
        sim.compile_scene(scene),
        sim.resting(0),
        duration=1.0,
        integrator=sim.Static(tolerance=1e-8, residual_tolerance=1e-6),
        steps=sim.HalvingStep(1.0 / steps),
        probes=(sim.Contacts(("sphere on plane",)), sim.Markers(np.array([0]), ("pole",))),
    )
    rise = record["position"].sel(axis="z").values[0, 1:]
    return rise, 4.0 * record["contact_force"].values[0, 1:]


def hertz(rise):
    """Force [N] that Hertz expects for an indentation [m]."""
    return 4.0 / 3.0 * YOUNG / (1.0 - POISSON**2) * np.sqrt(RADIUS) * rise**1.5


def main():
    """Print the table and draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[8, 12, 16, 20, 24])
    parser.add_argument("--depth", type=float, default=0.0004)
    parser.add_argument("--method", choices=("constraint", "barrier"), default="constraint")
    parser.add_argument("--figure")
    options = parser.parse_args()
    methods = {"constraint": sim.ConstraintContact, "barrier": sim.BarrierContact}
    print(
        "| cells | unknowns | indentation [mm] | force [mN] | Hertz [mN] | error | seconds |\n"
        "|---|---|---|---|---|---|---|"
    )
    curves = {}
    for cells in options.cells:
        start = time.perf_counter()
        rise, force = pressed(cells, options.depth, methods[options.method])
        expected = hertz(rise)
        curves[cells] = (rise, force, expected)
        print(
            f"| {cells} | {3 * (cells + 1) ** 3} | {1e3 * rise[-1]:.4f} | {1e3 * force[-1]:.2f} | "
            f"{1e3 * expected[-1]:.2f} | "
            f"{100 * (force[-1] / expected[-1] - 1):+.1f} % | {time.perf_counter() - start:.0f} |",
            flush=True,
        )
    if options.figure:
        draw(curves, options.figure, options.method)


def draw(curves, path, method):
    """Force over indentation, and the error at the end over the size of the mesh."""
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    rise = np.linspace(0.0, curves[max(curves)][0][-1], 50)
    left.plot(1e3 * rise, 1e3 * hertz(rise), "k-", label="Hertz")
    for cells, (rise, force, _) in curves.items():
        left.plot(1e3 * rise, 1e3 * force, "o", fillstyle="none", label=f"{cells} cells")
    left.set(xlabel="indentation [mm]", ylabel="force [mN]")
    left.legend(frameon=False)
    errors = [100 * (force[-1] / expected[-1] - 1) for _, force, expected in curves.values()]
    right.plot(list(curves), errors, "o-")
    right.axhline(0.0, color="k", lw=0.5)
    right.axhspan(-5, 5, color="0.92", zorder=0)
    right.set(xlabel="cells along an edge", ylabel="error of the force [%]", xticks=list(curves))
    figure.suptitle(f"Elastic sphere on a rigid plane, {method} contact (simulated)")
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    main()
