"""Forces and moments of joints, bushings and axial springs against closed forms."""

import numpy as np
import pytest

import sim
from sim.joints import Bushing, PointOnPlane, Revolute, Weld
from tests.kinematics.scenes import INERTIA

MASS, ARM, G = 0.2, 0.1, 9.8
INTEGRATORS = sim.LinearlyImplicitEuler(), sim.RungeKutta4()


def jointed(*joints, centre=(ARM, 0.0, 0.0), terms=(), members=(), points=()) -> sim.System:
    bob = sim.Body("bob", MASS, INERTIA, centre)
    return sim.compile_scene(
        sim.Scene(
            sim.NO_TISSUE,
            (sim.Gravity((0.0, 0.0, -G)), *terms),
            members,
            bodies=(bob,),
            joints=joints,
            points=np.array(points).reshape(-1, 3),
        )
    )


def run(system, integrator, h, n, start=None):
    return sim.simulate(
        system,
        sim.resting(0),
        duration=n * h,
        steps=sim.FixedStep(h),
        every=n * h,
        integrator=integrator,
        initial=start,
        probes=(sim.Reactions(system.rows.joints),),
    )


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_held_lever_carries_its_weight_and_its_moment(integrator):
    """F = m g up, and M = -r x W about the joint, at the start as after steps."""
    motion, _ = run(jointed(Weld("wall", None, "bob", (0.0, 0.0, 0.0))), integrator, 1e-3, 10)
    for k in (0, -1):
        np.testing.assert_allclose(motion.joint_force[0, :, k], [0.0, 0.0, MASS * G], atol=1e-9)
        np.testing.assert_allclose(motion.joint_moment[0, :, k], [0, -ARM * MASS * G, 0], atol=1e-9)
    # with the bodies exchanged, the reaction is that on space
    motion, _ = run(jointed(Weld("wall", "bob", None, (0.0, 0.0, 0.0))), integrator, 1e-3, 10)
    np.testing.assert_allclose(motion.joint_force[0, :, -1], [0.0, 0.0, -MASS * G], atol=1e-9)


def test_a_hinge_carries_weight_and_centripetal_force_of_a_pendulum():
    """N = m g + m a omega^2 below the hinge, whatever its inertia."""
    hinge = Revolute("hinge", None, "bob", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    system, omega = jointed(hinge, centre=(0.0, 0.0, -ARM)), 3.0
    w = np.array([-ARM * omega, 0.0, 0.0, 0.0, omega, 0.0])
    start = system.kinematics.state(system.rest_state().pose, w, {})
    for integrator, h, tolerance in zip(INTEGRATORS, (1e-5, 1e-3), (1e-3, 1e-6), strict=True):
        motion, _ = run(system, integrator, h, 1, start)
        expected = MASS * (G + ARM * omega**2)
        k = 0 if h > 1e-4 else 1
        assert motion.joint_force[0, 2, k] == pytest.approx(expected, rel=tolerance)
        assert abs(float(motion.joint_moment[0, 1, k])) < 1e-9


def test_a_point_on_an_incline_exerts_a_normal_force():
    """The mean force of a sliding point: m g cos(angle) of a body held at its centre."""
    normal = np.array([0.6, 0.0, 0.8])
    plane = PointOnPlane("incline", 0, None, (0.0, 0.0, 0.0), normal, unilateral=True)
    members = (sim.OnBody("bob", np.array([0])),)
    system = jointed(plane, centre=(0.0, 0.0, 0.0), members=members, points=[0.0, 0.0, 0.0])
    motion, end = run(system, sim.LinearlyImplicitEuler(), 1e-3, 100)
    np.testing.assert_allclose(motion.joint_force[0, :, -1], MASS * G * 0.8 * normal, atol=1e-9)
    slide = np.array([0.8, 0.0, -0.6])
    assert end.twists[0, :3] @ slide == pytest.approx(G * 0.6 * 0.1, rel=1e-9)
    assert np.isnan(motion.joint_force[..., 0]).all()  # there was no step yet


def test_a_bushing_deforms_according_to_its_stiffness():
    """The body sinks by m g/k and rotates by theta with k theta = m g a cos(theta)."""
    k, turn = 500.0, 0.5
    bushing = Bushing(
        "band",
        None,
        "bob",
        (0.0, 0.0, 0.0),
        stiffness=(k, k, k, turn, turn, turn),
        damping=(5.0, 5.0, 5.0, 0.02, 0.02, 0.02),
    )
    motion, end = run(jointed(bushing), sim.LinearlyImplicitEuler(), 5e-3, 600)
    theta = 2.0 * np.arcsin(end.frames[0, 5])
    assert turn * theta == pytest.approx(MASS * G * ARM * np.cos(theta), rel=1e-6)
    assert theta > 0.3
    np.testing.assert_allclose(motion.joint_force[0, :, -1], [0.0, 0.0, MASS * G], atol=1e-6)
    np.testing.assert_allclose(motion.joint_moment[0, :, -1], [0.0, -turn * theta, 0.0], atol=1e-6)
    place = end.frames[0, :3] - ARM * np.array([np.cos(theta), 0.0, -np.sin(theta)])
    np.testing.assert_allclose(place, [0.0, 0.0, -MASS * G / k], atol=1e-7)


def test_an_axial_spring_holds_a_weight():
    """L = L_rest + m g/k along a line to the centre."""
    k, rest = 100.0, 0.05
    springs = sim.AxialSprings((np.array([0, 1]),), k, 5.0, np.array([rest]))
    members = sim.Fixed(np.array([0])), sim.OnBody("bob", np.array([1]))
    points = [[0.0, 0.0, 0.08], [0.0, 0.0, 0.0]]
    system = jointed(centre=(0, 0, 0), terms=(springs,), members=members, points=points)
    state, work = system.rest_state(), sim.Workspace(system)
    for _ in range(200):
        step = sim.LinearlyImplicitEuler().step
        state, _ = step(system, state, system.control(np.zeros(0)), 0.01, work)
    assert 0.08 - state.q[1, 2] == pytest.approx(rest + MASS * G / k, rel=1e-9)


def test_numbers_and_names_of_joints_are_checked():
    with pytest.raises(sim.SceneError, match="damping only where there is stiffness"):
        Bushing("b", None, "bob", (0, 0, 0), damping=(1.0,) * 6)
    with pytest.raises(sim.SceneError, match="rest lengths for 1"):
        sim.AxialSprings((np.array([0, 1]),), 1.0, rest=np.zeros(2))
    with pytest.raises(sim.SceneError, match="the probe Reactions refers to"):
        system = jointed(Weld("wall", None, "bob", (0.0, 0.0, 0.0)))
        sim.Reactions(("floor",)).record(
            system, system.rest_state(), system.control(np.zeros(0)), None
        )
