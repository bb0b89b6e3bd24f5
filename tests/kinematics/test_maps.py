"""Maps between coordinates and points compared with their definitions."""

from dataclasses import replace

import numpy as np
import pytest

import sim
from sim.embedding import Embedding
from sim.kinematics import rotations
from tests.bodies import grid, solid_system
from tests.kinematics.scenes import (
    BOX,
    INERTIA,
    dense,
    dense_points,
    dense_rows,
    mixed_system,
    random_pose,
    swing,
)

SYSTEM = mixed_system()
MAPS = SYSTEM.kinematics


def test_displacements_are_the_derivative_of_the_points_and_forces_its_transpose():
    pose, _ = random_pose(SYSTEM)
    R, size = dense_rows(SYSTEM, pose), 1e-6
    for i in range(SYSTEM.pattern.n):
        step = np.zeros(SYSTEM.pattern.n)
        step[i] = size
        ends = (MAPS.advance(pose, s * step, pose.t).q for s in (1.0, -1.0))
        slope = (next(ends) - next(ends)).ravel() / (2.0 * size)
        assert np.abs(slope - R[:, i]).max() < 1e-8
    f = np.random.default_rng(3).normal(size=pose.q.shape)
    np.testing.assert_allclose(MAPS.generalised_force(f, pose), R.T @ f.ravel(), atol=1e-12)


def test_between_is_the_inverse_of_advance():
    rest = SYSTEM.rest_state().pose
    pose, d = random_pose(SYSTEM)
    np.testing.assert_allclose(MAPS.between(rest, pose), d, atol=1e-15)


def test_velocities_of_points_are_the_rate_of_their_positions():
    """v = R w + gamma, including prescribed motion."""
    pose, _ = random_pose(SYSTEM)
    w = np.random.default_rng(1).normal(size=SYSTEM.pattern.n)
    state, h = MAPS.state(pose, w, {}), 1e-5
    later, sooner = (MAPS.advance(pose, s * h * w, pose.t + s * h) for s in (1.0, -1.0))
    np.testing.assert_allclose(state.v, (later.q - sooner.q) / (2.0 * h), rtol=1e-5, atol=1e-7)
    np.testing.assert_array_equal(MAPS.velocities(state), w)
    assert np.abs(MAPS.drift(pose, pose.t)).max() > 0.1  # The prescribed body moves.


def test_generalised_matrix_is_the_congruence_less_the_rotation_of_lever_arms():
    """R'KR on its fixed pattern; the difference is the second derivative of the energy of dead loads."""
    pose, _ = random_pose(SYSTEM)
    rng, R = np.random.default_rng(2), dense_rows(SYSTEM, pose)
    K = rng.normal(size=SYSTEM.point_pattern.nnz)
    expected = R.T @ dense_points(SYSTEM, K) @ R
    matrix = dense(SYSTEM, MAPS.generalised_matrix(K, None, pose))
    np.testing.assert_allclose(matrix, expected, atol=1e-12 * np.abs(expected).max())

    f, none, size = rng.normal(size=pose.q.shape), np.zeros_like(K), 1e-5
    turning = dense(SYSTEM, MAPS.generalised_matrix(none, f, pose))
    assert np.abs(turning).max() > 1e-3
    for i in range(MAPS.first, SYSTEM.pattern.n):
        step = np.zeros(SYSTEM.pattern.n)
        step[i] = size

        def slope(d):
            return -MAPS.gradient(MAPS.generalised_force(f, MAPS.advance(pose, d, pose.t)), d)

        bend = (slope(step) - slope(-step)) / (2.0 * size)
        np.testing.assert_allclose(bend, turning[i], atol=1e-8)


def test_mass_is_that_of_points_and_bodies():
    pose, _ = random_pose(SYSTEM)
    w = np.random.default_rng(4).normal(size=SYSTEM.pattern.n)
    R = dense_rows(SYSTEM, pose)
    M = R.T @ (np.repeat(SYSTEM.node_mass, 3)[:, None] * R)
    Q = rotations.matrices(pose.frames[:1, 3:])[0]
    start = MAPS.first
    M[start + 3 :, start + 3 :] += Q @ INERTIA @ Q.T
    values = np.zeros(SYSTEM.pattern.nnz)
    MAPS.add_mass(values, pose)
    np.testing.assert_allclose(dense(SYSTEM, values), M, atol=1e-15)
    np.testing.assert_allclose(MAPS.apply_mass(w, pose), M @ w, atol=1e-15)
    np.testing.assert_allclose(MAPS.solve_mass(M @ w, pose), w, rtol=1e-9, atol=1e-9)


def test_inertial_forces_are_the_rate_of_momentum_at_constant_velocity():
    """R'd(u)/dt = M dw/dt + b, so b is the projected rate of u while w is constant."""
    pose, _ = random_pose(SYSTEM)
    w = np.random.default_rng(5).normal(size=SYSTEM.pattern.n) * 0.1
    h = 1e-4
    u = [MAPS.inertial(w, MAPS.advance(pose, s * h * w, pose.t + s * h)) for s in (1.0, -1.0)]
    expected = MAPS.momentum((u[0] - u[1]) / (2.0 * h), pose)
    b = MAPS.inertial_force(MAPS.state(pose, w, {}))
    np.testing.assert_allclose(b, expected, atol=1e-6 * np.abs(expected).max())


def work_of_an_attached_node():
    """Virtual work of a force on a node in an element, and of the forces on what holds it."""
    pose, _ = random_pose(SYSTEM)
    f = np.zeros_like(pose.q)
    node = 12  # the first node of the second box, attached to an element
    f[node] = 1.0, 2.0, 3.0
    rng = np.random.default_rng(6)
    d = rng.normal(size=SYSTEM.pattern.n)
    work = float(f[node] @ MAPS.displacements(d, pose)[node])
    return work, MAPS.generalised_force(f, pose), d


def test_node_in_an_element_loads_its_nodes_by_the_shape_functions():
    """A force on the attached node acts on its holders, also through the body."""
    work, loads, d = work_of_an_attached_node()
    assert float(loads @ d) == pytest.approx(work, rel=1e-12)
    assert np.abs(loads[MAPS.first :]).max() > 0.1


def test_cycles_and_double_members_are_refused_by_name():
    mesh = grid((1, 1, 1))
    one = np.ones((1, 1))

    def attached(a, b):
        return sim.InElement(np.array([a]), Embedding(np.zeros(1, int), np.array([[b]]), one))

    with pytest.raises(sim.SceneError, match=r"cycle: node 0 \(InElement\) -> node 3 .* -> node 0"):
        solid_system(mesh, reductions=(attached(0, 3), attached(3, 0)))
    body = sim.Body("jaw", 0.1, INERTIA)
    with pytest.raises(sim.SceneError, match=r"node 0 is held by Fixed and by OnBody\('jaw'\)"):
        both = sim.Fixed(np.array([0])), sim.OnBody("jaw", np.array([0]))
        solid_system(mesh, reductions=both, bodies=(body,))
    with pytest.raises(sim.SceneError, match="no body is called 'chin'"):
        solid_system(mesh, reductions=(sim.OnBody("chin", np.array([0])),), bodies=(body,))
    with pytest.raises(sim.SceneError, match="free node 8 has no mass"):
        solid_system(mesh, points=np.zeros((1, 3)))
    with pytest.raises(sim.SceneError, match="two prescribed motions"):
        twice = (sim.PrescribedBody("jaw", swing), sim.PrescribedBody("jaw"))
        solid_system(mesh, reductions=twice, bodies=(body,))


def test_nodes_may_begin_elsewhere_on_a_body_than_at_rest():
    """A box whose end is attached 1 mm away moves there without stress and follows the body."""
    mesh = grid((2, 1, 1), BOX)
    left, shift = np.flatnonzero(mesh.X[:, 0] == 0.0), np.array([1e-3, 0.0, 2e-3])
    attached = sim.OnBody("jaw", left, mesh.X[left] + shift)
    scene = sim.Scene(
        mesh,
        (sim.Solid(),),
        (attached, sim.PrescribedBody("jaw")),
        sim.RestRayleigh(0.0, 0.05),
        bodies=(sim.Body("jaw", centre=(0.0, 0.0, 0.0)),),
    )
    system = sim.compile_scene(scene)
    start = system.rest_state()
    np.testing.assert_allclose(start.q[left], mesh.X[left] + shift, atol=1e-15)
    _, end = sim.simulate(system, sim.resting(0), duration=1.0, integrator=sim.ConvergedEuler())
    np.testing.assert_allclose(end.q[: mesh.n_nodes], mesh.X + shift, atol=1e-6)
    with pytest.raises(sim.SceneError, match=r"places have shape \(1, 3\), expected \(4, 3\)"):
        sim.compile_scene(replace(scene, reductions=(sim.OnBody("jaw", left, shift[None]),)))
