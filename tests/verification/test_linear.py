"""Linear solvers that reuse factors: single precision, older factors, factors of similar systems."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest

import sim
from sim.linear import (
    ITERATIVE_SOLVERS,
    NotPositiveDefinite,
    Pardiso,
    SinglePardiso,
    linear_solver,
    pardiso_is_available,
    symmetric_product,
)
from sim.linear.equations import Equations
from sim.linear.krylov import gmres
from sim.linear.reused import EXTRA_SOLUTIONS, NEARLY_SINGULAR
from tests.bodies import boundary, crossed_muscles, grid

needs_pardiso = pytest.mark.skipif(
    not pardiso_is_available(), reason="pypardiso is not installed for this platform"
)
FAMILIES = [
    pytest.param(name, marks=needs_pardiso) if "pardiso" in name else name
    for name in ITERATIVE_SOLVERS
]
MESH = grid((4, 4, 4), distort=0.2)
FIXED_BASE = sim.Fixed(np.flatnonzero(MESH.X[:, 2] < 1e-9))


def body(volume=None, sigma_max=50e3):
    bulk = sim.LogarithmicBulk() if volume is None else sim.QuadraticBulk(0.0)
    muscles = crossed_muscles(MESH, sim.Blemker(sigma_max))
    solid = sim.Solid((sim.Material(bulk=bulk),), muscles=muscles)
    terms = (solid,) if volume is None else (solid, volume)
    return sim.compile_scene(sim.Scene(MESH, terms, (FIXED_BASE,), sim.Rayleigh()))


def step_matrix(system, q=None, activation=0.0, h=0.01):
    q = system.scene.mesh.X if q is None else q
    control = system.control(np.full(len(system.muscles), activation))
    K = system.tangent(q, control)[1]
    A = h * system.damping(q, control, K) + h * h * K
    A[system.pattern.diagonal] += system.mass
    return A


def moved(amount, seed=0):
    q = MESH.X.copy()
    inner = np.setdiff1d(np.arange(MESH.n_nodes), boundary(MESH))
    q[inner] += amount * np.random.default_rng(seed).normal(size=(len(inner), 3))
    return q


def dense(pattern, values):
    return np.stack([symmetric_product(pattern, values, e) for e in np.eye(pattern.n)])


@needs_pardiso
def test_a_factor_in_single_precision_is_refined_to_double():
    system = body()
    A, rhs = step_matrix(system), np.random.default_rng(0).normal(size=system.pattern.n)
    single, double = SinglePardiso(), Pardiso()
    for solver in (single, double):
        solver.analyse(system.pattern)
        solver.factorise(A)
    expected = double.solve(rhs)
    size = np.abs(expected).max()
    assert np.abs(single.solve(rhs) - expected).max() < 1e-12 * size
    once = np.abs(single.approximate(rhs) - expected).max()
    assert 1e-9 * size < once < 1e-3 * size  # the factor is in single precision
    assert single.factor_bytes * 2 == double.factor_bytes


@needs_pardiso
def test_matrices_too_ill_conditioned_for_single_precision_are_factorised_in_double():
    system = body()
    A = np.zeros(system.pattern.nnz)
    A[system.pattern.diagonal] = 1.0
    first = slice(system.pattern.indptr[0], system.pattern.indptr[1])
    A[first.start + 1] = 1.0 - 1e-9  # two unknowns, nearly the same: 1 - (1 - 1e-9)^2 is lost
    solver = SinglePardiso()
    solver.analyse(system.pattern)
    solver.factorise(A)
    rhs = np.zeros(system.pattern.n)
    rhs[0] = 1.0
    x = solver.solve(rhs)
    np.testing.assert_allclose(x[0], 1.0 / (1.0 - (1.0 - 1e-9) ** 2), rtol=1e-6)
    assert solver.factor_bytes % 8 == 0
    with pytest.raises(sim.SingularSystem):
        solver.factorise(-A)


def test_gmres_solves_an_indefinite_system_by_a_definite_preconditioner():
    rng = np.random.default_rng(3)
    n = 60
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    eigenvalues = rng.uniform(1.0, 2.0, n)
    P = (Q * eigenvalues) @ Q.T
    eigenvalues[:2] = -0.3
    A = (Q * eigenvalues) @ Q.T
    x = rng.normal(size=n)
    solution = gmres(A.__matmul__, lambda r: np.linalg.solve(P, r), A @ x, np.zeros(n), 1e-11, 60)
    assert solution.reached
    # three distinct eigenvalues of P^-1 A: three solutions per cycle end it
    assert solution.iterations <= 12
    assert np.abs(solution.x - x).max() < 1e-9
    stopped = gmres(A.__matmul__, lambda r: 0.1 * r, A @ x, np.zeros(n), 1e-14, 5)
    assert not stopped.reached and stopped.iterations <= 5


@pytest.mark.parametrize("name", FAMILIES)
def test_an_older_factor_is_used_until_a_new_one_costs_less(name):
    system = body()
    solver, rhs = linear_solver(name), np.random.default_rng(0).normal(size=system.pattern.n)
    solver.analyse(system.pattern)
    error = 1e-6
    made, spent = [], []
    for k in range(12):
        A = step_matrix(system, moved(1e-5 * k), 0.01 * k)
        solver.factorise(A)
        expected = np.linalg.solve(dense(system.pattern, A), rhs)
        size = np.abs(expected).max()
        x = solver.solve(rhs, error=error * size)
        assert np.abs(x - expected).max() < 5 * error * size
        made.append(solver.factorisations)
        spent.append(solver.iterations)
    assert made[0] == 1 and made[1] == 0  # A factor of a similar matrix is reused.
    assert spent[0] <= 3 < max(spent) <= 3 + EXTRA_SOLUTIONS + 3
    assert 2 <= sum(made) <= 6
    # The factor is not reused for an unrelated matrix.
    solver.factorise(step_matrix(system, moved(1e-3, seed=1), 1.0, h=1.0))
    solver.solve(rhs, error=error * size)
    solver.factorise(A)
    x = solver.solve(rhs, error=error * size)
    assert np.abs(x - expected).max() < 5 * error * size


@pytest.mark.parametrize("name", FAMILIES)
def test_an_indefinite_matrix_is_solved_without_a_shift(name):
    system = body()
    A = step_matrix(system)
    A[system.pattern.diagonal[:2]] *= -1.0
    rhs = np.ones(system.pattern.n)
    solver = linear_solver(name)
    solver.analyse(system.pattern)
    for scale in (1.0, 1.001):  # the second by the factor of the first
        solver.factorise(scale * A)
        expected = np.linalg.solve(scale * dense(system.pattern, A), rhs)
        assert not np.linalg.eigvalsh(dense(system.pattern, A)).min() > 0.0
        size = np.abs(expected).max()
        assert np.abs(solver.solve(rhs, error=1e-8 * size) - expected).max() < 1e-7 * size
        # not available from SuperLU
        assert not solver.definite
    assert solver.factorisations == 0
    with pytest.raises(sim.SingularSystem, match="NaN"):
        solver.factorise(np.full_like(A, np.nan))


def end_of(system, integrator, linear, steps=8):
    ramp = sim.Activation(np.array([0.0, 0.05]), np.array([[0.0, 0.0], [0.5, 0.2]]))
    trajectory, state = sim.simulate(
        system,
        ramp,
        duration=0.01 * steps,
        integrator=integrator,
        probes=(sim.Iterations(),),
        work=sim.Workspace(system, linear),
    )
    return state, trajectory


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize("volume", [None, sim.NodalVolume(25e3)], ids=["pointwise", "nodal"])
@pytest.mark.parametrize("cls", [sim.LinearlyImplicitEuler, sim.LinearlyImplicitTrapezoidal])
def test_linearly_implicit_steps_by_an_older_factor_are_those_of_a_direct_solution(
    cls, volume, name
):
    system = body(volume)
    exact, _ = end_of(system, cls(), "superlu")
    size = np.abs(exact.q - MESH.X).max()
    for tolerance in (1e-6, 1e-9):
        state, trajectory = end_of(system, cls(tolerance=tolerance), name)
        # the sum of the errors of a few steps
        assert np.abs(state.q - exact.q).max() < 5.0 * tolerance < size
    assert trajectory.factorisations.sum() < 8
    again, _ = end_of(system, cls(tolerance=tolerance), name)
    np.testing.assert_array_equal(again.q, state.q)


@pytest.mark.parametrize("name", FAMILIES)
def test_converged_steps_with_matrix_free_products_equal_assembled_ones(name):
    system = body(sim.NodalVolume(25e3))
    assert system.sparse is not None
    assert system.sparse.pattern.nnz < system.pattern.nnz
    integrator = sim.ConvergedEuler(tolerance=1e-9, residual_tolerance=1e-7)
    exact, _ = end_of(system, integrator, "superlu")
    state, trajectory = end_of(system, integrator, name)
    assert np.abs(state.q - exact.q).max() < 5e-9
    assert trajectory.factorisations.sum() < trajectory.iterations.sum() / 5


def test_only_terms_that_couple_many_nodes_have_matrix_free_products():
    assert body().sparse is None
    assert body(sim.ElementVolume(25e3)).sparse is None
    hard = replace(body(sim.NodalVolume(25e3)).scene, constraints=(sim.HardElementVolume(),))
    assert sim.compile_scene(hard).sparse is None


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize(
    "integrator",
    [
        sim.LinearlyImplicitEuler(tolerance=1e-10),
        sim.ConvergedEuler(tolerance=1e-9, residual_tolerance=1e-8),
    ],
    ids=["one", "all"],
)
def test_hard_volumes_with_an_older_factor_are_those_of_a_saddle_factor_a_step(integrator, name):
    scene = replace(body(sim.ElementVolume(25e3)).scene, constraints=(sim.HardElementVolume(),))
    system = sim.compile_scene(scene)
    exact, _ = end_of(system, integrator, "superlu")
    state, trajectory = end_of(system, integrator, name)
    assert np.abs(exact.q - MESH.X).max() > 1e-3
    assert np.abs(state.q - exact.q).max() < 5e-9
    assert trajectory.factorisations.sum() < trajectory.iterations.sum() / 2
    ended, _ = system.constraints.evaluate(state.pose)
    cell = 1.0 / 64 * np.ptp(MESH.X, axis=0).prod()
    limit = 1e-7 if isinstance(integrator, sim.ConvergedEuler) else 1e-3
    assert np.abs(ended).max() < limit * cell


@pytest.mark.parametrize("name", ["gmres_superlu", "superlu"])
def test_an_unreferenced_workspace_is_freed_at_once(name):
    """In a reference cycle, factors of hundreds of megabytes would wait for garbage collection."""
    system = body()
    work = sim.Workspace(system, name)
    control = system.control(np.full(len(system.muscles), 0.1))
    sim.LinearlyImplicitEuler().step(system, system.rest_state(), control, 0.01, work)
    known = weakref.ref(work)
    gc.disable()
    try:
        del work
        assert known() is None
    finally:
        gc.enable()


def softened(system, share):
    """Matrix of a step, minus a multiple of its smallest eigenvalue in all directions."""
    A = step_matrix(system)
    least = np.linalg.eigvalsh(dense(system.pattern, A))[0]
    B = A.copy()
    B[system.pattern.diagonal] -= share * least
    return A, B


@pytest.mark.parametrize(
    "name", ["superlu", pytest.param("pardiso", marks=needs_pardiso), *FAMILIES]
)
def test_every_solver_detects_whether_a_matrix_is_positive_definite(name):
    """The smallest eigenvalue is zero between the factors 0.99 and 1.01."""
    system = body()
    rhs = np.random.default_rng(0).normal(size=system.pattern.n)
    for share, definite in ((0.99, True), (1.01, False)):
        _, B = softened(system, share)
        solver = linear_solver(name)
        solver.analyse(system.pattern)
        if name in ITERATIVE_SOLVERS:
            solver.factorise(B)
            x = solver.solve(rhs, np.zeros(len(rhs)), 1e-9)
            assert solver.definite is definite
            np.testing.assert_allclose(x, np.linalg.solve(dense(system.pattern, B), rhs), rtol=1e-4)
        elif definite:
            solver.factorise(B)
        else:
            with pytest.raises(NotPositiveDefinite):
                solver.factorise(B)


@pytest.mark.parametrize("name", FAMILIES)
def test_an_older_factor_does_not_hide_that_a_matrix_has_become_indefinite(name):
    """The estimated error of an older factor is too small if the matrix is soft."""
    system = body()
    rhs = np.random.default_rng(0).normal(size=system.pattern.n)
    for share, definite in ((0.9, True), (0.999, True), (1.01, False), (1.5, False)):
        A, B = softened(system, share)
        solver = linear_solver(name)
        solver.analyse(system.pattern)
        solver.factorise(A)
        start = solver.solve(rhs, np.zeros(len(rhs)), 1e-9)
        assert solver.definite
        error = 1e-3 * np.abs(start).max()
        solver.factorise(B)
        x = solver.solve(rhs, start, error)
        assert solver.definite is definite
        expected = np.linalg.solve(dense(system.pattern, B), rhs)
        # P^-1 r estimates it, and A is at least NEARLY_SINGULAR times as stiff as P
        assert np.abs(x - expected).max() < error / NEARLY_SINGULAR


@pytest.mark.parametrize("name", FAMILIES)
def test_equations_hold_exactly_and_cost_no_new_factor(name):
    """A x = r + G'mu with G x = b against the full saddle system, by the factor of a similar matrix."""
    system, rng = body(), np.random.default_rng(3)
    control, X = system.control(np.zeros(len(system.muscles))), MESH.X
    first, A = (system.tangent(q, control)[1] for q in (X, X * [1.0002, 0.9999, 1.0]))
    solver, r = linear_solver(name), rng.normal(size=system.pattern.n)
    solver.analyse(system.pattern)
    solver.factorise(first)
    solver.solve(r)
    under = Equations(np.array([4, 17, 90]), rng.normal(size=(2, 3)), rng.normal(size=2))
    G = np.zeros((2, len(r)))
    G[:, under.columns] = under.G
    saddle = np.block([[dense(system.pattern, A), -G.T], [G, np.zeros((2, 2))]])
    expected = np.linalg.solve(saddle, np.r_[r, under.b])
    solver.factorise(A)
    x = solver.solve(r, error=1e-6 * np.abs(expected[:-2]).max(), under=under)
    assert solver.factorisations == 0
    np.testing.assert_allclose(G @ x, under.b, rtol=1e-12)
    np.testing.assert_allclose(x, expected[:-2], atol=1e-5 * np.abs(x).max())
    mu = under.multipliers(symmetric_product(system.pattern, A, x) - r)
    np.testing.assert_allclose(mu, expected[-2:], rtol=1e-3)
    some = solver.roughly(np.stack([r, -r]), under)
    np.testing.assert_allclose(some @ G.T, 0.0, atol=1e-12 * np.abs(some).max())
