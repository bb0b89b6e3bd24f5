"""Stiff tissue that turns: steps with one linear solution warn of the swing that they lose."""

import warnings

import numpy as np
import pytest

import sim
from sim import LinearlyImplicitEuler, LinearlyImplicitTrapezoidal, LostSwingWarning, Sdirk2
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
    ) as told:
        angle, moved = turned(young, integrator)
    assert angle < 0.97 * pendulum()
    (lost,) = (one.message for one in told if one.category is LostSwingWarning)
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
