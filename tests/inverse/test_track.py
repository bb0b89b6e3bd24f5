"""Tracking of targets step by step: exactness, bounds, and the recorded runs of another simulator."""

import numpy as np
import pytest
import scipy.optimize

import sim
from sim.inverse import (
    MeasuredActivation,
    PointTarget,
    Weights,
    minimise_in_box,
    track,
)
from sim.inverse.quadratic import violation
from tests.bodies import crossed_muscles, grid
from tests.contact.scenes import square
from tests.inverse.points import circle, constant_muscles, particle, recorded
from tests.inverse.test_response import block

ENDS = circle(0.01)


def lissajous(last: int, size: float = 3e-3, h: float = 0.01) -> PointTarget:
    t = h * np.arange(51)
    x = size * np.stack([np.sin(4 * np.pi * t), 0 * t, np.sin(6 * np.pi * t)], axis=1)
    return PointTarget(np.array([last]), t, x[:, None], 1e-3)


def test_a_particle_follows_a_lissajous_figure():
    system, last = particle(ENDS, constant_muscles(ENDS))
    tracked, _ = track(
        system, [lissajous(last)], duration=0.5, weights=Weights(size=1e-10, change=0)
    )
    error = np.abs(tracked["tracked"] - tracked["wanted"]).max()
    assert error * 1e-3 <= 1e-6 * 3e-3
    assert tracked["violation"].max() <= 1e-10
    assert 0.0 <= tracked["activation"].min() and tracked["activation"].max() < 1.0


def test_the_activations_repeat_the_motion_in_a_forward_simulation():
    system, last = particle(ENDS, constant_muscles(ENDS))
    tracked, end = track(system, [lissajous(last)], duration=0.5)
    a = tracked["activation"].values.T
    drive = sim.Activation(0.01 * np.arange(51), np.concatenate([a[:1], a]))
    _, forward = sim.simulate(
        system, drive, duration=0.5, integrator=sim.LinearlyImplicitEuler(), steps=sim.FixedStep(0.01),
        probes=(),
    )  # fmt: skip
    # the linearised step differs in second order of the change of the activation
    assert np.abs(forward.q - end.q).max() <= 2e-5


@pytest.mark.parametrize("seed", range(4))
def test_the_quadratic_programme_is_solved_exactly(seed):
    rng = np.random.default_rng(seed)
    J, y = rng.standard_normal((12, 20)), 3.0 * rng.standard_normal(12)
    low, high = np.zeros(20), rng.uniform(0.1, 1.0, 20)
    high[3] = low[3]  # prescribed
    minimum = minimise_in_box(J.T @ J + 1e-4 * np.eye(20), J.T @ y, low, high)
    assert minimum.violation <= 1e-10
    rows = np.concatenate([J, 1e-2 * np.eye(20)])
    free = np.arange(20) != 3
    other = scipy.optimize.lsq_linear(
        rows[:, free], np.concatenate([y, np.zeros(20)]), (low[free], high[free]), tol=1e-14
    )
    assert np.abs(minimum.x[free] - other.x).max() <= 1e-6
    assert minimum.x[3] == 0.0


def problem(seed: int):
    """Random quadratic programme: few quantities, weights over ten decades, bounds that coincide."""
    rng = np.random.default_rng(seed)
    n, m = (int(k) for k in rng.integers(1, 40, 2))
    J = rng.standard_normal((m, n)) * 10.0 ** rng.uniform(-4.0, 0.0, n)
    Q = 10.0 ** rng.uniform(-3, 6) * J.T @ J + 10.0 ** rng.uniform(-10, 0) * np.eye(n)
    c = Q @ rng.uniform(-0.5, 1.5, n) * (seed % 5 > 0)
    high = np.full(n, rng.choice([0.1, 1.0])) * (np.arange(n) >= n // 2 * (seed % 11 == 0))
    return Q, c, np.zeros(n), high, None if seed % 3 else rng.uniform(0.0, 1.0, n)


def test_the_optimality_conditions_hold_in_programmes_of_any_scale():
    """No activation alone could change by 1e-10; with small weights half of them were left at zero."""
    violations = [minimise_in_box(*problem(seed)).violation for seed in range(400)]
    assert max(violations) <= 1e-10, np.argsort(violations)[-5:]


def test_the_violation_is_the_change_that_would_still_lower_the_objective():
    Q, c, low, high, _ = problem(1)
    best = minimise_in_box(Q, c, low, high)
    for i in range(len(c)):
        for way in (1e-6, -1e-6):
            x = best.x.copy()
            x[i] += way
            inside = low[i] <= x[i] <= high[i]
            assert violation(Q, c, low, high, x) >= 0.999e-6 * (inside or 1.0)
    for scale in (1e-9, 1e9):  # the scale of the quadratic has no effect
        x = np.clip(best.x + 1e-3, low, high)
        one = violation(Q, c, low, high, x)
        assert violation(scale * Q, scale * c, low, high, x) == pytest.approx(one, rel=1e-9)
    outside = violation(Q, c, low, high, best.x + 2.0 * high)
    assert outside >= float(high.max())


def test_a_small_weight_on_the_size_chooses_the_solution_of_least_norm():
    rng = np.random.default_rng(0)
    J = 1.0 + 0.3 * rng.random((3, 16))
    y = J @ np.full(16, 0.4)
    minimum = minimise_in_box(J.T @ J + 1e-7 * np.eye(16), J.T @ y, np.zeros(16), np.ones(16))
    least = np.linalg.pinv(J) @ y
    assert 0.0 < least.min() and least.max() < 1.0
    assert np.abs(minimum.x - least).max() <= 1e-6


def infeasible():
    """Tracking of a node of a block towards a point 50 mm away, and the end."""
    system = block()
    node = len(system.mesh.X) - 1
    target = PointTarget(
        np.array([node]), np.zeros(1), system.mesh.X[None, [node]] + np.array([0.05, 0.0, 0.0])
    )
    return track(system, [target], duration=0.3, weights=Weights(jump=0.05))


def test_an_infeasible_target_leaves_activations_bounded_and_its_residual_known():
    tracked, end = infeasible()
    a = tracked["activation"].values
    assert a.min() >= 0.0 and a[:, -1].max() == 1.0
    assert np.abs(np.diff(a, axis=1)).max() == pytest.approx(0.05, abs=1e-12)  # it binds
    assert tracked["misfit"][-1] > 10.0 and np.isfinite(end.q).all()


def pressed_and_released():
    """Muscles press a block on a sheet, further than the sheet allows, and release it again."""
    mesh = grid()
    solid = sim.Solid(muscles=crossed_muscles(mesh))
    sheet = sim.ConstraintContact((sim.Pairing(sim.boundary_surface(mesh), square()),))
    side = sim.Fixed(np.flatnonzero(mesh.X[:, 0] == 0.0))
    damping = sim.RestRayleigh(19.0, 0.055)
    system = sim.compile_scene(sim.Scene(mesh, (solid, sheet), (side,), damping))
    node = np.flatnonzero((mesh.X[:, 2] == 0.0) & (mesh.X[:, 0] == mesh.X[:, 0].max()))
    t = 0.01 * np.arange(31)
    way = -1e-4 * np.sin(2.0 * np.pi * t / 0.2)[:, None, None] * np.array([0.0, 0.0, 1.0])
    target = PointTarget(node, t, mesh.X[node] + way, 1e-4)
    return track(system, [target], duration=0.3, weights=Weights(jump=0.1))


def test_a_contact_that_opens_and_closes_makes_no_jump():
    tracked, end = pressed_and_released()
    rows, a = tracked["rows"].values, tracked["activation"].values
    assert rows.max() > rows.min(), (rows, a)
    assert np.abs(np.diff(a, axis=1)).max() <= 0.1 + 1e-12
    assert 0.0 <= a.min() and a.max() <= 1.0 and np.isfinite(end.q).all()
    assert end.q[:, 2].min() > -1e-5
    assert np.isfinite(tracked["misfit"]).all()


def test_lost_markers_leave_the_others_and_the_activations_defined():
    system, last = particle(ENDS, constant_muscles(ENDS))
    target = lissajous(last)
    target.position[10:20] = np.nan
    tracked, _ = track(system, [target], duration=0.5, weights=Weights(size=1e-8, jump=0.2))
    a = tracked["activation"]
    assert np.isfinite(a).all() and np.abs(a.diff("time")).max() <= 0.2 + 1e-12
    assert tracked["misfit"].isnull().sum() == 10
    assert tracked["misfit"][-1] < 1e-3


def test_a_known_activation_is_recovered():
    """Same system, step and integrator, all positions tracked: the only inverse crime of the tests."""
    system = block()
    t = 0.01 * np.arange(21)
    true = 0.3 * np.stack([np.sin(8 * t) ** 2, np.sin(5 * t) ** 2], axis=1)
    probe = sim.Positions()
    motion, _ = sim.simulate(
        system, sim.Activation(t, true), duration=0.2, integrator=sim.LinearlyImplicitEuler(),
        probes=(probe,),
    )  # fmt: skip
    q = motion["node_position"].transpose("time", ...).values
    target = PointTarget(np.arange(q.shape[1]), t, q, 1e-6)
    weights = Weights(size=0.0, change=1e-12, rounds=3)
    tracked, _ = track(system, [target], duration=0.2, weights=weights)
    assert np.abs(tracked["activation"].values.T - true[1:]).max() <= 1e-4


def test_measured_activations_pull_and_prescribe():
    system, last = particle(ENDS, constant_muscles(ENDS))
    given = sim.Activation(np.zeros(1), np.full((1, 16), 0.3))
    trust = np.zeros(16)
    trust[:2], trust[2] = np.inf, 1e6
    tracked, _ = track(
        system, [lissajous(last)], duration=0.1, measured=MeasuredActivation(given, trust)
    )
    a = tracked["activation"].values
    assert (a[:2] == 0.3).all()
    assert np.abs(a[2] - 0.3).max() < 1e-3
    assert tracked["misfit"].max() < 0.01  # the others make up for them


@pytest.mark.parametrize(("name", "alike"), [("point2d", 1e-6), ("point3d", 3e-4)])
def test_the_recorded_runs_of_another_simulator_are_repeated_and_bettered(shared, name, alike):
    """Its controller is a setting of this one; its stated limit of 0.1 per step is not in its runs."""
    system, target, run, settings = recorded(shared / "artisynth_reference" / "inverse", name)
    assert np.abs(np.diff(run["excitation"], axis=0)).max() > settings["max_excitation_jump"]

    def tracked(**weights):
        positions, _ = track(
            system, [target], duration=0.5, integrator=sim.LinearlyImplicitTrapezoidal(),
            weights=Weights(change=0.0, **weights),
        )  # fmt: skip
        return positions["activation"].values.T, positions["tracked"].values.T

    size = settings["l2_weight"] / len(system.muscles)
    a, x = tracked(size=size, aim="velocity", normalise=True, form="affine")
    assert np.abs(a - run["excitation"]).max() <= alike
    assert np.abs(x - run["actual"][:, 0]).max() <= alike
    _, x = tracked(size=1e-8)
    own = np.linalg.norm(x - run["target"][:, 0], axis=1).max()
    theirs = np.linalg.norm(run["actual"][:, 0] - run["target"][:, 0], axis=1)
    assert own <= 1e-4 * theirs[-1]


def test_settings_that_cannot_work_are_refused():
    system, last = particle(ENDS, constant_muscles(ENDS))
    with pytest.raises(sim.SceneError, match="0 targets"):
        track(system, [], duration=0.1)
    with pytest.raises(sim.SceneError, match="shorter than the step"):
        track(system, [lissajous(last)], duration=0.1, weights=Weights(chase=0.001))
    with pytest.raises(sim.ControlError, match="low <= high"):
        Weights(low=0.5, high=0.2)
    with pytest.raises(sim.SceneError, match="rounds"):
        Weights(rounds=7)
    with pytest.raises(sim.SceneError, match="one row of values"):
        PointTarget(np.array([0]), np.zeros(2), np.zeros((1, 1, 3)))
    with pytest.raises(sim.ControlError, match="trust of shape"):
        MeasuredActivation(sim.resting(16), np.zeros(3))
