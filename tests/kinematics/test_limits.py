"""Limits of joints: bounds beyond half a turn act, and bounds that contradict each other are refused."""

import numpy as np
import pytest

import sim
from sim.errors import NotConverged
from sim.joints import Limit, Prismatic, Revolute, Weld

LINEAR = (sim.LinearlyImplicitEuler(), sim.LinearlyImplicitTrapezoidal())
BODY = sim.Body("b", 0.1, np.diag([1.0, 2.0, 3.0]) * 1e-5)
HINGE = Revolute("hinge", None, "b", (0.0, 0.0, 0.0))
SLIDE = Prismatic("slide", None, "b", (0.0, 0.0, 0.0))


def limit(lower=-np.inf, upper=np.inf, name="stop", **more):
    return Limit(name, None, "b", (0.0, 0.0, 0.0), lower=lower, upper=upper, **more)


def scene(*joints):
    return sim.compile_scene(sim.Scene(sim.NO_TISSUE, (), bodies=(BODY,), joints=joints))


def turned(integrator, omega, *joints, fused=True, steps=300):
    """Angles about the axis, unwrapped, in steps of 10 ms."""
    system = scene(*joints)
    w = np.zeros(6)
    w[5] = omega
    state, work = system.kinematics.state(system.rest_state().pose, w, {}), sim.Workspace(system)
    if not fused:
        work.bodies = None
    angles = [0.0]
    for _ in range(steps):
        state, _ = integrator.step(system, state, system.control(np.zeros(0)), 0.01, work)
        angles.append(2.0 * np.arctan2(state.frames[0, 6], state.frames[0, 3]))
    return np.unwrap(angles)


@pytest.mark.parametrize("integrator", LINEAR)
@pytest.mark.parametrize("fused", [True, False])
@pytest.mark.parametrize(
    ("lower", "upper"), [(-0.5, 4.0), (-4.0, 0.5), (-1.0, 3.1), (-3.1, 3.1), (2.0, 5.0)]
)
def test_both_bounds_hold_beyond_half_a_turn(integrator, fused, lower, upper):
    for omega in (4.0, -4.0):
        angles = turned(integrator, omega, HINGE, limit(lower, upper), fused=fused)
        if lower > 0.0:  # the first step moves the body within the bounds
            assert abs(angles[1:].min() % (2 * np.pi) - lower) < 1e-6 or angles.max() > lower - 1e-6
            continue
        end = upper if omega > 0.0 else lower
        assert abs(angles[-1] - end) < 1e-6
        assert angles.min() > lower - 1e-6 and angles.max() < upper + 1e-6


HOLDING = (
    *LINEAR, sim.ConvergedEuler(), sim.Trapezoidal(), sim.Sdirk2(),
)  # fmt: skip
"""All methods that hold limits; explicit ones refuse them."""


@pytest.mark.parametrize("integrator", HOLDING, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("h", [0.004, 0.002, 0.0007])
def test_a_body_that_hits_a_limit_within_a_step_stays_there(integrator, h):
    """A pendulum falls on its limit, on which its weight holds it: impacts are inelastic.

    Methods of second order once extrapolated the impact, so that it swung back to the other side.
    """
    arm = sim.Body("b", 0.1, np.eye(3) * 2e-5, (0.05, 0.0, 0.0))
    axis = (0.0, 1.0, 0.0)
    joints = (Revolute("hinge", None, "b", (0.0, 0.0, 0.0), axis),
              Limit("stop", None, "b", (0.0, 0.0, 0.0), axis, -0.4, 0.4))  # fmt: skip
    given = sim.Scene(sim.NO_TISSUE, (sim.Gravity(),), bodies=(arm,), joints=joints)
    system = sim.compile_scene(given)
    state, work = system.rest_state(), sim.Workspace(system)
    angles = []
    for _ in range(round(0.2 / h)):
        state, _ = integrator.step(system, state, system.control(np.zeros(0)), h, work)
        angles.append(2.0 * np.arctan2(state.frames[0, 5], state.frames[0, 3]))
    angle = np.array(angles)
    reached = int(np.argmax(angle > 0.4 - 1e-6))
    # 0.06654 s to fall from 0 to 0.4 rad: I theta'' = m g r cos(theta), I = m r^2 + 2e-5 kg m^2
    # (solve_ivp, 1e-10); methods of first order are half a step early
    assert reached * h == pytest.approx(0.06654, abs=2.0 * h)
    np.testing.assert_allclose(angle[reached:], 0.4, atol=2e-6)
    assert abs(state.twists[0]).max() < 1e-5


@pytest.mark.parametrize("integrator", [sim.SymplecticEuler(), sim.RungeKutta4()])
def test_explicit_methods_refuse_limits(integrator):
    system = scene(HINGE, limit(-1.0, 1.0))
    with pytest.raises(sim.SceneError, match="explicit integrator"):
        state, control = system.rest_state(), system.control(np.zeros(0))
        integrator.step(system, state, control, 0.001, sim.Workspace(system))


@pytest.mark.parametrize("bounds", [{"upper": 3.5}, {"upper": np.pi}, {"lower": -4.0}])
def test_a_single_bound_beyond_half_a_turn_is_refused(bounds):
    with pytest.raises(sim.SceneError, match="half a turn or more from rest"):
        limit(**bounds)
    limit(**bounds, travel=True)


def test_bounds_a_turn_apart_are_refused():
    with pytest.raises(sim.SceneError, match="a turn or more"):
        limit(-3.2, 3.2)


CONTRADICTIONS = {
    "two limits": (HINGE, limit(0.3, 1.0, "one"), limit(-1.0, 0.1, "other")),
    "two bounds": (HINGE, limit(lower=0.3, name="one"), limit(upper=-0.1, name="other")),
    "two ways": (
        SLIDE,
        limit(lower=0.02, name="one", travel=True),
        limit(upper=0.01, name="other", travel=True),
    ),
}


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_bounds_that_contradict_each_other_are_refused(name):
    with pytest.raises(sim.SceneError, match="'one lower' and 'other upper' contradict each other"):
        scene(*CONTRADICTIONS[name])


@pytest.mark.parametrize("integrator", LINEAR)
@pytest.mark.parametrize("fused", [True, False])
@pytest.mark.parametrize(
    "joints",
    [
        (Weld("bond", None, "b", (0.0, 0.0, 0.0)), limit(0.3, 1.0)),
        (
            HINGE,
            limit(0.3, 1.0),
            # the same angle about the opposite axis
            Limit("other", None, "b", (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), -0.1, 0.2),
        ),
    ],
    ids=["weld", "opposite axes"],
)
def test_joints_that_cannot_be_met_are_refused_in_the_first_step(integrator, fused, joints):
    with pytest.raises(NotConverged, match="contradict each other|forces did not converge"):
        turned(integrator, 0.0, *joints, fused=fused, steps=1)
