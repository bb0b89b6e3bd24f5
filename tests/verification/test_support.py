"""One-sided support compared with a balance of forces."""

import numpy as np
import pytest

import sim
from tests.bodies import grid


def test_a_wall_supports_compression_and_not_tension():
    """Weightless block under pressure on walls: k depth = load; under tension: no force."""
    mesh = grid((1, 1, 1))
    bottom = np.flatnonzero(mesh.X[:, 2] == 0.0)
    walls = sim.Support(bottom, np.tile([0.0, 0.0, 1.0], (4, 1)), stiffness=500.0, gap=1e-3)
    slide = sim.Fixed(np.arange(8), (0, 1))
    top = np.setdiff1d(np.arange(8), bottom)
    press = sim.NodeLoad(top, np.tile([0.0, 0.0, -0.05], (4, 1)))
    system = sim.compile_scene(sim.Scene(mesh, (sim.Solid(), walls, press), (slide,)))
    _, state = sim.simulate(
        system,
        sim.Activation(np.zeros(1), np.zeros((1, 0))),
        duration=1.0,
        integrator=sim.Static(residual_tolerance=1e-9, tolerance=1e-10),
        steps=sim.FixedStep(1.0),
        initial=sim.State(0.0, mesh.X - [0, 0, 1.2e-3], np.zeros_like(mesh.X)),
    )
    np.testing.assert_allclose(state.q[bottom, 2], -1e-3 - 0.05 / 500.0, rtol=0, atol=1e-9)
    free = sim.compile_scene(sim.Scene(mesh, (sim.Solid(), walls), (slide,)))
    f = free.force(mesh.X + [0, 0, 0.01], free.control(np.zeros(0))).f
    assert np.abs(f).max() < 1e-12
    with pytest.raises(sim.SceneError, match="no unit length"):
        sim.Support(np.array([0]), np.array([[0.0, 0.0, 2.0]]))
    with pytest.raises(sim.SceneError, match="sizes of the support arrays differ"):
        sim.Support(np.array([0, 1]), np.array([[0.0, 0.0, 1.0]]))
    with pytest.raises(sim.SceneError, match="gap = -1"):
        sim.Support(np.array([0]), np.eye(3)[:1], gap=-1)
    with pytest.raises(sim.SceneError, match="support refers to node 9"):
        sim.compile_scene(sim.Scene(mesh, (sim.Solid(), sim.Support(np.array([9]), np.eye(3)[:1]))))
