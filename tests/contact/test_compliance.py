"""Rows in the space of their directions, against dense matrices and against rows in the matrix."""

import numpy as np
import pytest

import sim
from sim.contact.compliance import AT_ONCE, Compliance, Directions, solved_with_rows
from sim.contact.rows import Rows
from sim.integrators import contact_converged
from sim.linear import FACTORS, linear_solver, pardiso_is_available, symmetric_product
from tests.bodies import grid
from tests.contact.scenes import box, moved, system_of, two_bodies

DEFINITE = [
    pytest.param(
        name,
        marks=pytest.mark.skipif(
            "pardiso" in name and not pardiso_is_available(), reason="pypardiso is not installed"
        ),
    )
    for name in FACTORS
]
SCALE = 1e-4


def block(n=(3, 3, 3)):
    """A held block and the matrix of a step, as values and whole."""
    mesh = grid(n, (0.03, 0.03, 0.03), distort=0.2)
    held = sim.Fixed(np.flatnonzero(mesh.X[:, 2] < 1e-9))
    system = system_of(mesh, reductions=(held,))
    K = system.tangent(mesh.X, system.control(np.zeros(0)))[1]
    A = SCALE * K
    A[system.pattern.diagonal] += system.mass
    whole = np.stack([symmetric_product(system.pattern, A, e) for e in np.eye(len(system.mass))])
    return mesh, system, A, whole


def rows_of(mesh, k, rng):
    """Vertices anywhere against faces anywhere, the last a rigid one."""
    nodes = np.array([rng.permutation(mesh.n_nodes)[:4] for _ in range(k)])
    weight = np.c_[np.ones(k), -rng.dirichlet(np.ones(3), k)]
    nodes[-1], weight[-1, 1:] = mesh.n_nodes - 1, 0.0
    normal = rng.normal(size=(k, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    zero = np.zeros(k)
    index = np.arange(k)
    return Rows(index, index, nodes, weight, normal, zero, np.zeros((k, 3)), zero, 0 * index)


def spread(rows, n_nodes):
    """Motion of every row (3 k, 3 n_nodes) by nodal displacements."""
    units = np.eye(3 * n_nodes).reshape(-1, n_nodes, 3)
    return np.stack([rows.displacement(u).ravel() for u in units], axis=1)


@pytest.mark.parametrize("name", DEFINITE)
def test_several_right_hand_sides_at_once_are_solved_as_one_by_one(name):
    _, system, A, whole = block()
    factor = linear_solver(name)
    factor.analyse(system.pattern)
    factor.factorise(A)
    rhs = np.random.default_rng(0).normal(size=(5, len(whole)))
    expected = np.linalg.solve(whole, rhs.T).T
    known = 1e-4 if "single" in name else 1e-10
    for _ in range(2):
        got = factor.approximate_many(rhs)
        assert np.abs(got - expected).max() < known * np.abs(expected).max()
        assert np.abs(got[3] - factor.approximate(rhs[3])).max() < known * np.abs(expected).max()


@pytest.mark.parametrize("share", [0.0, 0.6, 1.0])
def test_rows_are_solved_as_in_a_dense_matrix(share):
    mesh, system, _, whole = block()
    rng = np.random.default_rng(1)
    rows = rows_of(mesh, 12, rng)
    stiffness = np.where(rng.permutation(12) < 12 * share, 10.0 ** rng.uniform(2, 7, size=12), 0.0)
    rhs = rng.normal(size=len(whole))
    G = spread(rows, mesh.n_nodes)[:, system.free].reshape(12, 3, -1)
    N = np.einsum("ki,kin->kn", rows.normal, G)
    expected = np.linalg.solve(whole + SCALE * N.T @ np.diag(stiffness) @ N, rhs)
    directions = Directions.of(system.pattern, rows, stiffness)
    assert len(directions.stiffness) == np.count_nonzero(stiffness)
    compliance = Compliance(len(whole), lambda b: np.linalg.solve(whole, b.T).T)
    x = solved_with_rows(rhs, directions, SCALE, compliance, lambda b: np.linalg.solve(whole, b))
    np.testing.assert_allclose(x, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


def test_rows_that_repeat_each_other_are_solved():
    mesh, system, _, whole = block()
    rows = rows_of(mesh, 4, np.random.default_rng(2))
    twice = rows.joined(rows)
    stiffness = np.full(len(twice), 1e12)
    rhs = np.ones(len(whole))
    directions = Directions.of(system.pattern, twice, stiffness)
    compliance = Compliance(len(whole), lambda b: np.linalg.solve(whole, b.T).T)
    x = solved_with_rows(rhs, directions, 1.0, compliance, lambda b: np.linalg.solve(whole, b))
    assert (
        np.abs(directions.D @ x).max()
        < 1e-9 * np.abs(directions.D @ np.linalg.solve(whole, rhs)).max()
    )


def test_compliance_is_found_once_per_unknown():
    mesh, system, _, whole = block((5, 5, 2))
    asked = []

    def solve_many(rhs):
        asked.append(len(rhs))
        return np.linalg.solve(whole, rhs.T).T

    compliance = Compliance(len(whole), solve_many)
    rng, inverse = np.random.default_rng(3), np.linalg.inv(whole)
    for k in (3, 3, 40):
        D = Directions.of(system.pattern, rows_of(mesh, k, rng), np.ones(k)).D
        expected = D @ (D @ inverse).T
        np.testing.assert_allclose(
            compliance.between(D), expected, rtol=0, atol=1e-9 * np.abs(expected).max()
        )
    assert sum(asked) <= len(whole)
    assert max(asked) <= AT_ONCE
    before = len(asked)
    compliance.between(D)
    assert len(asked) == before


def test_rows_apart_and_rows_in_the_matrix_lead_to_the_same_motion(monkeypatch):
    """A block that falls on a softer one which lies on a floor."""
    mesh, *surfaces = two_bodies(
        grid((3, 3, 2), (0.03, 0.03, 0.02)),
        grid((2, 2, 2), (0.02, 0.02, 0.02)),
        [0.004, 0.003, 0.0202],
    )
    floor = sim.Pairing(surfaces[0], box([-0.1, -0.1, -0.01], [0.1, 0.1, 0.0]))
    contact = sim.ConstraintContact((sim.Pairing(*surfaces), floor))
    system = system_of(mesh, contact, sim.Gravity((0.5, 0.0, -9.81)))
    ends = []
    for most in (contact_converged.MOST, -1):
        monkeypatch.setattr(contact_converged, "MOST", most)
        ends.append(moved(system, sim.ConvergedEuler(), 12, h=0.005)[-1].q)
    assert np.abs(ends[0] - mesh.X).max() > 5e-4
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-5)


def test_a_step_may_change_from_the_one_to_the_other(monkeypatch):
    mesh = grid((2, 2, 2), (0.02, 0.02, 0.02))
    contact = sim.ConstraintContact(
        (sim.Pairing(sim.boundary_surface(mesh), box([-0.1, -0.1, -0.01], [0.1, 0.1, 0.0])),)
    )
    system = system_of(mesh, contact, sim.Gravity((0.0, 0.0, -9.81)))
    work, state, control = sim.Workspace(system), system.rest_state(), system.control(np.zeros(0))
    for most, within in ((800, False), (-1, True), (800, False)):
        monkeypatch.setattr(contact_converged, "MOST", most)
        state, report = sim.ConvergedEuler().step(system, state, control, 0.01, work)
        assert work.rows_in_factor is within
        assert report.factorisations >= 1
    assert abs(state.q[:, 2].min()) < 1e-5


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_rows_that_rub_are_in_the_matrix(friction):
    mesh = grid((1, 1, 1), (0.02, 0.02, 0.02))
    floor = box([-0.1, -0.1, -0.01], [0.1, 0.1, 0.0])
    pairing = sim.Pairing(sim.boundary_surface(mesh), floor)
    system = system_of(mesh, sim.ConstraintContact((pairing,), friction=friction))
    work = sim.Workspace(system)
    sim.ConvergedEuler().step(system, system.rest_state(), system.control(np.zeros(0)), 0.01, work)
    assert work.rows_in_factor is (friction > 0.0)
