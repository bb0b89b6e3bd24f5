"""Tolerances of contact are relative to its approach distance."""

from dataclasses import replace

import numpy as np
import pytest

import sim
from tests.bodies import grid
from tests.contact.scenes import moved, system_of, two_bodies

MOST = 1e-6
"""Tolerance of the iterations at the original size [m]."""


def landed(integrator, scale):
    """Two soft blocks, the upper one of which lands, slides and tips; lengths times a scale."""
    low, high = grid((3, 3, 1), (0.02, 0.02, 0.006)), grid((2, 2, 1), (0.012, 0.012, 0.006))
    mesh, a, b = two_bodies(low, high, [0.0035, 0.0045, 0.0062])
    mesh = sim.mesh_from_arrays(scale * mesh.X, hex8=mesh.blocks[0].nodes)
    law = sim.MooneyRivlin()
    stiffer = sim.MooneyRivlin(*(scale**2 * c for c in (law.C10, law.C20)))
    solid = sim.Solid((sim.Material(stiffer, sim.LogarithmicBulk(scale**2 * 25e3)),))
    contact = sim.ConstraintContact((sim.Pairing(a, b),), approach=scale * 5e-4, reach=scale * 0.01)
    gravity = sim.Gravity((2.0 * scale, scale, -40.0 * scale))
    fixed = sim.Fixed(np.flatnonzero(mesh.X[:, 2] == 0.0))
    system = system_of(mesh, contact, gravity, reductions=(fixed,), solid=solid)
    if isinstance(integrator, sim.ConvergedEuler):
        residual = scale**4 * 1e-8  # forces are moduli times areas
        integrator = replace(integrator, residual_tolerance=residual)
    end = moved(system, replace(integrator, tolerance=scale * MOST), 12, h=0.005)[-1]
    assert len(system.contact.pushing(end)) > 0
    return (end.q - mesh.X) / scale


@pytest.mark.parametrize("integrator", [sim.LinearlyImplicitEuler(), sim.ConvergedEuler()])
def test_bodies_of_another_size_move_alike(integrator):
    """With fixed lengths, a scene of a hundred times the size would move differently.

    One fixed length remains, the distance of 1e-6 m from an edge within which a point is on it
    (`sim._kernels.signed`); the block does not yet tip over an edge in this time.
    """
    original = landed(integrator, 1.0)
    assert np.abs(original).max() > 5e-4
    np.testing.assert_allclose(landed(integrator, 128.0), original, rtol=0, atol=1e-9)
