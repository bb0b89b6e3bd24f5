"""Stiff tissue that turns: steps with one linear solution warn of the swing that they lose."""

import warnings

import numpy as np
import pytest

import sim
from sim import LinearlyImplicitEuler, LinearlyImplicitTrapezoidal, LostSwingWarning, Sdirk2
from sim.joints import Bushing, Revolute
from tests.bodies import grid, solid_system

LENGTH, N, UNTIL, H = 0.1, 4, 0.1, 5e-3  # m, elements, s, s
LINEAR = (LinearlyImplicitEuler(), LinearlyImplicitTrapezoidal())


def pinned_bar(young, damping=None):
    """Bar of 1000 kg/m3 along x that hangs on a hinge along y, and the node at its end."""
    mesh = grid((N, 1, 2), (LENGTH, 0.01, 0.01))
    middle = np.isclose(mesh.X[:, 2], 0.005)
    hinge = middle & np.isclose(mesh.X[:, 0], 0.0)
    system = solid_system(
        mesh, sim.MooneyRivlin(young / 6.0, 0.0), sim.QuadraticBulk(young), damping=damping,
        reductions=(sim.Fixed(hinge),), terms=(sim.Gravity((0.0, 0.0, -9.81)),),
    )  # fmt: skip
    return system, int(np.flatnonzero(middle & np.isclose(mesh.X[:, 0], LENGTH))[0])


def turned(young, integrator, h=H, damping=None, until=UNTIL):
    """Angle of the bar at the end [rad], and the trajectory."""
    system, end = pinned_bar(young, damping)
    moved, final = sim.simulate(
        system, sim.resting(0), duration=until, integrator=integrator, steps=sim.FixedStep(h)
    )
    away = final.q[end] - [0.0, 0.0, 0.005]
    return float(np.arctan2(-away[2], away[0])), moved


def inertia():
    """Moment of inertia of the masses of the nodes per mass [m2]."""
    return LENGTH**2 / 3.0 * (1.0 + 0.5 / N**2) + 0.5 * 0.005**2


def pendulum(until=UNTIL, steps=4000):
    """Angle of a rigid bar from the horizontal, theta'' = g L/2 / I cos theta, by symplectic Euler."""
    theta, omega, h = 0.0, 0.0, until / steps
    for _ in range(steps):
        omega += h * 0.5 * 9.81 * LENGTH / inertia() * np.cos(theta)
        theta += h * omega
    return theta


@pytest.mark.parametrize("integrator", LINEAR, ids=lambda i: type(i).__name__)
@pytest.mark.parametrize("young", [1e7, 1e8, 1e9])
def test_a_bar_that_turns_too_slowly_is_warned_of(young, integrator):
    with pytest.warns(
        LostSwingWarning, match=r"take \d+ % of the energy.*node \d+.*Sdirk2"
    ) as warned:
        angle, moved = turned(young, integrator)
    assert angle < 0.97 * pendulum()
    (lost,) = (one.message for one in warned if one.category is LostSwingWarning)
    assert lost.share > 0.1 and 0.0 < lost.time <= UNTIL and lost.node >= 0
    assert moved.attrs["swing_lost"] == lost.share
    assert moved.attrs["swing_lost_node"] == lost.node


def test_the_share_is_the_missing_kinetic_energy():
    """The bar swings through an angle whose speed, sqrt(3 g sin(theta)/L), energy requires."""
    with pytest.warns(LostSwingWarning):
        _, moved = turned(1e7, LinearlyImplicitEuler())
    angle, later = (turned_quietly(1e7, until) for until in (UNTIL, UNTIL + H))
    speed = (later - angle) / H
    middle = 0.5 * (angle + later)
    missing = 1.0 - speed**2 / (9.81 * LENGTH * np.sin(middle) / inertia())
    assert moved.attrs["swing_lost"] == pytest.approx(missing, abs=0.1)


def turned_quietly(young, until):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LostSwingWarning)
        return turned(young, LinearlyImplicitEuler(), until=until)[0]


def test_methods_that_iterate_swing_as_a_rigid_bar_without_a_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error", LostSwingWarning)
        angle, moved = turned(1e7, Sdirk2())
    assert angle == pytest.approx(pendulum(), rel=0.02)
    assert "swing_lost" not in moved.attrs


def test_short_steps_and_damped_tissue_are_not_warned_of():
    with warnings.catch_warnings():
        warnings.simplefilter("error", LostSwingWarning)
        angle, _ = turned(1e5, LinearlyImplicitTrapezoidal(), h=2.5e-4)
        damped, _ = turned(3e4, LinearlyImplicitEuler(), damping=sim.RestRayleigh(19.0, 0.055))
    assert angle > 0.97 * pendulum()
    assert damped > 0.0


def hinged(young, hard, joints=(), damping=None):
    """The bar on a body of 1 g that a hinge or other joints hold, or hinged itself, of hard volume."""
    mesh = grid((N, 1, 2), (LENGTH, 0.01, 0.01))
    root, middle = np.isclose(mesh.X[:, 0], 0.0), np.isclose(mesh.X[:, 2], 0.005)
    bulk = sim.QuadraticBulk(0.0 if hard else young)
    solid = sim.Solid((sim.Material(sim.MooneyRivlin(young / 6.0, 0.0), bulk, 1000.0),))
    body = sim.Body("root", 1e-3, 1e-8 * np.eye(3), (0.0, 0.005, 0.005))
    hinge = Revolute("hinge", "root", None, (0.0, 0.005, 0.005), (0.0, 1.0, 0.0))
    constraint = sim.Fixed(root & middle) if hard else sim.OnBody("root", root)
    scene = sim.Scene(
        mesh, (solid, sim.Gravity((0.0, 0.0, -9.81))), (constraint,), damping,
        bodies=() if hard else (body,), joints=() if hard else (hinge, *joints),
        constraints=(sim.HardElementVolume(0, 1),) if hard else (),
    )  # fmt: skip
    end = int(np.flatnonzero(middle & np.isclose(mesh.X[:, 0], LENGTH))[0])
    return sim.compile_scene(scene), end


def swung(scene, integrator, h=H, until=UNTIL):
    """Angle of a hinged bar at the end [rad]."""
    system, end = scene
    _, final = sim.simulate(
        system, sim.resting(0), duration=until, integrator=integrator,
        steps=sim.FixedStep(h), every=H, probes=(),
    )  # fmt: skip
    away = final.q[end] - [0.0, 0.0, 0.005]
    return float(np.arctan2(-away[2], away[0]))


@pytest.mark.parametrize("integrator", LINEAR, ids=lambda i: type(i).__name__)
@pytest.mark.parametrize("young", [1e7, 1e9])
@pytest.mark.parametrize("hard", [False, True], ids=["on a body with a joint", "hard volume"])
def test_bodies_joints_and_hard_volumes_are_examined(hard, young, integrator):
    with pytest.warns(LostSwingWarning) as warned:
        angle = swung(hinged(young, hard), integrator)
    with warnings.catch_warnings():
        warnings.simplefilter("error", LostSwingWarning)
        assert angle < 0.98 * swung(hinged(young, hard), Sdirk2())
    # The kinetic energy grows with the angle: a smaller angle at the end is a loss of about its share.
    (lost,) = (one.message for one in warned if one.category is LostSwingWarning)
    assert 0.1 < lost.share < 1.0


SPRING = Bushing(
    "spring", "root", None, (0.0, 0.005, 0.005), (0.0, 1.0, 0.0),
    stiffness=(0.0, 0.0, 0.0, 0.0, 0.0, 0.02),
)  # fmt: skip


@pytest.mark.parametrize("joints", [(), (SPRING,)], ids=["free", "spring"])
@pytest.mark.parametrize("integrator", LINEAR, ids=lambda i: type(i).__name__)
def test_springs_of_joints_are_no_loss_of_swing(joints, integrator):
    """The energy that they store is theirs."""
    scene = hinged(1e5, False, joints)
    with warnings.catch_warnings():
        warnings.simplefilter("error", LostSwingWarning)
        angle = swung(scene, integrator, h=5e-4)
    free = swung(hinged(1e5, False), Sdirk2(), h=5e-4)
    assert abs(angle - free) > 0.01 if joints else angle == pytest.approx(free, rel=0.02)


def test_hard_volumes_in_short_steps_are_not_warned_of():
    with warnings.catch_warnings():
        warnings.simplefilter("error", LostSwingWarning)
        swung(hinged(1e5, True), LinearlyImplicitTrapezoidal(), h=2.5e-4)
        swung(hinged(3e4, True, damping=sim.RestRayleigh(19.0, 0.055)), LinearlyImplicitEuler())
