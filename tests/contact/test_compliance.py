"""Contact forces by the Schur complement, compared with dense and with assembled matrices."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import nnls

import sim
import sim.integrators.factor
from sim.contact import cone
from sim.contact.compiled import CONTACT_MEMORY, FORCE
from sim.contact.compliance import COLUMNS_AT_ONCE, KNOWN, LEARNT, Compliance, DelassusMatrix
from sim.contact.cone import solve_lcp
from sim.contact.rows import ContactRows, directions
from sim.integrators.factor import LBFGS, CompactBFGS
from sim.integrators.workspace import ContactMemory
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
    """A fixed block and the matrix of a step, as values and dense."""
    mesh = grid(n, (0.03, 0.03, 0.03), distort=0.2)
    fixed = sim.Fixed(np.flatnonzero(mesh.X[:, 2] < 1e-9))
    system = system_of(mesh, reductions=(fixed,))
    K = system.tangent(mesh.X, system.control(np.zeros(0)))[1]
    A = SCALE * K
    A[system.pattern.diagonal] += system.mass
    whole = np.stack([symmetric_product(system.pattern, A, e) for e in np.eye(len(system.mass))])
    return mesh, system, A, whole


def rows_of(mesh, k, rng):
    """Rows of random vertices and faces, the last one rigid."""
    nodes = np.array([rng.permutation(mesh.n_nodes)[:4] for _ in range(k)])
    weight = np.c_[np.ones(k), -rng.dirichlet(np.ones(3), k)]
    nodes[-1], weight[-1, 1:] = mesh.n_nodes - 1, 0.0
    normal = rng.normal(size=(k, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    zero = np.zeros(k)
    index = np.arange(k)
    return ContactRows(
        index, index, 0 * index, nodes, weight, normal, zero, np.zeros((k, 3)), zero, 0 * index
    )


def spread(rows, n_nodes):
    """Relative displacement of every row (3 k, 3 n_nodes) by nodal displacements."""
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


def test_directions_are_those_of_the_gaps():
    mesh, system, _, _ = block()
    rows = rows_of(mesh, 12, np.random.default_rng(1))
    normals = spread(rows, mesh.n_nodes).reshape(12, 3, -1)
    expected = np.einsum("ki,kin->kn", rows.normal, normals)[:, system.free]
    np.testing.assert_allclose(
        directions(system.pattern, rows).toarray(), expected, rtol=0, atol=1e-15
    )


def compliance_of(whole, asked=None):
    """Compliance of a dense matrix; the numbers of right-hand sides are appended to `asked`."""

    def solve_many(rhs):
        if asked is not None:
            asked.append(len(rhs))
        return np.linalg.solve(whole, rhs.T).T

    return Compliance(len(whole), solve_many)


def test_compliance_is_found_once_per_unknown():
    mesh, system, _, whole = block((5, 5, 2))
    asked, rng, inverse = [], np.random.default_rng(3), np.linalg.inv(whole)
    compliance = compliance_of(whole, asked)
    for k in (3, 3, 40):
        D, other = (directions(system.pattern, rows_of(mesh, n, rng)) for n in (k, 5))
        expected = D @ (other @ inverse).T
        np.testing.assert_allclose(
            compliance.between(D, other), expected, rtol=0, atol=1e-9 * np.abs(expected).max()
        )
    assert sum(asked) <= len(whole)
    assert max(asked) <= COLUMNS_AT_ONCE
    before = len(asked)
    compliance.between(D, other)
    assert len(asked) == before


def test_the_delassus_matrix_equals_the_dense_one_also_between_other_rows():
    mesh, system, _, whole = block()
    rng, inverse = np.random.default_rng(4), np.linalg.inv(whole)
    D = directions(system.pattern, rows_of(mesh, 12, rng))
    other = directions(system.pattern, rows_of(mesh, 4, rng))
    rows = DelassusMatrix(D, compliance_of(whole))
    scale = np.abs(D @ (D @ inverse).T).max()
    for some in ([7, 2], [2, 5, 11, 0], [7], []):
        near = D[some]
        expected = near @ (near @ inverse).T
        got = rows.among(np.array(some, dtype=np.int64))
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9 * scale)
    every = np.concatenate([other.toarray(), D[[5, 3]].toarray()])
    got = rows.with_other_rows(other, np.array([5, 3]))
    np.testing.assert_allclose(got, every @ inverse @ every.T, rtol=0, atol=1e-9 * scale)


@pytest.mark.parametrize("answers", [3, 2 * LEARNT])
def test_the_compliance_is_updated_when_the_body_becomes_stiffer(answers):
    """All later products agree; it remains symmetric and positive definite."""
    mesh, system, _, whole = block()
    rng = np.random.default_rng(5)
    D = directions(system.pattern, rows_of(mesh, 9, rng))
    stiffer = 2.0 * whole + np.diag(rng.uniform(0.0, 3.0, len(whole)) * np.diag(whole))
    compliance, now = compliance_of(whole), np.linalg.inv(stiffer)
    rows = DelassusMatrix(D, compliance)
    every = np.arange(9)
    before = np.abs(rows.among(every) - D @ (D @ now).T).max()
    for _ in range(answers):
        f = rng.normal(size=9)
        motion = now @ (D.T @ f)
        rows.learn(f, motion)
        answer = D @ motion
        known = KNOWN * np.abs(answer).max()
        np.testing.assert_allclose(rows.among(every) @ f, answer, rtol=0, atol=known)
        again = DelassusMatrix(D, compliance).among(every)
        np.testing.assert_allclose(
            again, rows.among(every), rtol=0, atol=1e-9 * np.abs(again).max()
        )
    left = np.abs(again - D @ (D @ now).T).max()
    assert left < (0.9 if answers == 3 else 0.2) * before
    assert np.linalg.eigvalsh(again)[0] > 0.0
    # Columns computed only now are those of the initial body, with the same updates.
    more = directions(system.pattern, rows_of(mesh, 30, rng))
    assert np.isfinite(compliance.between(more, more)).all()


def test_known_or_zero_displacements_do_not_change_the_compliance():
    mesh, system, _, whole = block()
    D = directions(system.pattern, rows_of(mesh, 5, np.random.default_rng(6)))
    rows, inverse = DelassusMatrix(D, compliance_of(whole)), np.linalg.inv(whole)
    before, f = rows.among(np.arange(5)), np.ones(5)
    motion = inverse @ (D.T @ f)
    missed, size = rows.learn(f, motion)
    assert missed < 1e-9 * size
    assert rows.learn(np.zeros(5), np.zeros(len(whole))) == (0.0, 0.0)
    # A displacement against the force is not physical.
    assert rows.learn(f, -motion)[0] == pytest.approx(2.0 * size)
    np.testing.assert_array_equal(rows.among(np.arange(5)), before)


def positive(n, rng, condition=1e4):
    """A dense symmetric matrix with a given condition number."""
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    return (Q * np.geomspace(1.0, condition, n)) @ Q.T


@pytest.mark.parametrize("seed", range(20))
def test_active_contacts_are_found_from_any_initial_guess(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 40))
    G, c = positive(n, rng), rng.normal(size=n)
    for guess in (np.zeros(n, dtype=bool), np.ones(n, dtype=bool), rng.random(n) < 0.5):
        f = solve_lcp(G, c, guess)
        gap = G @ f + c
        assert f.min() >= 0.0
        assert gap.min() > -1e-8
        assert np.abs(f * gap).max() < 1e-8 * max(1.0, np.abs(f).max())


def test_a_cycling_active_set_ends_in_the_solution(monkeypatch):
    """Without any update of the active set, the least-squares method finds the solution."""
    rng = np.random.default_rng(1)
    G, c = positive(12, rng), rng.normal(size=12)
    expected = solve_lcp(G, c, c < 0.0)
    monkeypatch.setattr(cone, "CHANGES", 0)
    np.testing.assert_allclose(solve_lcp(G, c, c < 0.0), expected, atol=1e-8)
    L = np.linalg.cholesky(G)
    np.testing.assert_allclose(expected, nnls(L.T, -np.linalg.solve(L, c))[0], atol=1e-8)


def test_redundant_rows_share_the_contact_force():
    G = np.array([[1.0, 1.0], [1.0, 1.0]])
    for noise in (0.0, -1e-7):
        f = solve_lcp(G + noise * np.eye(2), np.array([-2.0, -2.0]), np.array([True, True]))
        assert f.min() >= 0.0
        assert f.sum() == pytest.approx(2.0, rel=1e-4)


def test_secants_of_an_inverse_are_those_of_the_recursion():
    """Byrd, Nocedal and Schnabel's sum against Nocedal and Wright's Algorithm 7.4."""
    rng = np.random.default_rng(2)
    n, size = 20, 5
    A, old = positive(n, rng, 10.0), positive(n, rng, 10.0)
    one, two = LBFGS(size), CompactBFGS(size)
    D = np.asarray(rng.normal(size=(3, n)))
    for _ in range(8):
        s = rng.normal(size=n)
        y = A @ s
        one.learn(s, y)
        two.learn(s, y, np.linalg.solve(old, y))
        g = rng.normal(size=n)
        expected = one.direction(g, lambda r: np.linalg.solve(old, r))
        got = -np.linalg.solve(old, g) - two.added(g)
        np.testing.assert_allclose(got, expected, atol=1e-9 * np.abs(expected).max())
        between = np.stack([D @ two.added(row) for row in D], axis=1)
        np.testing.assert_allclose(
            two.between(two.seen_by(D)), between, atol=1e-9 * np.abs(between).max()
        )
    two.learn(s, -y, -np.linalg.solve(old, y))
    np.testing.assert_array_equal(-np.linalg.solve(old, g) - two.added(g), got)
    two.clear()
    assert not two.added(g).any()
    assert not two.between(two.seen_by(D)).any()


@pytest.mark.parametrize("integrator", [sim.ConvergedEuler, sim.Sdirk2])
@pytest.mark.parametrize("friction", [0.0, 0.3, (0.0, 0.4)])
def test_schur_complement_and_assembled_rows_give_the_same_motion(
    monkeypatch, friction, integrator
):
    """A block falls on a softer one on a floor, along which both are pulled."""
    mesh, *surfaces = two_bodies(
        grid((3, 3, 2), (0.03, 0.03, 0.02)),
        grid((2, 2, 2), (0.02, 0.02, 0.02)),
        [0.004, 0.003, 0.0202],
    )
    floor = sim.Pairing(surfaces[0], box([-0.1, -0.1, -0.01], [0.1, 0.1, 0.0]))
    contact = sim.ConstraintContact((sim.Pairing(*surfaces), floor), friction=friction)
    system = system_of(mesh, contact, sim.Gravity((1.5, 0.0, -9.81)))
    ends = []
    for most in (sim.integrators.factor.MOST_APART, -1):
        monkeypatch.setattr(sim.integrators.factor, "MOST_APART", most)
        ends.append(moved(system, integrator(), 12, h=0.005)[-1].q)
    assert np.abs(ends[0] - mesh.X).max() > 5e-4
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-5)


@pytest.mark.parametrize(("h", "seed"), [(0.02, 3), (0.02, 5), (0.01, 8)])
def test_hard_landings_converge(h, seed):
    """Blocks in contact with ten to a hundred times their weight, in few long steps."""
    rng = np.random.default_rng(seed)
    mesh, *surfaces = two_bodies(
        grid((3, 2, 2), (0.03, 0.03, 0.02), distort=0.15),
        grid((2, 3, 2), tuple(rng.uniform(0.012, 0.028, 3)), distort=0.15),
        [*rng.uniform(0.0, 0.01, 2), 0.0205],
    )
    floor = sim.Pairing(surfaces[0], box([-0.1, -0.1, -0.01], [0.1, 0.1, -1e-4]))
    contact = sim.ConstraintContact((sim.Pairing(*surfaces), floor))
    pull = (*rng.uniform(-20.0, 20.0, 2), -98.1)
    system = system_of(mesh, contact, sim.Gravity(pull))
    for state in moved(system, sim.ConvergedEuler(), 10, h=h)[1:]:
        assert state.memory[CONTACT_MEMORY][:, FORCE].min() >= 0.0
        _, gap, _ = system.contact.measure(state)
        assert np.nanmin(gap) > -1e-5


def lying(friction=0.0, n=(2, 2, 2), *terms):
    """A block that is drawn down onto a floor."""
    mesh = grid(n, (0.02, 0.02, 0.02))
    floor = box([-0.1, -0.1, -0.01], [0.1, 0.1, 0.0])
    pairing = sim.Pairing(sim.boundary_surface(mesh), floor)
    contact = sim.ConstraintContact((pairing,), friction=friction)
    return system_of(mesh, contact, sim.Gravity((0.0, 0.0, -9.81)), *terms)


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("linear", ["auto", "superlu"])
def test_a_step_may_change_between_both_forms_of_contact(monkeypatch, linear, friction):
    system = lying(friction)
    work, state = sim.Workspace(system, linear), system.rest_state()
    control = system.control(np.zeros(0))
    for most, apart in ((800, True), (-1, False), (800, True)):
        monkeypatch.setattr(sim.integrators.factor, "MOST_APART", most)
        assert (work.form(system, state) is system) is apart
        state, report = sim.ConvergedEuler().step(system, state, control, 0.01, work)
        assert report.factorisations >= 1
    # An integrator with assembled rows can continue with the same memory.
    state, _ = sim.LinearlyImplicitEuler().step(system, state, control, 0.01, work)
    state, _ = sim.ConvergedEuler().step(system, state, control, 0.01, work)
    assert abs(state.q[:, 2].min()) < 1e-5


def test_rows_have_no_entries_in_the_matrix_of_a_step():
    """The matrix of two bodies is that without contact."""
    mesh, *surfaces = two_bodies(
        grid((2, 2, 2), (0.02, 0.02, 0.02)), grid((2, 2, 2), (0.02, 0.02, 0.02)), [0, 0, 0.0205]
    )
    without = system_of(mesh)
    system = system_of(mesh, sim.ConstraintContact((sim.Pairing(*surfaces),)))
    rubs = system_of(mesh, sim.ConstraintContact((sim.Pairing(*surfaces),), friction=0.3))
    for touching in (system, rubs):
        assert touching.with_rows is not None
        assert touching.with_rows.system.with_rows is None
        whole = touching.with_rows.system.pattern
        assert whole.nnz > touching.pattern.nnz == without.pattern.nnz
    assert without.with_rows is None
    # In equilibrium, assembled rows determine the contact forces.
    assert system.with_rows is not None
    assert sim.Workspace(system).form(system) is system.with_rows.system


def _of_constant_volume(tolerance=2e-3):
    """A block and a cube on it, both of constant volume, above a floor."""
    mesh = grid((2, 2, 2), (0.02, 0.02, 0.02))
    other = grid((1, 1, 1), (0.01, 0.01, 0.01))
    both, *surfaces = two_bodies(mesh, other, [0.004, 0.003, 0.0201])
    floor = sim.Pairing(surfaces[0], box([-0.1, -0.1, -0.01], [0.1, 0.1, 0.0]))
    contact = sim.ConstraintContact((sim.Pairing(*surfaces), floor), tolerance=tolerance)
    soft = system_of(both, contact, sim.Gravity((0.0, 0.0, -9.81))).scene
    return sim.compile_scene(replace(soft, constraints=(sim.HardElementVolume(),)))


@pytest.mark.parametrize("linear", ["auto", "superlu", "gmres_pardiso"])
def test_with_constraints_only_equilibria_have_rows_in_their_matrix(linear):
    """One workspace serves all methods, and the motion is that of separate ones."""
    system = _of_constant_volume()
    assert system.with_rows is not None
    work, state = sim.Workspace(system, linear), system.rest_state()
    assert work.form(system) is system.with_rows.system
    assert work.form(system, state) is work.form(system, state, rows_apart=True) is system
    for method in (sim.ConvergedEuler(), sim.LinearlyImplicitEuler(), sim.Sdirk2()) * 2:
        control = system.control(np.zeros(0))
        alone, _ = method.step(system, state, control, 0.005, sim.Workspace(system, linear))
        state, _ = method.step(system, state, control, 0.005, work)
        np.testing.assert_allclose(state.q, alone.q, rtol=0, atol=2e-6)
    assert system.contact.measure(state)[0].max() > 0


@pytest.mark.parametrize("method", [sim.ConvergedEuler, sim.Sdirk2])
@pytest.mark.parametrize("linear", ["superlu", "gmres_pardiso"])
def test_forces_by_the_schur_complement_are_those_of_assembled_rows(monkeypatch, linear, method):
    """With constant volumes; the assembled rows and their augmentation are another method."""
    system, ends = _of_constant_volume(tolerance=2e-5), []  # of 0.5 mm
    for most in (sim.integrators.factor.MOST_APART, -1):
        monkeypatch.setattr(sim.integrators.factor, "MOST_APART", most)
        work, state = sim.Workspace(system, linear), system.rest_state()
        assert (work.form(system, state) is system) == (most > 0)
        for _ in range(8):
            exact = method(tolerance=1e-9, residual_tolerance=1e-7)
            control = system.control(np.zeros(0))
            state, _ = exact.step(system, state, control, 0.005, work)
        ends.append(state)
    assert system.contact.measure(state)[0].max() > 0
    # SDIRK2 stops landing vertices by thresholds that the remaining gaps of 10 nm may cross
    close = 2e-8 if method is sim.ConvergedEuler else 1e-6
    np.testing.assert_allclose(ends[0].q, ends[1].q, rtol=0, atol=close)
    moved = np.linalg.norm(ends[0].q - system.scene.mesh.X, axis=1).max()
    assert moved > 1e-4


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("learns", [True, False])
@pytest.mark.parametrize("wrong", [1e3, 1e-3, -1.0])
def test_an_inaccurate_compliance_is_corrected_or_recomputed(monkeypatch, wrong, learns, friction):
    """With the compliance times 1e3 or 1e-3, or a random one, the motion is the same."""
    if not learns:
        monkeypatch.setattr(DelassusMatrix, "learn", lambda *_: (0.0, 0.0))
    system = lying(friction)
    control, ends, forgotten = system.control(np.zeros(0)), [], []
    forget = ContactMemory.forget_compliance

    def noted(work):
        forgotten.append(1)
        return forget(work)

    monkeypatch.setattr(ContactMemory, "forget_compliance", noted)
    for factor in (1.0, wrong):
        work, state = sim.Workspace(system), system.rest_state()
        for _ in range(4):
            state, _ = sim.ConvergedEuler().step(system, state, control, 0.005, work)
            known = work.contact._compliance
            known._found = factor * known._found
        ends.append(state.q)
    np.testing.assert_allclose(*ends, rtol=0, atol=2e-6)
    if friction == 0.0:
        assert bool(forgotten) is not (learns and wrong > 0.0)
