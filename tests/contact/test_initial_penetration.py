"""Initial penetrations, which are kept or removed at a given speed."""

import numpy as np
import pytest

import sim
from tests.bodies import grid
from tests.contact.scenes import box, moved, system_of

SIZE, DEPTH, SPEED, H = 0.01, 1e-3, 0.02, 0.005
INTEGRATORS = (
    sim.ConvergedEuler,
    sim.Sdirk2,
    sim.LinearlyImplicitEuler,
    sim.LinearlyImplicitTrapezoidal,
)


def inside(depth=DEPTH, motion=None, **contact):
    """A block whose lower side lies at a depth below the top of a plate."""
    mesh = grid((2, 2, 2), (SIZE, SIZE, SIZE))
    plate = box([-0.1, -0.1, depth - 0.05], [0.1, 0.1, depth], "plate", motion)
    pairing = sim.Pairing(sim.boundary_surface(mesh), plate)
    term = sim.ConstraintContact((pairing,), **contact)
    return mesh, system_of(mesh, term, sim.Gravity((0.0, 0.0, -9.81)))


def lowest(states):
    return np.array([state.q[:, 2].min() for state in states])


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_initial_penetrations_are_kept_or_removed_at_the_given_speed(integrator):
    """Depth over time, d(t) = d0 or max(0, d0 - speed t), and its final value."""
    steps = 40
    t = H * np.arange(steps + 1)
    mesh, system = inside()
    kept = lowest(moved(system, integrator(), 12, h=H))
    np.testing.assert_allclose(kept, 0.0, rtol=0, atol=5e-6)
    mesh, system = inside(initial_penetration="removed", removal_speed=SPEED)
    states = moved(system, integrator(), steps, h=H)
    expected = np.minimum(SPEED * t, DEPTH)
    above = lowest(states) - expected
    # in the trapezoidal rule half of the final velocity acts in the next step
    assert above.min() > -5e-6 and above.max() < 5e-6 + 0.5 * SPEED * H
    # the block comes to rest on the plate, which carries its weight
    end = states[-1]
    assert np.abs(end.v).max() < 1e-3
    weight = 9.81 * system.node_mass.sum()
    assert system.contact is not None
    _, _, force = system.contact.measure(end)
    assert force.sum() == pytest.approx(weight, rel=0.05)
    # no faster than the removal, except for its own oscillation
    assert max(state.v[:, 2].mean() for state in states) < 1.2 * SPEED


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_removal_does_the_work_of_a_rising_plate(integrator):
    """Positions and velocities equal those on a plate that rises at this speed."""
    steps = 16

    def rising(t):
        return np.eye(3), np.array([0.0, 0.0, min(SPEED * t, DEPTH)])

    _, system = inside(initial_penetration="removed", removal_speed=SPEED)
    out = moved(system, integrator(), steps, h=H)
    _, system = inside(depth=0.0, motion=rising)
    raised = moved(system, integrator(), steps, h=H)
    for one, other in zip(out, raised, strict=True):
        np.testing.assert_allclose(one.q, other.q, rtol=0, atol=1e-5)
        np.testing.assert_allclose(one.v, other.v, rtol=0, atol=5e-3)


def test_the_depth_does_not_depend_on_the_step_or_on_a_restart():
    _, system = inside(initial_penetration="removed", removal_speed=SPEED)
    coarse = moved(system, sim.ConvergedEuler(), 4, h=0.005)[-1]
    fine = moved(system, sim.ConvergedEuler(), 10, h=0.002)[-1]
    assert lowest([coarse]) == pytest.approx(SPEED * 0.02, abs=5e-6)
    assert lowest([fine]) == pytest.approx(SPEED * 0.02, abs=5e-6)
    halfway = moved(system, sim.ConvergedEuler(), 5, h=0.002)[-1]
    again = moved(system, sim.ConvergedEuler(), 5, h=0.002, initial=halfway)[-1]
    np.testing.assert_allclose(again.q, fine.q, rtol=0, atol=2e-6)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_removal_beyond_the_search_range_takes_one_step(integrator):
    """A depth of 1 mm, twice the search range, is removed within a step of 5 ms."""
    _, system = inside(initial_penetration="removed", removal_speed=1.0)
    states = moved(system, integrator(), 3, h=H)
    assert lowest(states)[1:].min() > DEPTH - 5e-6


def test_impossible_values_are_refused():
    with pytest.raises(sim.SceneError, match="initial_penetration"):
        inside(initial_penetration="gone")
    with pytest.raises(sim.SceneError, match="removal_speed"):
        inside(initial_penetration="removed", removal_speed=0.0)
