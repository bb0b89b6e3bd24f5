"""Positions at outputs are free of penetrations, at any times between steps."""

import numpy as np
import pytest

import sim
from emgface.face.penetration import depths
from sim.contact.rows import ContactTolerances
from tests.bodies import grid
from tests.contact.scenes import (
    CASES,
    contact_of,
    square,
    system_of,
    two_bodies,
)

STEP, OUTPUT = 0.02, 0.005
FREE = ContactTolerances().unexpected
"""Depth above which a step is solved again instead of corrected [m]."""

CONTROLS = [
    pytest.param(sim.FixedStep(STEP), id="fixed"),
    pytest.param(sim.HalvingStep(STEP), id="halving"),
    pytest.param(sim.ErrorControlledStep(1.0, STEP), id="error"),
]


def flung(method, integrator, steps, mesh, pairing, v, drop=0.1):
    system = system_of(mesh, contact_of(method, (pairing,)))
    rest = system.rest_state()
    return sim.simulate(
        system,
        sim.resting(0),
        duration=drop,
        integrator=integrator(),
        steps=steps,
        every=OUTPUT,
        probes=(sim.Positions(), sim.Contacts()),
        initial=sim.State(0.0, rest.q, v),
    )[0]


@pytest.mark.parametrize("steps", CONTROLS)
@pytest.mark.parametrize(("method", "integrator"), CASES)
def test_a_cube_thrown_at_a_floor_is_above_it_in_every_output(method, integrator, steps):
    mesh = grid((2, 2, 2))
    mesh = sim.mesh_from_arrays(mesh.X + [0, 0, 0.004], hex8=mesh.blocks[0].nodes)
    pairing = sim.Pairing(sim.boundary_surface(mesh), square())
    v = np.zeros_like(mesh.X)
    v[:, 2] = -0.5
    motion = flung(method, integrator, steps, mesh, pairing, v)
    lowest = motion["node_position"].sel(axis="z").min("node").values
    assert motion.sizes["time"] == round(0.1 / OUTPUT) + 1
    assert lowest.min() > -FREE
    assert lowest.min() < 1e-3  # it has reached the floor
    gap = motion["contact_gap"].values[0]
    near = np.isfinite(gap)
    assert near.any()
    np.testing.assert_allclose(gap[near], lowest[near], atol=FREE)


@pytest.mark.parametrize("speed", [0.1, 0.3])
@pytest.mark.parametrize(("method", "integrator"), CASES)
def test_bodies_thrown_at_each_other_do_not_overlap_in_any_output(method, integrator, speed):
    """Measured by winding numbers, independently of the search of contact."""
    one = grid((2, 2, 1), (0.02, 0.02, 0.01))
    mesh, lower, upper = two_bodies(one, one, [0.001, 0.0013, 0.013])
    half = len(one.X)
    v = np.zeros_like(mesh.X)
    v[:half, 2], v[half:, 2] = speed, -speed
    motion = flung(method, integrator, sim.FixedStep(STEP), mesh, sim.Pairing(lower, upper), v)
    written = motion["node_position"].transpose("time", "node", "axis").values
    deepest = [
        max(depths(q[half:], q[lower.triangles]).max(), depths(q[:half], q[upper.triangles]).max())
        for q in written
    ]
    assert max(deepest) < FREE
    assert np.isfinite(motion["contact_gap"].values).any()
