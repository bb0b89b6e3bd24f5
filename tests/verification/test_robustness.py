"""Typed failures without side effects, and cases in which only the converged solver succeeds."""

import numpy as np
import pytest

import sim
from sim.linear import LINEAR_SOLVERS, NotPositiveDefinite, linear_solver, pardiso_is_available
from sim.linear.contract import Matrix
from sim.steps import Motion
from sim.threads import set_thread_count, thread_count
from tests.bodies import crossed_muscles, dense, fixed_block, grid, solid_system


def strong_block(sigma_max=300e3):
    mesh = grid((3, 2, 2), (0.03, 0.02, 0.02), wedges=(4,))
    return fixed_block(mesh, sim.Blemker(sigma_max), damping=sim.RestRayleigh())


def full_at_once(system):
    return sim.Activation(np.zeros(1), np.ones((1, len(system.muscles))))


@pytest.mark.parametrize("sigma_max", [100e3, 300e3, 1000e3])
def test_full_activation_within_one_step(sigma_max):
    system = strong_block(sigma_max)
    trajectory, end = sim.simulate(
        system,
        full_at_once(system),
        duration=0.2,
        steps=sim.HalvingStep(0.01),
        probes=(sim.SmallestJ(), sim.Iterations()),
    )
    assert trajectory.smallest_J.min() > 0.0
    assert np.isfinite(end.q).all()
    assert (trajectory.residual[1:] <= 2e-5).all()


def test_the_linearly_implicit_solver_reports_the_inverted_element():
    system = strong_block(3000e3)
    with pytest.raises(sim.InvertedElement, match="try a smaller step") as caught:
        sim.simulate(
            system,
            full_at_once(system),
            duration=1.0,
            integrator=sim.LinearlyImplicitEuler(),
            steps=sim.FixedStep(0.05),
        )
    assert 0 <= caught.value.element < system.scene.mesh.n_elements
    assert not caught.value.det_F > 0.0


def test_too_few_iterations_raise_an_error():
    system = strong_block()
    with pytest.raises(sim.NotConverged, match="limit of 2 iterations") as caught:
        sim.simulate(
            system,
            full_at_once(system),
            duration=0.01,
            integrator=sim.ConvergedEuler(max_iterations=2),
        )
    assert len(caught.value.residuals) >= 2


class FailsAbove:
    """Integrator that refuses steps above a size, for tests of step controls."""

    order = 1

    def __init__(self, largest):
        self.largest, self.seen = largest, []

    def step(self, system, state, control, h, work):
        self.seen.append((state.t, h, state.q.sum()))
        if h > self.largest:
            raise sim.NotConverged((1.0,), state.t + h, "refused")
        return sim.State(state.t + h, state.q + h, state.v), sim.StepReport(h=h, smallest_J=1.0)


def test_halving_covers_the_interval_exactly_and_a_rejected_step_leaves_no_trace():
    system = strong_block()
    start, integrator = system.rest_state(), FailsAbove(0.003)
    motion = Motion(
        integrator, system, lambda t: system.control(np.zeros(2)), sim.Workspace(system)
    )
    end, report = sim.HalvingStep(0.01, max_halvings=4).advance(motion, start, 0.01)
    assert end.t == pytest.approx(0.01, abs=1e-15)
    np.testing.assert_allclose(end.q, start.q + 0.01, atol=1e-15)
    assert report.steps == 4
    assert report.rejected >= 2
    again = [s for s in integrator.seen if s[0] == 0.0]
    assert len({s[2] for s in again}) == 1


def test_halving_finally_raises_the_failure_of_the_step():
    system = strong_block()
    with pytest.raises(sim.NotConverged, match="refused"):
        control = system.control(np.zeros(2))
        motion = Motion(FailsAbove(1e-9), system, lambda t: control, sim.Workspace(system))
        sim.HalvingStep(0.01, max_halvings=2).advance(motion, system.rest_state(), 0.01)


@pytest.mark.parametrize("bad", [np.nan, -0.1, 1.1, np.inf])
def test_activation_outside_its_range_is_named(bad):
    system = strong_block()
    with pytest.raises(sim.ControlError, match="second"):
        sim.simulate(system, sim.Activation(np.zeros(1), np.array([[0.1, bad]])), duration=0.01)


def test_a_start_that_is_inverted_is_refused():
    system = strong_block()
    q = system.scene.mesh.X * np.array([1.0, 1.0, -1.0])
    start = sim.State(0.0, q, np.zeros_like(q))
    with pytest.raises(sim.InvertedElement):
        sim.simulate(system, sim.resting(2), duration=0.01, initial=start)


def test_nan_is_never_accepted_as_a_result():
    system = strong_block()
    q = system.scene.mesh.X.copy()
    q[-1] = np.nan
    assert np.isnan(system.smallest_J(q)[0])
    start = sim.State(0.0, q, np.zeros_like(q))
    for integrator in (sim.LinearlyImplicitEuler(), sim.ConvergedEuler()):
        with pytest.raises(sim.SimulationError):
            sim.simulate(
                system, sim.resting(2), duration=0.01, initial=start, integrator=integrator
            )


def test_invalid_meshes_and_scenes_are_refused_with_a_reason():
    cube = grid((1, 1, 1))
    nodes = cube.blocks[0].nodes
    with pytest.raises(sim.MeshError, match="element 0 .*inverted"):
        sim.mesh_from_arrays(cube.X, hex8=nodes[:, [4, 5, 6, 7, 0, 1, 2, 3]])
    with pytest.raises(sim.MeshError, match="refers to node 8"):
        sim.mesh_from_arrays(cube.X, hex8=nodes + 1)
    with pytest.raises(sim.MeshError, match="belong to no element"):
        sim.mesh_from_arrays(np.vstack([cube.X, [[1.0, 1.0, 1.0]]]), hex8=nodes)
    with pytest.raises(sim.MeshError, match="unknown element type 'hex9'"):
        sim.mesh_from_arrays(cube.X, hex9=nodes)
    with pytest.raises(sim.SceneError, match="muscle b has no element"):
        sim.Muscles(("a", "b"), np.array([0]), np.array([0]), np.eye(3)[:1])
    with pytest.raises(sim.SceneError, match="no fibre direction"):
        sim.Muscles(("a",), np.array([0]), np.array([0]), np.zeros((1, 3)))
    row = (("a",), np.array([0]), np.array([0]), np.eye(3)[:1])
    with pytest.raises(sim.SceneError, match=r"\(2,\) weights, expected \(1,\)"):
        sim.Muscles(*row, weight=np.ones(2))
    with pytest.raises(sim.SceneError, match="muscle a has weight -0.5 in element 0"):
        sim.Muscles(*row, weight=np.array([-0.5]))
    with pytest.raises(sim.SceneError, match="every node is fixed"):
        solid_system(cube, reductions=(sim.Fixed(np.arange(8)),))
    with pytest.raises(sim.SceneError, match="sigma_max"):
        sim.Blemker(sigma_max=-1.0)


@pytest.mark.parametrize("name", LINEAR_SOLVERS)
def test_linear_solvers_against_numpy(name):
    if "pardiso" in name and not pardiso_is_available():
        pytest.skip("pypardiso is not installed for this platform")
    system = strong_block()
    control = system.control(np.array([0.2, 0.1]))
    K = system.tangent(system.scene.mesh.X, control)[1]
    D = system.damping(system.scene.mesh.X, control)
    values = 1e-4 * K + 1e-2 * D
    values[system.pattern.diagonal] += system.mass
    solver = linear_solver(name)
    solver.analyse(system.pattern)
    for scale in (1.0, 3.0):  # one analysis serves many factorisations
        solver.factorise(scale * values)
        rhs = np.random.default_rng(0).normal(size=system.pattern.n)
        expected = np.linalg.solve(scale * dense(system, values), rhs)
        np.testing.assert_allclose(solver.solve(rhs), expected, rtol=1e-8)
    with pytest.raises(sim.SingularSystem):
        solver.factorise(np.full_like(values, np.nan))


def test_cholesky_reports_an_indefinite_matrix_and_the_workspace_shifts_it():
    if not pardiso_is_available():
        pytest.skip("pypardiso is not installed for this platform")
    system = strong_block()
    values = np.zeros(system.pattern.nnz)
    values[system.pattern.diagonal] = -0.5 * system.mass
    work = sim.Workspace(system, "pardiso")
    with pytest.raises(NotPositiveDefinite):
        work.linear.factorise(values)
    assert work.newton.factorise(Matrix(system.pattern, values), system.mass, ("", 1.0)) == 1
    np.testing.assert_allclose(work.newton.solve(0.5 * system.mass), 1.0, rtol=1e-12)


@pytest.mark.parametrize("name", LINEAR_SOLVERS)
def test_trajectories_do_not_depend_on_the_linear_solver(name):
    if "pardiso" in name and not pardiso_is_available():
        pytest.skip("pypardiso is not installed for this platform")
    system = strong_block(50e3)
    ends = [
        sim.simulate(
            system,
            full_at_once(system),
            duration=0.05,
            integrator=sim.ConvergedEuler(tolerance=1e-10, residual_tolerance=1e-8),
            work=sim.Workspace(system, solver),
        )[1].q
        for solver in (name, "superlu")
    ]
    np.testing.assert_allclose(*ends, atol=1e-9)


def test_results_do_not_depend_on_the_number_of_threads():

    mesh = grid((9, 8, 6), (0.03, 0.02, 0.02), wedges=(4,))  # more than one chunk of elements
    terms = sim.ElementVolume(), sim.NodalVolume()
    system = solid_system(mesh, muscles=crossed_muscles(mesh), terms=terms)
    q = system.scene.mesh.X * 1.05
    control = system.control(np.array([0.2, 0.4]))
    before = thread_count()
    results = []
    for threads in (1, 2, 3):
        set_thread_count(threads)
        evaluation, K = system.tangent(q, control)
        results.append((evaluation.f.tobytes(), K.tobytes(), evaluation.energy))
    set_thread_count(before)
    assert results[0] == results[1] == results[2]
