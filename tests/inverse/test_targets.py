"""Targets that are shapes or forces: closed forms, derivatives, and activations that reach them."""

import numpy as np
import pytest

import sim
from emgface.anatomy.jaw.scene import jaw_scene
from emgface.anatomy.jaw.template import template_jaw
from emgface.face.lip_shape import lip_opening, lip_rim, lip_shape
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from sim.inverse import (
    ActiveForces,
    AreaTarget,
    ContactForceTarget,
    PointTarget,
    RowForceTarget,
    SeparationTarget,
    Weights,
    step_response,
    track,
)
from tests.inverse.test_response import block
from tests.inverse.test_trajectory import pressed_block

STILL = np.zeros(1)
POSE = ("lower_incisor", "condyle_L", "condyle_R")


def separation(wanted: float = 0.0) -> SeparationTarget:
    return SeparationTarget(np.array([0, 1]), np.array([2, 3, 4]), STILL, np.array([wanted]))


def area(nodes, wanted: float = 0.0) -> AreaTarget:
    return AreaTarget(np.asarray(nodes), STILL, np.array([wanted]))


def test_a_rectangle_has_its_area_and_overlapping_lips_a_negative_one():
    """Seen against y, (z, x) is counterclockwise; exchanging upper and lower side reverses the sign."""
    upper, lower = [[0.0, 0.1, 0.01], [0.04, 0.2, 0.01]], [[0.04, 0.0, 0.0], [0.0, 0.3, 0.0]]
    open_, passed = np.array(upper + lower), np.array(upper + lower)
    passed[:2, 2] = -0.005
    assert area(range(4)).value(open_) == pytest.approx([4e-4], rel=1e-12)
    assert area(range(4)).value(passed) == pytest.approx([-2e-4], rel=1e-12)


def test_a_separation_has_the_sign_of_its_direction():
    q = np.zeros((5, 3))
    q[:2, 2], q[2:, 2] = (0.003, 0.005), 0.001
    assert separation().value(q) == pytest.approx([0.003], rel=1e-12)
    q[:2, 2] = -0.002
    assert separation().value(q) == pytest.approx([-0.003], rel=1e-12)


@pytest.mark.parametrize("target", [separation(), area([5, 1, 0, 7]), area([2, 3, 2, 6, 8])])
def test_slopes_are_derivatives(target):
    q, near = np.random.default_rng(0).standard_normal((9, 3)), 1e-6
    way = np.random.default_rng(1).standard_normal(q.shape)
    change = (target.value(q + near * way) - target.value(q - near * way)) / (2.0 * near)
    assert target.slope(q) @ way.ravel() == pytest.approx(change, rel=1e-8)


def test_opening_and_area_alone_recover_the_activation_of_two_muscles():
    system = block()
    nodes = np.flatnonzero(system.mesh.X[:, 2] == system.mesh.X[:, 2].max())
    x, y = (system.mesh.X[nodes, :2] - system.mesh.X[nodes, :2].mean(axis=0)).T
    outer = np.hypot(x, y) > 0.0
    ring = nodes[outer][np.argsort(np.arctan2(y, x)[outer])]
    true, h = np.array([0.25, 0.1]), 0.01
    motion, _ = sim.simulate(
        system, sim.Activation(np.zeros(1), true[None]), duration=0.05, probes=(sim.Positions(),),
        integrator=sim.LinearlyImplicitEuler(), steps=sim.FixedStep(h),
    )  # fmt: skip
    q, t = motion["node_position"].transpose("time", ...).values, motion["time"].values
    base, along = np.flatnonzero(system.mesh.X[:, 2] == 0.0), (1.0, 0.0, 0.0)
    gaps = np.array(
        [SeparationTarget(nodes[:1], base, STILL, STILL, along).value(at)[0] for at in q]
    )
    areas = np.array([AreaTarget(ring, STILL, STILL, (0.0, 0.0, 1.0)).value(at)[0] for at in q])
    targets = [
        SeparationTarget(nodes[:1], base, t, gaps, along, 1e-6),
        AreaTarget(ring, t, areas, (0.0, 0.0, 1.0), 1e-8),
    ]
    weights = Weights(size=0.0, change=1e-10, rounds=3)
    tracked, _ = track(system, targets, duration=0.05, h=h, weights=weights)
    assert tracked["activation"].values == pytest.approx(np.tile(true[:, None], 5), abs=1e-5)


@pytest.fixture(scope="module")
def lips(coarse):
    """Face without contact, its opening and area at rest, and targets of both over time."""
    free = SimulationParameters(
        solver="linearly_implicit", gravity=False, contact={"method": "none"}, sigma_max=115e3
    )
    system, rim = sim.compile_scene(compose_scene(coarse, free)), lip_rim(coarse)
    top, bottom = coarse["lip_opening_node"].values.astype(np.int64)
    ring = np.concatenate([rim.upper, rim.lower[-2:0:-1]])

    def targets(t, opening, area):
        return [
            SeparationTarget(np.array([top]), np.array([bottom]), t, opening, size=1e-4),
            AreaTarget(ring, t, area, size=1e-6),
        ]

    return coarse, system, rim, targets


def test_lips_open_by_the_wanted_height_and_area(lips):
    """Those of a motion by DLI and LLSAN, measured by other code, are reached by both sides."""
    face, system, rim, targets = lips
    true, h = np.zeros(20), 0.02
    for name, level in {"DLI_L": 0.3, "DLI_R": 0.3, "LLSAN_L": 0.15, "LLSAN_R": 0.15}.items():
        true[system.muscles.index(name)] = level
    t, ramp = h * np.arange(11), np.linspace(0.0, 1.0, 11)
    motion, moved = sim.simulate(
        system, sim.Activation(t, ramp[:, None] * true), duration=0.2, probes=(sim.Positions(),),
        integrator=sim.LinearlyImplicitEuler(), steps=sim.FixedStep(h),
    )  # fmt: skip
    q = motion["node_position"].transpose("time", ...).values
    opening = np.array([lip_opening(face, at) for at in q])
    area = np.array([targets(STILL, STILL, STILL)[1].value(at)[0] for at in q])
    shape = lip_shape(face, rim, moved.q)
    assert area[-1] == pytest.approx(shape["area"] - shape["overlap"], rel=0.02)
    assert opening[-1] - opening[0] > 2e-3 and area[-1] > 1.5 * area[0]
    weights = Weights(size=1e-6, change=1e-6)
    tracked, end = track(system, targets(t, opening, area), duration=0.2, h=h, weights=weights)
    reached = lip_shape(face, rim, end.q)
    assert reached["height"] == pytest.approx(shape["height"], abs=1e-5)
    assert reached["area"] - reached["overlap"] == pytest.approx(
        shape["area"] - shape["overlap"], abs=1e-6
    )
    a = tracked["activation"].isel(time=-1).to_series()
    assert a[["DLI_L", "DLI_R"]].min() > 0.05
    for name in system.muscles[:10]:
        assert a[name] == pytest.approx(a[f"{name[:-2]}_R"], abs=0.02)


def test_lips_that_should_open_too_far_stay_in_the_bounds(lips):
    face, system, rim, targets = lips
    wanted = targets(STILL, np.array([0.1]), np.array([np.nan]))
    tracked, end = track(system, wanted, duration=0.2, h=0.02, weights=Weights(jump=0.1, chase=0.1))
    a = tracked["activation"].values
    assert a.min() >= 0.0 and 0.9 < a.max() <= 1.0
    assert np.abs(np.diff(a, axis=1)).max() <= 0.1 + 1e-12
    reached = lip_opening(face, end.q)
    left = (tracked["wanted"] - tracked["tracked"]).isel(quantity=0, time=-1)
    assert reached > 3e-3 and float(left) * 1e-4 == pytest.approx(0.1 - reached, abs=1e-6)


def bite(t, force) -> RowForceTarget:
    return RowForceTarget(("bite_L", "bite_R"), np.asarray(t), np.asarray(force, float), 1.0)


@pytest.fixture(scope="module")
def jaw():
    parts = jaw_scene(template_jaw())
    return parts, sim.compile_scene(parts.scene)


def bitten(jaw, left: float, right: float):
    """Last forces and activations of a jaw that keeps its teeth together."""
    parts, system = jaw
    node = np.array([parts.points["lower_incisor"]])
    closed = PointTarget(node, STILL, system.rest_state().q[node][None], 1e-4)
    high = np.isin(system.muscles, list(parts.muscles)).astype(float)
    tracked, _ = track(
        system, [closed], duration=0.3, h=0.005,
        forces=[bite([0.0, 0.2], [[0, 0], [left, right]])],
        weights=Weights(size=1e-3, change=1e-3, chase=0.02, jump=0.05, high=high),
    )  # fmt: skip
    last = tracked.isel(time=-1)
    return last["tracked"].values[3:], last["activation"].to_series()


def test_bite_forces_are_reached_on_both_sides(jaw):
    """60 N on one side and 40 N on the other, by closers; mirrored forces by mirrored muscles."""
    force, left = bitten(jaw, 60.0, 40.0)
    assert force == pytest.approx([60.0, 40.0], abs=0.1)
    closers = ["at", "mt", "pt", "sm", "dm", "mp"]
    assert sum(left[f"{m}_L"] - left[f"{m}_R"] for m in closers) > 0.02
    assert left[["ad_L", "ad_R", "ip_L", "ip_R"]].max() < 0.01
    force, right = bitten(jaw, 40.0, 60.0)
    assert force == pytest.approx([40.0, 60.0], abs=0.1)
    for m in closers:
        assert left[f"{m}_L"] == pytest.approx(right[f"{m}_R"], abs=1e-6)


def test_three_points_determine_the_pose_of_a_body(jaw):
    """Pose of the mandible while muscles open it on one side, followed by three of its points."""
    parts, system = jaw
    a = np.zeros(len(system.muscles))
    for name in ("ip_R", "ad_R", "ad_L"):
        a[system.muscles.index(name)] = 0.02
    h, n = 5e-3, 20
    motion, moved = sim.simulate(
        system, sim.Activation(np.zeros(1), a[None]), duration=h * n, probes=(sim.Positions(),),
        integrator=sim.LinearlyImplicitEuler(), steps=sim.FixedStep(h),
    )  # fmt: skip
    nodes = np.array([parts.points[name] for name in POSE])
    q = motion["node_position"].transpose("time", ...).values[:, nodes]
    target = PointTarget(nodes, motion["time"].values, q, 1e-5)
    high = np.isin(system.muscles, list(parts.muscles)).astype(float)
    _, end = track(
        system, [target], duration=h * n, h=h, weights=Weights(size=1e-8, change=0.0, high=high)
    )
    start = system.rest_state().q
    turned = [np.linalg.norm((moved.q - start)[k]) for k in nodes]
    assert min(turned) > 1e-4 and np.ptp(turned) > 1e-3
    for name in ("bite_L", "bite_R"):  # others on the mandible
        k = parts.points[name]
        assert np.linalg.norm(moved.q[k] - start[k]) > 1e-3
        assert np.abs(end.q[k] - moved.q[k]).max() <= 1e-5


def test_the_derivatives_of_bite_forces_are_those_of_the_step(jaw):
    parts, system = jaw
    active = np.flatnonzero(np.isin(system.muscles, list(parts.muscles)))
    level = np.zeros(len(system.muscles))
    level[[system.muscles.index(name) for name in ("sm_L", "sm_R", "at_L", "at_R")]] = 0.3
    euler, state, h = sim.LinearlyImplicitEuler(), system.rest_state(), 5e-4

    def stepped(a):
        work = sim.Workspace(system)
        return euler.step(system, state, sim.Control(a, state.t + h), h, work)[0].memory["joints"]

    for _ in range(5):
        control = sim.Control(level, state.t + 5e-3)
        state, _ = euler.step(system, state, control, 5e-3, sim.Workspace(system))
    response = step_response(
        system, euler, state, level, h, sim.Workspace(system), ActiveForces(system), row_forces=True
    )
    rows, near = bite([0.0], [[0, 0]]).indices(system), 1e-3
    assert response.force[rows] == pytest.approx(stepped(level)[rows], abs=1e-6)
    assert (response.force[rows] > 5.0).all()
    for i in active[:6]:
        up, down = level.copy(), level.copy()
        up[i], down[i] = up[i] + near, max(down[i] - near, 0.0)
        change = (stepped(up) - stepped(down))[rows] / (up[i] - down[i])
        # The response holds the directions of the curved joints: an error of first order in h, 2e-4.
        assert response.force_slope[rows, i] == pytest.approx(change, rel=1e-3)


def pressing(t, force) -> ContactForceTarget:
    name = pressed_block().contact.names[0]
    return ContactForceTarget((name,), np.asarray(t), np.asarray(force, float)[:, None], 1e-3)


def test_the_derivatives_of_contact_forces_are_those_of_the_step():
    """Of steps with a small tolerance, because a step leaves gaps up to it."""
    system, a, h = pressed_block(), np.array([0.3, 0.3]), 0.01
    euler, state = sim.LinearlyImplicitEuler(), system.rest_state()

    def stepped(a):
        control = sim.Control(a, state.t + h)
        return euler.step(system, state, control, h, sim.Workspace(system))[0]

    for _ in range(4):
        state = stepped(a)
    one = pressing([0.0], [0.0])
    indices = one.indices(system)
    response = step_response(
        system, euler, state, a, h, sim.Workspace(system), ActiveForces(system)
    )
    force, slope = one.response(response, indices)
    assert (
        force == pytest.approx(one.reached(system, stepped(a), indices), rel=1e-6)
        and force[0] > 1e-3
    )
    for i in range(2):
        way = 1e-3 * np.eye(2)[i]
        ends = [one.reached(system, stepped(a + s * way), indices)[0] for s in (1.0, -1.0)]
        assert slope[0, i] == pytest.approx((ends[0] - ends[1]) / 2e-3, rel=1e-5)


def test_a_block_presses_with_the_wanted_force():
    system = pressed_block()
    wanted = pressing([0.0, 0.1, 0.2], [0.0, 0.02, 0.02])
    tracked, end = track(
        system, [], duration=0.2, forces=[wanted],
        initial=None, weights=Weights(size=1e-6, change=1e-3, jump=0.2),
    )  # fmt: skip
    assert wanted.reached(system, end, wanted.indices(system)) == pytest.approx([0.02], rel=0.01)
    assert float(tracked["activation"].max()) < 1.0


def test_targets_that_a_scene_does_not_have_are_refused(jaw):
    with pytest.raises(sim.SceneError, match="no row 'bite_L'.*because it has no joints"):
        bite([0.0], [[0, 0]]).indices(block())
    with pytest.raises(sim.SceneError, match="no row 'tooth', expected one of tmj_L"):
        RowForceTarget(("tooth",), STILL, np.zeros((1, 1))).indices(jaw[1])
    with pytest.raises(sim.SceneError, match="no pairing .*because it has no contact"):
        pressing([0.0], [0.0]).indices(block())
    with pytest.raises(sim.SceneError, match="not targets in a scene with joints"):
        pressing([0.0], [0.0]).indices(jaw[1])
    with pytest.raises(sim.SceneError, match="length 2"):
        SeparationTarget(np.array([0]), np.array([1]), STILL, STILL, (0.0, 0.0, 2.0))
    with pytest.raises(sim.SceneError, match="2 points, expected at least 3"):
        area([0, 1])
    with pytest.raises(sim.SceneError, match="no points"):
        SeparationTarget(np.array([0]), np.zeros(0, int), STILL, STILL)
    with pytest.raises(sim.SceneError, match=r"shape \(1, 3\)"):
        bite([0.0], [[0, 0, 0]])
