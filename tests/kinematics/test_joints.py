"""Joints against closed forms: derivatives, freedoms, a pendulum, drift, limits and redundancy."""

import numpy as np
import pytest

import sim
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
from sim.linear import linear_solver
from tests.bodies import grid
from tests.kinematics.scenes import INERTIA, mixed_system, random_pose

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


TIGHT = {"tolerance": 1e-12, "residual_tolerance": 1e-8}


@pytest.mark.parametrize(
    "integrator, duration, steps",
    [
        (sim.LinearlyImplicitEuler(), 0.2, (40, 80, 160)),
        (sim.RungeKutta4(), 0.2, (20, 40, 80)),
        (sim.Sdirk2(**TIGHT), 0.1, (10, 20, 40)),
        (sim.Trapezoidal(**TIGHT), 0.1, (10, 20, 40)),
    ],
)
def test_order_and_drift_with_a_joint(integrator, duration, steps):
    system = pendulum()
    start = swung(system, 6.0)
    ends = [run(system, start, duration, n, integrator)[1] for n in steps]
    d = [np.abs(b.frames - a.frames).max() for a, b in zip(ends, ends[1:], strict=False)]
    # errors of the Runge-Kutta method still decrease faster than asymptotically: 4.6, then 4.4
    assert np.log2(d[0] / d[1]) > integrator.order - 0.1
    for end in ends:
        now = system.rows.evaluate(end.pose)
        assert np.abs(now.c).max() < 1e-12
        assert np.abs(now.G @ end.twists.ravel()).max() < 1e-10


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
    with pytest.raises(sim.SceneError, match="refers to body 'chin'"):
        pendulum(Spherical("ball", "chin", "bob", (0.0, 0.0, 0.0)))
    with pytest.raises(sim.SceneError, match="acts on nothing that moves"):
        pendulum(Spherical("ball", None, None, (0.0, 0.0, 0.0)))
    with pytest.raises(sim.SceneError, match="holds rigid joints alone"):
        soft = Weld("bond", None, "bob", (0.0, 0.0, -ARM), compliance=1e-4)
        run(pendulum(soft), pendulum(soft).rest_state(), 0.01, 1, sim.RungeKutta4())


def order_with_joints_and_tissue(cls):
    """Order, and violation of rigid rows at the end [m].

    Tissue on a body that turns about a ball and yields to a damped bond, which steps resolve.
    """
    ball = Spherical("ball", "jaw", None, (0.0, 0.0, 0.0))
    bond = Weld("bond", "skull", "jaw", (0.01, 0.0, 0.0), compliance=25.0, damping_time=0.002)
    system = mixed_system(prescribed=False, joints=(ball, bond))
    w = np.zeros(system.pattern.n)
    w[system.kinematics.first :][3:6] = 3.0, 20.0, -10.0
    pose, w, _ = system.rows.projected(system.rest_state().pose, w)
    start = system.kinematics.state(pose, w, {})
    drive = sim.Activation(np.array([0.0, 1.0]), np.array([[0.1, 0.2], [0.3, 0.1]]))
    ends = [
        sim.simulate(
            system,
            drive,
            duration=0.001,
            steps=sim.FixedStep(0.001 / n),
            every=0.001,
            integrator=cls(tolerance=1e-12, residual_tolerance=1e-11),
            initial=start,
            probes=(),
        )[1]
        for n in (10, 20, 40)
    ]
    pairs = zip(ends, ends[1:], strict=False)
    change = [np.linalg.norm(system.kinematics.between(b.pose, a.pose)) for a, b in pairs]
    left = np.abs(system.rows.evaluate(ends[-1].pose).c[system.rows.rigid]).max()
    return float(np.log2(change[0] / change[1])), float(left)


@pytest.mark.parametrize("cls", [sim.ConvergedEuler, sim.Trapezoidal, sim.Sdirk2])
def test_converged_integrators_keep_their_order_with_joints_and_tissue(cls):
    order, left = order_with_joints_and_tissue(cls)
    assert abs(order - cls.order) < 0.1
    assert left < 1e-12


def test_forces_of_joints_do_not_limit_the_residual():
    """A stiff damped bond, whose moment is 1e11 times the tolerance of the residual."""
    ball = Spherical("ball", "jaw", None, (0.0, 0.0, 0.0))
    bond = Weld("bond", "skull", "jaw", (0.01, 0.0, 0.0), compliance=1e-3, damping_time=0.02)
    system = mixed_system(prescribed=False, joints=(ball, bond))
    w = np.zeros(system.pattern.n)
    w[system.kinematics.first :][3:6] = 3.0, 20.0, -10.0
    pose, w, _ = system.rows.projected(system.rest_state().pose, w)
    start, work = system.kinematics.state(pose, w, {}), sim.Workspace(system)
    control = system.control(np.full(len(system.muscles), 0.2))
    end, report = sim.Trapezoidal(**TIGHT).step(system, start, control, 0.001, work)
    assert np.abs(end.memory["joints"]).max() > 1e3
    assert report.residual < 1e-8


def equilibrium(system, state):
    """State of `Static`."""
    control, work = system.control(np.zeros(len(system.muscles))), sim.Workspace(system)
    return sim.Static().step(system, state, control, 1.0, work)[0]


def test_static_finds_where_a_pendulum_hangs():
    """From 2.5 rad; the hinge carries the weight, and only the rows have a stiffness."""
    system, angle = pendulum(), 2.5
    turned = np.array([ARM * np.sin(-angle), 0.0, ARM - ARM * np.cos(angle), 0.0, angle, 0.0])
    start = system.rest_state()
    pose = system.kinematics.advance(start.pose, turned, 0.0)
    assert np.abs(system.rows.evaluate(pose).c).max() < 1e-12
    end = equilibrium(system, system.kinematics.state(pose, np.zeros(6), {}))
    np.testing.assert_allclose(end.frames[0, :3], [0.0, 0.0, -ARM], atol=1e-7)
    end_of = end.frames[None], end.q[None], end.memory["joints"][None]
    force, moment = (x[0] for x in system.rows.reactions(*end_of))
    np.testing.assert_allclose(force[0], [0.0, 0.0, MASS * G], atol=1e-6)
    np.testing.assert_allclose(moment[0], 0.0, atol=1e-6)


def test_static_with_limits_and_yielding_joints():
    """A hinge presses on its stop with the moment of the weight; a soft weld sags by C m g."""
    hinge = Revolute("hinge", None, "bob", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    stop = Limit("stop", None, "bob", (0, 0, 0), (0.0, 1.0, 0.0), lower=-0.1, upper=0.2)
    system = pendulum(hinge, stop, terms=(sim.Gravity((3.0, 0.0, -G)),))
    end = equilibrium(system, system.rest_state())
    angle = 2.0 * np.arcsin(end.frames[0, 5])
    assert angle == pytest.approx(-0.1, abs=1e-9)
    moment = MASS * ARM * (3.0 * np.cos(0.1) - G * np.sin(0.1))
    assert end.memory["joints"].max() == pytest.approx(moment, rel=1e-6)
    soft = Weld("bond", None, "bob", (0.0, 0.0, -ARM), compliance=1e-4)
    end = equilibrium(pendulum(soft), pendulum(soft).rest_state())
    assert end.frames[0, 2] + ARM == pytest.approx(-1e-4 * MASS * G, rel=1e-6)


def bar_after_half_a_period():
    """Angle over its amplitude, and momentum about the hinge over that at the start, of a stiff bar on a
    clamp, T = 2 pi sqrt(I/(M g a)) of both together.

    In a law of the small strain a rotation relieves the tension of the weight, which would lower the
    rate to a half. Linearly implicit steps hold rows in their directions at the start, so that the
    amplitude would grow by 1 %.
    """
    mesh = grid((1, 1, 6), (0.004, 0.004, 0.06))
    top = np.flatnonzero(mesh.X[:, 2] == 0.06)
    clamp, pivot = sim.Body("clamp", 0.002, INERTIA, (0.002, 0.002, 0.062)), [0.002, 0.002, 0.07]
    hinge = Revolute("hinge", None, "clamp", np.array(pivot), (0.0, 1.0, 0.0))
    solid = sim.Solid((sim.Material(sim.CoRotational(1e9, 0.3)),))
    system = sim.compile_scene(
        sim.Scene(
            mesh, (solid, *WEIGHT), (sim.OnBody("clamp", top),), bodies=(clamp,), joints=(hinge,)
        )
    )
    arm = system.mesh.X - pivot
    inertia = INERTIA[1, 1] + float(system.node_mass @ (arm[:, 0] ** 2 + arm[:, 2] ** 2))
    rate = np.sqrt(-G * float(system.node_mass @ arm[:, 2]) / inertia)
    n, omega0 = system.kinematics.first, 1e-3
    turning = np.cross([0.0, omega0, 0.0], arm)
    free = np.setdiff1d(np.arange(mesh.n_nodes), top)
    w = np.concatenate([turning[free].ravel(), turning[-1], [0.0, omega0, 0.0]])
    assert n == 3 * len(free)
    start = system.kinematics.state(system.rest_state().pose, w, {})
    _, end = run(system, start, np.pi / rate, 100, sim.Trapezoidal(**TIGHT))
    # after half a period the angle has passed zero, and the momentum about the hinge is opposite;
    # the velocity of the clamp itself contains vibrations of the bar
    angle = 2.0 * end.frames[0, 5]
    momentum = system.node_mass @ np.cross(end.q - pivot, end.v)[:, 1]
    momentum += INERTIA[1, 1] * end.twists[0, 4]
    return angle / (np.pi * omega0 / rate), momentum / (inertia * omega0)


def test_a_finite_element_bar_on_a_hinged_body_swings_with_its_period():
    angle, momentum = bar_after_half_a_period()
    assert abs(angle) < 2e-3
    assert momentum == pytest.approx(-1.0, rel=2e-3)


@pytest.mark.parametrize("volume", [sim.ElementVolume, sim.NodalVolume])
def test_joints_with_an_older_factor_and_matrix_free_products(volume):
    """A block on a body with a hinge, iterative as from 4000 unknowns on, and direct."""
    mesh = grid((4, 3, 3), (0.03, 0.02, 0.02))
    left = np.flatnonzero(mesh.X[:, 0] == 0.0)
    jaw = sim.Body("jaw", 0.01, INERTIA, (-0.005, 0.01, 0.01))
    joints = (
        Revolute("hinge", None, "jaw", (-0.01, 0.0, 0.01), (0.0, 1.0, 0.0)),
        Weld("bond", None, "jaw", (-0.01, 0.01, 0.01), compliance=1e-3, damping_time=0.01),
        Limit("stop", None, "jaw", (-0.01, 0.0, 0.01), (0.0, 1.0, 0.0), lower=-0.5, upper=0.005),
    )
    terms = sim.Solid(), volume(), *WEIGHT
    scene = sim.Scene(
        mesh, terms, (sim.OnBody("jaw", left),), sim.RestRayleigh(), bodies=(jaw,), joints=joints
    )
    system = sim.compile_scene(scene)
    ends = []
    direct = linear_solver().name
    for linear in (f"gmres_{direct}", direct):
        work, state, control = (
            sim.Workspace(system, linear),
            system.rest_state(),
            system.control([]),
        )
        for _ in range(6):
            state, _ = sim.LinearlyImplicitEuler().step(system, state, control, 0.005, work)
        ends.append(state)
    assert np.abs(ends[0].q - system.rest_state().q).max() > 1e-4
    np.testing.assert_allclose(ends[0].q, ends[1].q, atol=4e-6)
    np.testing.assert_allclose(*(end.memory["joints"] for end in ends), rtol=1e-3, atol=1e-3)
