"""Contact normals in successive steps, for rotating faces and sliding vertices."""

from dataclasses import replace

import numpy as np
import pytest

import sim
from sim.contact.compiled import CONTACT_MEMORY, DIRECTION
from sim.contact.rows import ContactTolerances
from sim.contact.step import NORMAL_FILTER_TIME, ContactStep
from tests.bodies import grid, rotation
from tests.contact.scenes import box, moved, system_of, two_bodies

H = 0.01
UP = np.array([0.0, 0.0, 1.0])


def tilted(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def test_normals_rotate_with_a_plate():
    """A plate that tilts at 1 rad/s with a sticking block: normals are perpendicular to the plate."""
    mesh = grid((1, 1, 1), (0.01, 0.01, 0.01))
    plate = box([-0.1, -0.1, -0.01], [0.1, 0.1, 0.0], "plate", lambda t: (tilted(t), np.zeros(3)))
    contact = sim.ConstraintContact((sim.Pairing(sim.boundary_surface(mesh), plate),), friction=2.0)
    system = system_of(mesh, contact, sim.Gravity((0.0, 0.0, -9.81)))
    for state in moved(system, sim.ConvergedEuler(), 20, h=H)[1:]:
        memory = state.memory[CONTACT_MEMORY]
        stored = memory[np.linalg.norm(memory[:, DIRECTION], axis=1) > 0.0, DIRECTION]
        up = stored[stored @ UP > 0.5]
        assert len(up) == 4
        np.testing.assert_allclose(up, np.tile(tilted(state.t) @ UP, (4, 1)), atol=1e-6)


@pytest.fixture
def stacked():
    """A small block on a larger one, and their contact."""
    low, high = grid((2, 2, 1), (0.02, 0.02, 0.01)), grid((1, 1, 1), (0.01, 0.01, 0.01))
    mesh, *surfaces = two_bodies(low, high, [0.004, 0.003, 0.01])
    return mesh, system_of(mesh, sim.ConstraintContact((sim.Pairing(*surfaces),)))


def started(system, q, direction, v=0.0):
    """Initial state with given contact normals of all vertices."""
    state = system.rest_state()
    memory = np.zeros_like(system.contact.remembered(state.memory, state.q, 0.0))
    memory[:, DIRECTION] = direction
    velocity = np.broadcast_to(v, q.shape).copy()
    return replace(state, q=q, v=velocity, memory={**state.memory, CONTACT_MEMORY: memory})


def first_rows(system, state, h=H, **kind):
    step = ContactStep(system.contact, state, state.t + h, **kind)
    return step.at_start(np.zeros(len(state.q)))


def upward(rows):
    return rows.take(np.flatnonzero(rows.normal @ UP > 0.5))


def test_normals_rotate_with_a_face_of_the_mesh(stacked):
    mesh, system = stacked
    R = rotation(3)
    step = ContactStep(system.contact, started(system, mesh.X, 0.0), H)
    rows = step.at_start(np.zeros(mesh.n_nodes))
    multipliers = step.multipliers(rows, np.ones(len(rows)))
    q, push = mesh.X @ R.T, np.arange(len(rows)) % 2.0
    acting = replace(multipliers.at(q - mesh.X), force=push)
    memory = step.memory(q, step.at(q), multipliers, acting)[CONTACT_MEMORY]
    expected = push[:, None] * (rows.normal @ R.T)
    np.testing.assert_allclose(memory[rows.contact_vertex, DIRECTION], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("slide", "share"),
    [(0.0, H / NORMAL_FILTER_TIME), (0.5, H / NORMAL_FILTER_TIME + 0.5), (1.0, 1.0), (9.0, 1.0)],
)
def test_normals_are_filtered_at_rest_and_follow_sliding_vertices(stacked, slide, share):
    mesh, system = stacked
    before = tilted(0.3) @ UP
    v = np.zeros_like(mesh.X)
    v[-8:, 0] = slide * ContactTolerances().slide / H
    rows = upward(first_rows(system, started(system, mesh.X, before, v)))
    expected = share * UP + (1.0 - share) * before
    assert len(rows)
    np.testing.assert_allclose(
        rows.normal, np.tile(expected / np.linalg.norm(expected), (len(rows), 1)), atol=1e-12
    )


def test_the_normal_of_another_wall_is_not_filtered(stacked):
    mesh, system = stacked
    rows = upward(first_rows(system, started(system, mesh.X, tilted(1.2) @ UP)))
    assert len(rows)
    np.testing.assert_allclose(rows.normal, np.tile(UP, (len(rows), 1)), atol=1e-12)


def test_normals_are_not_filtered_in_equilibrium(stacked):
    mesh, system = stacked
    state = started(system, mesh.X, tilted(0.3) @ UP)
    rows = upward(first_rows(system, state, equilibrium=True))
    assert len(rows)
    np.testing.assert_allclose(rows.normal, np.tile(UP, (len(rows), 1)), atol=1e-12)
