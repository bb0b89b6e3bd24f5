"""Joints against closed forms: derivatives, freedoms, a pendulum, drift, limits and redundancy."""

import numpy as np
import pytest

import sim
from sim.integrators.held import held_solution
from sim.joints import (
    JOINTS,
    Bushing,
    Limit,
    PointOnCurve,
    PointOnPlane,
    Revolute,
    Spherical,
    Weld,
)
from sim.step_matrices import damping_matrix, implicit_matrix
from tests.kinematics.scenes import INERTIA, dense, mixed_system, random_pose

ARM, MASS, G = 0.1, 0.2, 9.8
AXIS = (0.3, 0.4, 0.5)
PLACE = {"name": "j", "a": "skull", "b": "jaw", "origin": (0.01, 0.02, 0.0), "axis": AXIS}
WEIGHT = (sim.Gravity((0.0, 0.0, -G)),)
POINT = {"name": "j", "point": 0, "body": "skull", "origin": (0.0, 0.0, 0.01), "normal": AXIS}
MADE = {
    Bushing: {**PLACE, "stiffness": (1e2, 2e2, 3e2, 1.0, 2.0, 3.0)},
    Limit: {**PLACE, "lower": -0.2, "upper": 0.3},
    PointOnPlane: POINT,
    PointOnCurve: {
        **POINT,
        "forward": (1.0, 0.0, 0.0),
        "coefficients": np.array([0.0, -0.7, 30.0, -300.0]),
        "reach": (0.0, 0.012),
    },
}


def two_bodies(*joints, **more) -> sim.System:
    jaw = sim.Body("jaw", MASS, INERTIA, (0.02, 0.01, 0.0))
    skull = sim.Body("skull", 0.5, 2.0 * INERTIA, (-0.03, 0.0, 0.01))
    point, on = np.array([[0.03, 0.01, 0.02]]), sim.OnBody("jaw", np.array([0]))
    return sim.compile_scene(
        sim.Scene(
            sim.NO_TISSUE, (), (on,), bodies=(jaw, skull), points=point, joints=joints, **more
        )
    )


@pytest.mark.parametrize("cls", JOINTS)
def test_rows_have_the_derivative_of_their_values(cls):
    system = two_bodies(cls(**MADE.get(cls, PLACE)))
    rows, maps = system.rows, system.kinematics
    pose, _ = random_pose(system, size=0.5)
    now, size = rows.evaluate(pose), 1e-6
    if cls is not Limit:
        rest = rows.evaluate(system.rest_state().pose).c
        assert cls in MADE or np.abs(rest).max() < 1e-15
    for k, column in enumerate(rows.columns):
        step = np.zeros(system.pattern.n)
        step[column] = size
        ends = [rows.evaluate(maps.advance(pose, s * step, pose.t)).c for s in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / (2.0 * size)
        if cls is Limit:  # exact if the axes of both bodies are equal
            continue
        np.testing.assert_allclose(slope, now.G[:, k], atol=1e-8)


def pendulum(*joints, damping=(0.0, 0.0), terms=WEIGHT) -> sim.System:
    """A body that hangs from a hinge along y."""
    bob = sim.Body("bob", MASS, INERTIA, (0.0, 0.0, -ARM), damping)
    hinge = Revolute("hinge", None, "bob", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    return sim.compile_scene(
        sim.Scene(sim.NO_TISSUE, terms, bodies=(bob,), joints=(*(joints or (hinge,)),))
    )


def swung(system, omega):
    """Rest with an angular velocity about y around the hinge."""
    w = np.array([-ARM * omega, 0.0, 0.0, 0.0, omega, 0.0])
    return system.kinematics.state(system.rest_state().pose, w, {})


def run(system, start, duration, steps, integrator, every=None, probes=()):
    return sim.simulate(
        system,
        sim.resting(0),
        duration=duration,
        steps=sim.FixedStep(duration / steps),
        every=every or duration,
        integrator=integrator,
        initial=start,
        probes=probes,
    )


def test_compound_pendulum_has_its_period():
    """T = 2 pi sqrt(I/(m g a)) of small oscillations."""
    system = pendulum()
    about_hinge = INERTIA[1, 1] + MASS * ARM**2
    omega0, rate = 1e-4, np.sqrt(MASS * G * ARM / about_hinge)
    _, end = run(system, swung(system, omega0), np.pi / rate, 100, sim.RungeKutta4())
    # After half a period the angle has the opposite sign; a delay would change it.
    angle = 2.0 * end.frames[0, 5]
    assert abs(angle) < 1e-6 * omega0 / rate * np.pi
    assert end.twists[0, 4] == pytest.approx(-omega0, rel=1e-6)


@pytest.mark.parametrize(
    "integrator, steps",
    [(sim.LinearlyImplicitEuler(), (40, 80, 160)), (sim.RungeKutta4(), (20, 40, 80))],
)
def test_order_and_drift_with_a_joint(integrator, steps):
    system = pendulum()
    start = swung(system, 6.0)
    ends = [run(system, start, 0.2, n, integrator)[1] for n in steps]
    d = [np.abs(b.frames - a.frames).max() for a, b in zip(ends, ends[1:], strict=False)]
    # errors of the Runge-Kutta method still decrease faster than asymptotically: 4.6, then 4.4
    assert np.log2(d[0] / d[1]) > integrator.order - 0.1
    for end in ends:
        now = system.rows.evaluate(end.pose)
        assert np.abs(now.c).max() < 1e-12
        assert np.abs(now.G @ end.twists.ravel()).max() < 1e-10


def test_rows_by_the_schur_complement_equal_the_full_saddle_system():
    """Dense solution of [A -h G'; G 0] for tissue, bodies, and a rigid and a compliant joint."""
    ball = Spherical("ball", "jaw", None, (0.0, 0.0, 0.0))
    bond = Weld("bond", "skull", "jaw", (0.01, 0.0, 0.0), compliance=1e-3, damping_time=0.02)
    system = mixed_system(prescribed=False, joints=(ball, bond))
    pose, _ = random_pose(system, size=0.3)
    control, h, rows = system.control(np.full(len(system.muscles), 0.2)), 2e-3, system.rows
    here, K = system.tangent(pose.q, control)
    D = damping_matrix(system, pose, np.zeros_like(pose.q), control, K)
    A = implicit_matrix(system, pose, here, K, D, h, h * h)
    rhs = np.random.default_rng(0).normal(size=system.pattern.n) * 1e-6
    work, start = sim.Workspace(system), np.zeros(system.pattern.n)
    found, f = held_solution(system, rows, A, rhs, start, pose, h, 1e-12, work)
    now, m, n = rows.evaluate(pose), len(rows.names), system.pattern.n
    G = np.zeros((m, n))
    G[:, rows.columns] = now.G
    time = np.where(rows.rigid, np.inf, h + rows.damping_time)
    saddle = np.block([[dense(system, A.values), -h * G.T], [G, np.diag(rows.compliance / time)]])
    expected = np.linalg.solve(saddle, np.concatenate([rhs, -now.drift - now.c / time]))
    np.testing.assert_allclose(found.x, expected[:n], atol=1e-9 * np.abs(expected[:n]).max())
    np.testing.assert_allclose(f, expected[n:], atol=1e-9 * np.abs(expected[n:]).max())


def test_limits_stop_and_release_a_motion():
    """A pendulum at its upper limit stays there until gravity accelerates it back."""
    hinge = Revolute("hinge", None, "bob", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    system = pendulum(
        hinge, Limit("stop", None, "bob", (0, 0, 0), (0.0, 1.0, 0.0), lower=-0.3, upper=0.2)
    )
    angles = []
    state = swung(system, 5.0)
    for _ in range(30):
        _, state = run(system, state, 0.01, 2, sim.LinearlyImplicitEuler())
        angles.append(2.0 * np.arcsin(state.frames[0, 5]))
    assert max(angles) == pytest.approx(0.2, abs=1e-9)
    assert angles[-1] < 0.1


def test_yielding_row_is_a_spring():
    """The displacement of a weight on a weld of compliance C at rest is C m g."""
    compliance = 1e-4
    soft = Weld("bond", None, "bob", (0.0, 0.0, -ARM), compliance=compliance, damping_time=0.05)
    system = pendulum(soft)
    _, end = run(system, system.rest_state(), 2.0, 100, sim.LinearlyImplicitEuler())
    assert end.frames[0, 2] + ARM == pytest.approx(-compliance * MASS * G, rel=1e-6)


def test_redundant_and_unknown_joints_are_named():
    ball = Spherical("ball", None, "bob", (0.0, 0.0, 0.0))
    with pytest.raises(sim.SceneError, match="joint row 'other travel z' repeats rows before it"):
        pendulum(ball, Spherical("other", None, "bob", (0.0, 0.0, -ARM)))
    with pytest.raises(sim.SceneError, match="names body 'chin'"):
        pendulum(Spherical("ball", "chin", "bob", (0.0, 0.0, 0.0)))
    with pytest.raises(sim.SceneError, match="acts on nothing that moves"):
        pendulum(Spherical("ball", None, None, (0.0, 0.0, 0.0)))
    with pytest.raises(sim.SceneError, match="Sdirk2 does not hold joints"):
        run(pendulum(), swung(pendulum(), 1.0), 0.01, 1, sim.Sdirk2())
    with pytest.raises(sim.SceneError, match="holds rigid joints alone"):
        soft = Weld("bond", None, "bob", (0.0, 0.0, -ARM), compliance=1e-4)
        run(pendulum(soft), pendulum(soft).rest_state(), 0.01, 1, sim.RungeKutta4())
