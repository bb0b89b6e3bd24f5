"""Force and indentation of a deformable sphere on a rigid plane compared with Hertz, for several meshes.

    python -m benchmarks hertz

A quarter of a sphere of radius 1 m, fixed at its equator; small strain, E = 10 kPa, nu = 0.3. The
plane rises by `DEPTH` radii; the indentation is the rise of the pole, the force four times the
normal force reported by contact. Hertz (1881), for a half-space of the same curvature:

    F = 4/3 E* sqrt(R) delta^(3/2),   E* = E/(1 - nu^2).

The sphere is fixed at a distance of one radius, where a half-space under the same force would move
by about 0.64 a/R of delta (Boussinesq; a: radius of the contact), and its sides, free at 0.7 R, are
more compliant. At a depth of 0.0004 R, a = 0.02 R, each of the two effects is 1 to 2 % of the
force, and they have opposite signs. The indentation is 400 times the tolerance of contact, 1e-6 m.
Simulated data.
"""

import numpy as np
import pandas as pd

import sim
from benchmarks.report import markdown
from sim.mesh import grid_mesh

RADIUS, YOUNG, POISSON = 1.0, 1e4, 0.3
WIDTH = 0.7  # of the radius: sides of the part that is modelled
STEPS = 4


def sphere(cells):
    """Quarter of the lower half of a sphere, x, y >= 0, graded towards its pole at the origin."""
    t = np.linspace(0.0, 1.0, cells + 1)
    near = (np.exp(3.5 * t) - 1.0) / (np.exp(3.5) - 1.0)
    x, y, s = np.meshgrid(WIDTH * near, WIDTH * near, near, indexing="ij")
    below = 1.0 - np.sqrt(1.0 - x**2 - y**2)  # height of the surface over the pole
    return grid_mesh(RADIUS * np.stack([x, y, below + s * (1.0 - below)], axis=-1))


def pressed(cells, depth, steps=STEPS):
    """Indentations [m] and forces of the whole sphere [N].

    The sphere has `cells` elements along every edge, and the plane rises by `depth` radii in all.
    """
    mesh = sphere(cells)
    X, low = mesh.X, np.flatnonzero(np.arange(len(mesh.X)) % (cells + 1) == 0)
    outer = sim.boundary_surface(mesh).triangles
    pole = sim.NodeSurface(outer[np.isin(outer, low).all(axis=1)], "sphere")
    corners = 2.0 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    plane = sim.RigidShell(
        corners,
        np.array([[0, 1, 2], [0, 2, 3]]),
        "plane",
        lambda t: (np.eye(3), np.array([0.0, 0.0, depth * RADIUS * t])),
    )
    fixed = (
        sim.Fixed(np.flatnonzero(X[:, 0] == 0.0), (0,)),
        sim.Fixed(np.flatnonzero(X[:, 1] == 0.0), (1,)),
        sim.Fixed(np.flatnonzero(X[:, 2] > RADIUS * (1.0 - 1e-9))),
    )
    solid = sim.Solid((sim.Material(sim.LinearElastic(YOUNG, POISSON)),))
    scene = sim.Scene(mesh, (solid, sim.ConstraintContact((sim.Pairing(pole, plane),))), fixed)
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
    """Force [N] by Hertz for an indentation [m]."""
    return 4.0 / 3.0 * YOUNG / (1.0 - POISSON**2) * np.sqrt(RADIUS) * rise**1.5


CELLS = (8, 12, 16, 20, 24)  # along an edge
DEPTH = 0.0004  # of the radius


def main():
    """Print the error of the force in percent."""
    row = {"cells along an edge": "error of the force [%]"}
    for n in CELLS:
        rise, force = pressed(n, DEPTH)
        row[str(n)] = f"{100 * (force[-1] / hertz(rise[-1]) - 1):.1f}"
    print(markdown(pd.DataFrame([row])), flush=True)
