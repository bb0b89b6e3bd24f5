"""Scenes with bodies and attachments, shared by the tests of kinematics and joints."""

import numpy as np

import sim
from sim.embedding import embed
from tests.bodies import crossed_muscles, dense, grid

INERTIA = np.array([[3.0, 0.4, 0.1], [0.4, 5.0, -0.3], [0.1, -0.3, 4.0]]) * 1e-6
BOX = (0.02, 0.01, 0.01)


def swing(t):
    """Centre and quaternion of a body that turns about x and moves."""
    angle = 3.0 * t + 2.0 * t * t
    q = (np.cos(0.5 * angle), np.sin(0.5 * angle), 0.0, 0.0)
    return (0.03 + 0.05 * np.sin(4.0 * t), 0.005, 0.005 + 0.1 * t * t), q


def two_blocks():
    """Two boxes; the second begins inside the first."""
    first, second = grid((2, 1, 1), BOX), grid((1, 1, 1), (0.006, 0.006, 0.006))
    n = first.n_nodes
    X = np.concatenate([first.X, second.X + [0.004, 0.003, 0.005]])
    hexes = np.concatenate([first.blocks[0].nodes, second.blocks[0].nodes + n])
    return first, sim.mesh_from_arrays(X, hex8=hexes)


def mixed_system(*, prescribed=True, **more) -> sim.System:
    """Tissue between a free body and a prescribed one, with a chain: node in element on body."""
    first, mesh = two_blocks()
    n = first.n_nodes
    left = np.flatnonzero(mesh.X[:n, 0] == 0.0)
    right = np.flatnonzero(mesh.X[:n, 0] == BOX[0])
    lower = n + np.flatnonzero(mesh.X[n:, 2] == 0.005)
    jaw = sim.Body("jaw", 0.004, INERTIA, (-0.004, 0.004, 0.007), damping=(0.01, 1e-7))
    skull = sim.Body("skull", centre=(0.03, 0.005, 0.005))
    points = np.array([[-0.01, 0.0, 0.0], [0.03, 0.0, 0.01]])
    members = [
        sim.OnBody("jaw", np.append(left, mesh.n_nodes)),
        sim.OnBody("skull", np.append(right, mesh.n_nodes + 1)),
        sim.InElement(lower, embed(first, mesh.X[lower])),
    ]
    if prescribed:
        members.append(sim.PrescribedBody("skull", swing))
    solid = sim.Solid((sim.Material(sim.MooneyRivlin()),), muscles=crossed_muscles(mesh))
    terms = (solid, sim.NodalVolume(), sim.Gravity(), *more.pop("terms", ()))
    more = {"bodies": (jaw, skull), "points": points, **more}
    scene = sim.Scene(mesh, terms, tuple(members), sim.RestRayleigh(), **more)
    return sim.compile_scene(scene)


def random_pose(system: sim.System, seed=0, size=1.0):
    """A pose away from rest, at 0.1 s."""
    rng = np.random.default_rng(seed)
    d = rng.normal(size=system.pattern.n) * 2e-4 * size
    for k in range(len(system.kinematics.free_bodies)):
        d[system.kinematics.first + 6 * k + 3 :][:3] = rng.normal(size=3) * 0.4 * size
    rest = system.rest_state().pose
    return system.kinematics.advance(rest, d, 0.1), d


def dense_rows(system: sim.System, pose) -> np.ndarray:
    """R (3 n_points, n) column by column."""
    eye = np.eye(system.pattern.n)
    columns = [system.kinematics.displacements(e, pose).ravel() for e in eye]
    return np.stack(columns, axis=1)


def dense_points(system: sim.System, values: np.ndarray) -> np.ndarray:
    """Full matrix over all components of points from values on the pattern of points."""
    p, free = system.point_pattern, system.free
    A = np.zeros((3 * p.n_nodes,) * 2)
    row = np.repeat(np.arange(p.n), np.diff(p.indptr))
    A[free[row], free[p.indices]] = values
    A[free[p.indices], free[row]] = values
    return A


__all__ = ["dense", "dense_points", "dense_rows", "mixed_system", "random_pose", "swing"]
