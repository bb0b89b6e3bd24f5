"""Mirrored scenes in contact move as mirror images, and renumbered ones as before."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.spatial import KDTree

import sim
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from sim.contact.rows import ContactTolerances
from sim.contact.search import Candidates, SignedFaces
from sim.integrators.linear_rows import ROW_MOTION_SHARE
from tests.bodies import grid
from tests.contact.scenes import CASES, contact_of, moved, system_of, two_bodies

MIRROR = np.array([-1.0, 1.0, 1.0])
CELLS, BLOCK = (4, 2, 2), (0.02, 0.01, 0.01)
SHAPES = {"keel in groove": (0.3, 0.4), "flat on flat": (0.0, 0.0), "keel on plate": (0.4, 0.0)}
"""Slopes of the lower side of the upper block and of the upper side of the lower one, along |x|."""


def mirrored_surface(surface, X):
    """The same surface with the triangles of its right half the images of those of its left."""
    mirror = np.asarray(KDTree(X).query(X * MIRROR)[1], dtype=np.int64)
    left = surface.triangles[X[surface.triangles, 0].mean(axis=1) < 0.0]
    return sim.NodeSurface(np.concatenate([left, mirror[left][:, ::-1]]), surface.name)


def blocks(slopes, clearance):
    """Two blocks, each the mirror image of itself in x = 0, and their surfaces.

    The upper one is slightly smaller, so that no edges coincide, which may pass each other.
    """
    above, below = slopes
    mesh = grid(CELLS, BLOCK)
    X = mesh.X - [0.5 * BLOCK[0], 0.5 * BLOCK[1], 0.0]
    X[:, 0] = np.sign(X[:, 0]).round() * np.abs(X[:, 0]).round(12)
    low, high = X.copy(), 0.9 * X
    high[:, 2] = X[:, 2]
    low[:, 2] += below * np.abs(X[:, 0]) * (X[:, 2] / BLOCK[2])
    high[:, 2] += above * np.abs(X[:, 0]) * (1.0 - X[:, 2] / BLOCK[2])
    lift = [0.0, 0.0, BLOCK[2] + max(0.0, below - above) * 0.5 * BLOCK[0] + clearance]
    mesh, *surfaces = two_bodies(replace(mesh, X=low), replace(mesh, X=high), lift)
    return mesh, [mirrored_surface(surface, mesh.X) for surface in surfaces]


def thrown(method, mesh, surfaces, integrator, steps=8):
    """Positions (steps, nodes, 3): blocks held at their far ends, thrown at each other.

    Free blocks would tip over, an instability that starts from rounding.
    """
    z = mesh.X[:, 2]
    fixed = sim.Fixed(np.flatnonzero((z < 1e-9) | (z > z.max() - 1e-9)))
    system = system_of(mesh, contact_of(method, (sim.Pairing(*surfaces),)), reductions=(fixed,))
    cells, upper = mesh.blocks[0].nodes, max(surfaces, key=lambda s: z[s.nodes].max())
    down = np.isin(np.arange(mesh.n_nodes), cells[np.isin(cells, upper.nodes).any(axis=1)])
    v = np.where(down[:, None], [0.0, 0.0, -0.5], [0.0, 0.0, 0.5])
    v[(z < 1e-9) | (z > z.max() - 1e-9)] = 0.0
    states = moved(system, integrator(), steps, h=0.002, v=v)
    return np.stack([state.q for state in states])


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("method", "integrator"), CASES)
def test_mirrored_blocks_move_as_mirror_images(method, integrator, shape):
    """Vertices, edges and grooves in the plane of symmetry: faces on both sides are equally near."""
    mesh, surfaces = blocks(SHAPES[shape], 1e-5)
    mirror = KDTree(mesh.X).query(mesh.X * MIRROR)[1]
    np.testing.assert_array_equal(mesh.X[mirror] * MIRROR, mesh.X)
    q = thrown(method, mesh, surfaces, integrator)
    assert np.abs(q - mesh.X).max() > 3e-5
    assert np.abs(q[:, mirror] * MIRROR - q).max() < 1e-10


@pytest.mark.parametrize(("method", "integrator"), CASES)
def test_results_do_not_depend_on_the_numbering(method, integrator):
    """Nodes, elements and triangles in another order, and the surfaces of the pairing exchanged."""
    mesh, surfaces = blocks(SHAPES["keel in groove"], 1e-5)
    rng = np.random.default_rng(3)
    new = rng.permutation(mesh.n_nodes)
    X = np.empty_like(mesh.X)
    X[new] = mesh.X
    cells = new[mesh.blocks[0].nodes]
    other = sim.mesh_from_arrays(X, hex8=cells[rng.permutation(len(cells))])
    shuffled = [
        sim.NodeSurface(
            np.roll(new[s.triangles], 1, axis=1)[rng.permutation(len(s.triangles))], s.name
        )
        for s in surfaces
    ]
    first = thrown(method, mesh, surfaces, integrator)
    second = thrown(method, other, shuffled[::-1], integrator)
    assert np.abs(first - mesh.X).max() > 3e-5
    assert np.abs(second[:, new] - first).max() < 1e-9


@pytest.mark.parametrize("tolerance", [3e-7, 1e-7])
def test_the_accuracy_of_solutions_does_not_decide_a_side(coarse, tolerance):
    """Faces that are equally close within it, and rows that a correction closes, come in pairs.

    The two sides then differ by the error of the solutions, and not by the rows of one side.
    """
    accurate = partial(sim.LinearlyImplicitTrapezoidal, tolerance=tolerance)
    assert pursed_asymmetry(coarse, accurate) < 1e-8


@pytest.mark.parametrize(("method", "integrator"), CASES)
def test_a_symmetric_face_purses_symmetrically(coarse, method, integrator):
    # Contact forces of a linearly implicit step end when they move rows by less than this, and its
    # factor is of single precision: left and right then agree to the same length.
    linear = integrator in (sim.LinearlyImplicitEuler, sim.LinearlyImplicitTrapezoidal)
    left = ROW_MOTION_SHARE * ContactTolerances().residual if linear else 1e-9
    assert pursed_asymmetry(coarse, integrator) < left


def pursed_asymmetry(coarse, integrator) -> float:
    """Lips that close on each other and on the teeth, both sides active alike."""
    parameters = SimulationParameters(gravity=False, sigma_max=100e3)
    system = sim.compile_scene(compose_scene(coarse, parameters))
    X = system.scene.mesh.X
    mirror = KDTree(X).query(X * MIRROR)[1]
    np.testing.assert_array_equal(X[mirror] * MIRROR, X)
    peak = np.array([0.4 if name[:3] in ("OOP", "OOM") else 0.0 for name in system.muscles])
    activation = sim.Activation(np.array([0.0, 0.1]), np.stack([0.0 * peak, peak]))
    _, end = sim.simulate(
        system,
        activation,
        duration=0.08,
        integrator=integrator(),
        steps=sim.FixedStep(0.01),
    )
    assert np.abs(end.q - X).max() > 3e-3
    return float(np.abs(end.q[mirror] * MIRROR - end.q).max())


def test_common_features_of_faces_give_one_row_and_equally_close_faces_one_each():
    """A point above an edge, above a corner, and in the middle of a groove of a folded sheet."""
    x = np.array([[0.0, 0, 0], [0, 1, 0], [-1, 0.5, 0.3], [1, 0.5, 0.3]])
    sheet = sim.NodeSurface(np.array([[0, 1, 2], [1, 0, 3]]), "groove")
    faces = SignedFaces(sheet)
    for point, number in (([0.0, 0.5, 0.1], 2), ([0.0, 0.5, -0.1], 1), ([0.2, 0.5, 0.1], 1)):
        points = np.array([point])
        near = Candidates(sheet.triangles, np.array([-1]))
        none, one = np.zeros(1), np.ones(1)
        met = faces.met(points, one, none, x, near, np.empty((0, 3)), np.zeros((1, 3)), 0.0, -1.0)
        closest = np.flatnonzero(~met.wall)
        assert len(closest) == number, point
        assert np.abs(met.normal[closest].sum(axis=0)[0]) < 1e-12 or point[0] != 0.0
        assert np.ptp(met.gap[closest]) < 1e-12
