"""Reduced models compared with full order: basis, projection, sampling, steps, stability, errors."""

import numpy as np
import pytest

import sim
from sim.activation import Driven
from sim.reduced import (
    FusedEuler,
    ReducedMarkers,
    ReductionError,
    coverage_factor,
    fitted_closure,
    mass_modes,
    projected,
    reduce_system,
)
from sim.reduced.closure import features_of
from sim.reduced.cubature import element_forces, element_modes, sparse_weights
from sim.reduced.fused import OMITTED
from sim.state import Outputs
from tests.reduced.scenes import STEP, basis, block, drive, full_motion, snapshots


def whole_basis(system):
    """Unit vectors of all free components, orthonormal in the mass."""
    modes = np.zeros((3 * system.mesh.n_nodes, len(system.free)))
    modes[system.free, np.arange(len(system.free))] = 1.0 / np.sqrt(system.mass)
    return modes


def reduced_motion(model, modes, X, activation, integrator=None, duration=0.3, step=STEP):
    """Positions (times, n_nodes, 3) of a reduced model, and its trajectory."""
    nodes = ReducedMarkers(X, modes[:, : model.n_moving], [str(n) for n in range(len(X))])
    trajectory, _ = sim.simulate(
        model.system,
        activation,
        duration=duration,
        integrator=integrator or FusedEuler(rate=1e-8),
        steps=sim.FixedStep(step),
        probes=(nodes, ReductionError(modes[:, model.n_moving :]), sim.Energies()),
    )
    return trajectory.position.transpose("time", "marker", "axis").values, trajectory


def sampled_model(n=18, moving=12, tolerance=2e-4):
    system, (moved, levels) = block(), snapshots()
    modes = basis(n)
    whole = reduce_system(system, system.mesh.X, modes, moving)
    y = np.ascontiguousarray(projected(moved, system.node_mass, modes)[::3, :moving])
    model, sample = whole.sampled_at(y, levels[::3], tolerance=tolerance, most=100)
    return system, modes, whole, model, sample


def test_modes_are_orthonormal_in_the_mass_and_contain_the_snapshots():
    system, (moved, _) = block(), snapshots()
    modes, values = mass_modes(moved, system.node_mass, 15)
    gram = modes.T @ (np.repeat(system.node_mass, 3)[:, None] * modes)
    assert np.abs(gram - np.eye(15)).max() < 1e-10
    y = projected(moved, system.node_mass, modes)
    left = moved.reshape(len(moved), -1) - y @ modes.T
    lost = (left**2 * np.repeat(system.node_mass, 3)).sum()
    assert lost == pytest.approx((values[15:] ** 2).sum(), rel=1e-6)


def test_more_modes_than_the_snapshots_contain_are_refused():
    with pytest.raises(sim.SceneError, match="independent displacements, expected at least 9"):
        mass_modes(snapshots()[0][:6], block().node_mass, 9)


def test_a_whole_basis_gives_the_motion_of_full_order():
    """Same equation, other coordinates: equal up to rounding."""
    system, activation = block(), drive(0.7, 0.4)
    modes = whole_basis(system)
    model = reduce_system(system, system.mesh.X, modes, modes.shape[1])
    expected = full_motion(system, activation).values
    positions, _ = reduced_motion(model, modes, system.mesh.X, activation)
    assert np.abs(expected - system.mesh.X).max() > 1e-3
    assert np.abs(positions - expected).max() < 1e-9


def test_force_and_stiffness_of_all_elements_are_those_of_full_order_projected():
    """With modes that single precision represents, in which the kernels read them."""
    system, modes = block(), basis(12).astype(np.float32).astype(np.float64)
    model = reduce_system(system, system.mesh.X, modes, 12)
    y = np.random.default_rng(1).normal(size=12) * 3e-5
    q = system.mesh.X + (modes @ y).reshape(-1, 3)
    control = system.control(np.array([0.5, 0.2]))
    here, K = system.tangent(q, control)
    reduced, Kr = model.system.tangent(y.reshape(-1, 3), control)
    f = modes.T @ here.f.reshape(-1)
    assert np.abs(reduced.f.reshape(-1) - f).max() < 1e-11 * np.abs(f).max()
    assert reduced.smallest_J == pytest.approx(here.smallest_J, rel=1e-12)
    columns = np.array(
        [sim.linear.contract.symmetric_product(system.pattern, K, m) for m in modes[system.free].T]
    )
    expected = (columns @ modes[system.free])[np.triu_indices(12)]
    assert np.abs(Kr - expected).max() < 1e-11 * np.abs(expected).max()


def test_fused_steps_are_those_of_the_general_integrator():
    _, modes, _, model, _ = sampled_model()
    X, activation = block().mesh.X, drive(0.7, 0.4)
    one, _ = reduced_motion(model, modes, X, activation)
    other, _ = reduced_motion(model, modes, X, activation, sim.LinearlyImplicitEuler())
    assert np.abs(one - other).max() < 1e-9


def one_by_one(system, activation, n):
    """States after n single steps, with the control of a simulation."""
    integrator, work = FusedEuler(), sim.Workspace(system)
    control, state = Driven(system, activation), system.rest_state()
    for k in range(n):
        state, _ = integrator.step(system, state, control, (k + 1) * STEP - state.t, work)
        yield state


@pytest.mark.parametrize("every", [1, 3])
def test_steps_in_one_call_are_those_one_by_one(every):
    """Bit for bit, also from a checkpoint; reports of an output are those of all its steps."""
    _, _, _, model, _ = sampled_model()
    system, activation, n = model.system, drive(0.9, 0.4), 30
    single = list(one_by_one(system, activation, n))[every - 1 :: every]

    def moved(duration, initial=None, checkpoint=None):
        return sim.simulate(
            system,
            activation,
            duration=duration,
            integrator=FusedEuler(),
            steps=sim.FixedStep(STEP),
            every=every * STEP,
            probes=(sim.Positions(), ReductionError(np.eye(6)), sim.Iterations()),
            initial=initial,
            checkpoint=checkpoint,
        )

    whole, end = moved(n * STEP)
    q = whole.node_position.transpose("time", "node", "axis").values
    np.testing.assert_array_equal(q[1:], [state.q for state in single])
    np.testing.assert_array_equal(end.memory[OMITTED], single[-1].memory[OMITTED])
    assert (whole.steps.values[1:] == every).all() and (whole.iterations.values[1:] >= every).all()
    whole, end = moved(n * STEP, checkpoint=12 // every)
    first, middle = moved(0.4 * n * STEP)
    second, again = moved(0.6 * n * STEP, middle, 12 // every)
    np.testing.assert_array_equal(again.q, end.q)
    for name in ("reduction_estimate", "smallest_J", "iterations"):
        both = np.concatenate([first[name].values, second[name].values[1:]])
        np.testing.assert_array_equal(both, whole[name].values)


def test_an_inversion_ends_the_call_at_its_step():
    """Pushed too fast, an element inverts at the end of a step: error and time as in single steps."""
    _, _, model, _, _ = sampled_model()  # all elements
    y = np.random.default_rng(2).normal(size=(4, 3))
    start = sim.State(0.0, 0.0 * y, y)
    options = {"integrator": FusedEuler(), "steps": sim.FixedStep(STEP), "initial": start}
    with pytest.raises(sim.InvertedElement) as raised:
        sim.simulate(model.system, sim.resting(2), duration=0.3, **options)
    state, integrator, work = start, FusedEuler(), sim.Workspace(model.system)
    with pytest.raises(sim.InvertedElement) as expected:
        for _ in range(30):
            control = sim.Control(np.zeros(2))
            state, _ = integrator.step(model.system, state, control, STEP, work)
    assert str(raised.value) == str(expected.value)
    assert state.t == STEP  # one step was possible


def test_few_elements_reproduce_the_motion_under_another_activation():
    system, modes, whole, model, sample = sampled_model()
    assert sample.error <= 2e-4 and (sample.weights > 0.0).all()
    assert len(sample.elements) < len(whole.solid.weight)
    activation = drive(0.45, 0.75)
    expected = full_motion(system, activation).values
    positions, trajectory = reduced_motion(model, modes, system.mesh.X, activation)
    error = np.linalg.norm(positions - expected, axis=2).max()
    assert error < 0.1 * np.abs(expected - system.mesh.X).max()
    assert trajectory.reduction_estimate.max() > 0.0


def test_the_error_of_a_sample_is_that_of_all_equations():
    """Random sums represent the equations of all states: the same norm within a tenth."""
    system, _, whole, _, sample = sampled_model()
    moved, levels = snapshots()
    y = np.ascontiguousarray(projected(moved, system.node_mass, whole.solid.modes)[::3, :12])
    flexible, weight = np.linalg.inv(whole.solid.stiffness), np.zeros(len(whole.solid.weight))
    weight[sample.elements] = sample.weights
    modes, squares = element_modes(whole.solid), 0.0
    for state, level in zip(y, levels[::3], strict=True):
        forces = element_forces(whole.solid, state, level)
        on_modes = np.einsum("ek,ekn->en", forces, modes)
        squares += (((weight - 1.0) @ on_modes @ flexible) ** 2).sum()
    error = np.sqrt(squares / len(y) / whole.solid.mass)
    assert 0.0 < sample.error == pytest.approx(error, rel=0.1)


@pytest.mark.parametrize("rate", [FusedEuler().rate, 30.0])
def test_without_drive_the_energy_never_grows(rate):
    """Weighted elements have an energy, which steps dissipate however early their solution ends."""
    _, _, _, model, _ = sampled_model()
    y = np.random.default_rng(2).normal(size=(4, 3)) * 2e-5
    start = sim.State(0.0, y, 0.0 * y)
    trajectory, _ = sim.simulate(
        model.system,
        sim.resting(2),
        duration=1.0,
        integrator=FusedEuler(rate=rate),
        steps=sim.FixedStep(STEP),
        probes=(sim.Energies(),),
        initial=start,
    )
    energy = (trajectory.kinetic_energy + trajectory.potential_energy).values
    assert energy[0] - energy[-1] > 1e-8
    assert (np.diff(energy) <= 1e-12 * (energy[0] - energy[-1])).all()


@pytest.mark.parametrize(
    ("integrator", "order"), [(FusedEuler(), 1), (sim.Sdirk2(1e-12, 1e-12), 2)]
)
def test_reduced_motion_has_the_order_of_its_integrator(integrator, order):
    _, modes, _, model, _ = sampled_model()
    X = block().mesh.X
    steady = sim.Activation(np.array([0.0, 1.0]), np.array([[0.1, 0.05]] * 2))
    end = [
        reduced_motion(model, modes, X, steady, integrator, 0.08, h)[0][-1]
        for h in (0.002, 0.001, 0.0005)
    ]
    measured = np.log2(np.abs(end[1] - end[0]).max() / np.abs(end[2] - end[1]).max())
    assert measured == pytest.approx(order, abs=0.35)


def test_mirrored_activations_give_mirrored_motions():
    """Without gravity the block is symmetric about y = 5 mm, and so is a basis with mirrored motions."""
    system = block(gravity=False)
    X = system.mesh.X
    flipped = X * [1, -1, 1] + [0, 1e-2, 0]
    mirror = np.array([int(np.argmin(((X - x) ** 2).sum(axis=1))) for x in flipped])
    moved = np.concatenate([full_motion(system, drive(*a)).values[1:] - X for a in ((0.8, 0.1),)])
    both = np.concatenate([moved, moved[:, mirror] * [1, -1, 1]])
    modes, _ = mass_modes(both, system.node_mass, 6)
    model = reduce_system(system, X, modes, 6)
    one, _ = reduced_motion(model, modes, X, drive(0.6, 0.3))
    other, _ = reduced_motion(model, modes, X, drive(0.3, 0.6))
    assert np.abs(one - X).max() > 1e-3
    assert np.abs((one - X) - (other - X)[:, mirror] * [1, -1, 1]).max() < 1e-9


def test_of_equal_columns_that_with_known_nodes_is_chosen():
    """The second and the third column serve equally; the second has the nodes of the first."""
    A = np.array([[3.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
    own = np.array([[0, 1], [1, 0], [2, 3]])
    for nodes, second in ((own, 1), (own[[0, 2, 1]], 2)):
        chosen, x, error = sparse_weights(A, np.array([3.0, 1.0]), 1e-9, 3, nodes)
        assert sorted(chosen) == [0, second] and error <= 1e-9
        np.testing.assert_allclose(x, 1.0)


def test_other_terms_are_refused():
    scene = block().scene
    walled = sim.Scene(
        scene.mesh,
        (*scene.terms, sim.Support(np.array([44]), np.array([[1.0, 0.0, 0.0]]))),
        scene.reductions,
        scene.damping,
    )
    with pytest.raises(sim.SceneError, match="the scene has Solid, Support"):
        reduce_system(sim.compile_scene(walled), scene.mesh.X, basis(6), 6)
    current = sim.Scene(scene.mesh, scene.terms, scene.reductions, sim.Rayleigh())
    with pytest.raises(sim.SceneError, match="damping by the stiffness at rest"):
        reduce_system(sim.compile_scene(current), scene.mesh.X, basis(6), 6)


def test_a_closure_recovers_a_linear_difference():
    """Positions that miss a linear function of coordinates, omitted coordinates and activation."""
    rng = np.random.default_rng(4)
    features, weights = rng.normal(size=(400, 7)) * [1, 2, 3, 1, 1, 1, 0], rng.normal(size=(6, 7))
    missing = 1e-3 * (features @ weights.T + 0.5).reshape(-1, 2, 3)
    closure = fitted_closure(features, missing)
    memory = {OMITTED: np.stack([features[0, 3:5], np.zeros(2)])}
    state = sim.State(0.0, features[:1, :3], np.zeros((1, 3)), memory)
    outputs = Outputs.at_state(state, sim.StepReport(0.01, 1.0))
    (recovered,) = closure(features_of(outputs, features[:1, 5:], 7))
    np.testing.assert_allclose(recovered, missing[0], atol=0.02 * np.abs(missing).max())
    assert (closure.weights[:, 6] == 0.0).all()  # an activation that never varies


def test_calibration_covers_new_trials():
    """Exchangeable trials: coverage of at least 90 %, and not of nearly all."""
    rng = np.random.default_rng(0)
    estimates = rng.uniform(0.5, 2.0, (1039, 5))
    errors = estimates * rng.lognormal(0.0, 0.5, (1039, 1))
    factor = coverage_factor(errors[:39], estimates[:39], 0.0, 0.9)
    covered = (errors[39:] <= factor * estimates[39:]).all(axis=1).mean()
    assert 0.85 < covered < 0.98
    with pytest.raises(sim.SceneError, match="expected at least 19"):
        coverage_factor(errors[:18], estimates[:18], 0.0, 0.95)
