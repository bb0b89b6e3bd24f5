"""Force of a morsel between a body and a plane."""

from dataclasses import replace

import numpy as np
import pytest

import sim

UP = np.array([0.0, 0.0, 1.0])


def falling(height, **options):
    """A body above a plane with a morsel."""
    body = sim.Body("bob", 0.1, 1e-5 * np.eye(3), (0.0, 0.0, height), (20.0, 1e-4))
    morsel = sim.Crushable(0, np.zeros(3), UP, **options)
    attached = sim.OnBody("bob", np.array([0]))
    terms = (sim.Gravity((0.0, 0.0, -9.8)), morsel)
    point = np.array([[0.0, 0.0, height]])
    return sim.compile_scene(
        sim.Scene(sim.NO_TISSUE, terms, (attached,), bodies=(body,), points=point)
    )


def height_after(system, duration):
    _, end = sim.simulate(
        system,
        sim.resting(0),
        duration=duration,
        steps=sim.FixedStep(2e-3),
        every=duration,
        integrator=sim.LinearlyImplicitEuler(),
        probes=(),
    )
    return end.frames[0, 2]


def test_an_intact_morsel_carries_a_weight_and_a_crushed_one_does_not():
    """F (1 - d/D) = m g at rest for a body that starts above D; there is no morsel for one below D."""
    weight, force = 0.1 * 9.8, 4.0
    carried = height_after(falling(0.0101, diameter=0.01, force_max=force), 0.6)
    assert carried == pytest.approx(0.01 * (1.0 - weight / force), abs=1e-6)
    assert height_after(falling(0.0099, diameter=0.01, force_max=force), 0.6) < -0.01
    assert height_after(falling(0.0101, diameter=0.01, force_max=0.5 * weight), 0.8) < -1e-3


def test_damping_resists_by_the_speed():
    """A body falls in a morsel without stiffness as m v' = -m g - (c + b) v, with its own damping b."""
    m, c, b, g = 0.1, 10.0, 20.0, 9.8
    system = falling(0.0101, diameter=0.01, force_max=0.0, damping=c)
    steps = sim.FixedStep(1e-4)
    motion, _ = sim.simulate(
        system,
        sim.resting(0),
        duration=0.1,
        steps=steps,
        every=0.01,
        integrator=sim.LinearlyImplicitTrapezoidal(),
        probes=(sim.Frames(("bob",)),),
    )
    z = motion["body_position"].sel(axis="z").values.ravel()
    speed = np.diff(z)[-1] / 0.01
    assert speed == pytest.approx(-m * g / (c + b), rel=1e-6)


def test_invalid_morsels_are_refused():
    with pytest.raises(sim.SceneError, match="Crushable: damping = -1"):
        sim.Crushable(0, np.zeros(3), UP, damping=-1.0)
    with pytest.raises(sim.SceneError, match="Crushable: diameter = 0"):
        sim.Crushable(0, np.zeros(3), UP, diameter=0.0)
    with pytest.raises(sim.SceneError, match="has no unit length"):
        sim.Crushable(0, np.zeros(3), 2.0 * UP)


def test_fused_steps_crush_a_morsel_as_the_general_path_does():
    """A morsel is loaded, crushed and unloaded, and a new one is loaded."""

    def heights(fused):
        system = falling(0.0101, diameter=0.01, force_max=0.5)
        state, positions, work = system.rest_state(), [], sim.Workspace(system)
        if not fused:
            work.bodies = None
        for speed in (-3.0, 6.0, -1.2):
            state = replace(state, twists=state.twists + np.array([0.0, 0.0, speed, 0.0, 0.0, 0.3]))
            motion, state = sim.simulate(
                system,
                sim.resting(0),
                initial=state,
                work=work,
                duration=0.12,
                steps=sim.FixedStep(2e-3),
                every=4e-3,
                integrator=sim.LinearlyImplicitEuler(),
                probes=(sim.Frames(("bob",)),),
            )
            positions.append(motion["body_position"].sel(axis="z").values.ravel())
        return np.concatenate(positions)

    fused = heights(True)
    assert fused[:31].min() < 0.0
    assert fused[31:62].max() > 0.0101
    assert 0.0 < fused[-1] < 0.01
    np.testing.assert_allclose(fused, heights(False), atol=1e-13)
