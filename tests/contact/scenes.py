"""Scenes of contact."""

import numpy as np
import pytest

import sim
from sim._kernels import triangles as kernel
from sim.contact.search import Candidates, crossed_faces
from tests.bodies import grid

CASES = [
    pytest.param(sim.ConstraintContact, integrator, id=integrator.__name__)
    for integrator in (
        sim.ConvergedEuler,
        sim.Sdirk2,
        sim.LinearlyImplicitEuler,
        sim.LinearlyImplicitTrapezoidal,
    )
]
"""Contact with the integrators that support it."""

DAMPING = sim.RestRayleigh(alpha=0.0, beta=0.01)


def contact_of(method, pairings, friction=0.0):
    return method(pairings, friction=friction)


def box(low, high, name="floor", motion=None) -> sim.RigidShell:
    mesh = grid((1, 1, 1), np.subtract(high, low))
    return sim.RigidShell(mesh.X + low, sim.boundary_surface(mesh).triangles, name, motion)


def square(height=0.0, half=0.1, motion=None, name="square") -> sim.RigidShell:
    """Open square seen from above."""
    corners = half * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return sim.RigidShell(corners + [0, 0, height], np.array([[0, 1, 2], [0, 2, 3]]), name, motion)


def two_bodies(first, second, shift):
    """Combine two meshes; return the mesh and the surface of each body."""
    n, X = len(first.X), np.vstack([first.X, second.X + shift])
    cells = np.vstack([first.blocks[0].nodes, second.blocks[0].nodes + n])
    mesh = sim.mesh_from_arrays(X, hex8=cells)
    triangles = sim.boundary_surface(mesh).triangles
    lower = (triangles < n).all(axis=1)
    return (
        mesh,
        sim.NodeSurface(triangles[lower], "first"),
        sim.NodeSurface(triangles[~lower], "second"),
    )


def system_of(mesh, *terms, reductions=(), damping=DAMPING, solid=None) -> sim.System:
    return sim.compile_scene(sim.Scene(mesh, (solid or sim.Solid(), *terms), reductions, damping))


def moved(system, integrator, steps, h=0.01, v=None, initial=None):
    """States at the ends of several steps."""
    state = initial or system.rest_state()
    if v is not None:
        state = sim.State(0.0, state.q, v)
    work, control = sim.Workspace(system), system.control(np.zeros(0))
    states = [state]
    for _ in range(steps):
        states.append(integrator.step(system, states[-1], control, h, work)[0])
    return states


def point_triangle(p, triangle):
    """Distance [m] of a point p (3,) from a triangle (3, 3), and weights of the nearest point c.

    The derivative of the distance is (p - c)/distance by p, and minus that times the weights by the
    corners.
    """
    weight = np.zeros(3)
    squared, _ = kernel.point_triangle(p, triangle[0], triangle[1], triangle[2], weight)
    return float(np.sqrt(squared)), weight


def entered_by(before, after, x0, x1, triangles):
    """Faces that points without a vertex of their own enter first."""
    near = Candidates(triangles, np.full(len(before), -1))
    return crossed_faces(before, after, x0, x1, triangles, near)
