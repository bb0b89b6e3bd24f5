"""Patch test: a distorted mesh represents a homogeneous deformation exactly."""

import numpy as np
import pytest

import sim
from tests.bodies import boundary, grid, rotation, solid_system, tetrahedra

PATCHES = {
    "hex": grid((3, 3, 3), distort=0.2),
    "mixed": grid((3, 3, 3), distort=0.2, wedges=(0, 3, 5)),
    "wedge": grid((3, 3, 3), distort=0.2, wedges=tuple(range(9))),
    "tet": tetrahedra((3, 3, 3), distort=0.2),
}


@pytest.mark.parametrize("mesh", PATCHES.values(), ids=PATCHES.keys())
def test_distorted_patch_is_in_equilibrium_under_affine_motion(mesh):
    system = solid_system(mesh)
    F = np.eye(3) + 0.2 * rotation(1)
    f = system.force(mesh.X @ F.T, system.control(np.zeros(0))).f
    inner = np.setdiff1d(np.arange(mesh.n_nodes), boundary(mesh))
    assert len(inner) == 8
    assert np.abs(f[inner]).max() < 1e-12 * np.abs(f).max()


@pytest.mark.parametrize("shape", ["hex", "mixed", "tet"])
def test_free_nodes_converge_to_the_affine_field(shape):
    """The boundary has the affine field; inner nodes start elsewhere and are simulated to rest."""
    mesh = PATCHES[shape]
    F = np.array([[1.1, 0.1, 0.0], [0.0, 0.95, 0.05], [0.0, 0.0, 1.05]])
    prescribed = boundary(mesh)
    system = solid_system(
        mesh, reductions=(sim.Fixed(prescribed),), damping=sim.Rayleigh(0.0, 0.01)
    )
    q = mesh.X.copy()
    q[prescribed] = mesh.X[prescribed] @ F.T
    start = sim.State(0.0, q, np.zeros_like(q))
    _, end = sim.simulate(
        system,
        sim.resting(0),
        duration=2.0,
        steps=sim.FixedStep(0.1),
        integrator=sim.ConvergedEuler(tolerance=1e-12, residual_tolerance=1e-10),
        initial=start,
    )
    assert np.abs(end.q - mesh.X @ F.T).max() < 1e-9


@pytest.mark.parametrize("shape", ["mixed", "tet"])
def test_volume_and_mass_of_a_box(shape):
    size = (0.03, 0.02, 0.01)
    mesh = (
        tetrahedra((3, 2, 2), size, distort=0.2)
        if shape == "tet"
        else grid((3, 2, 2), size, wedges=(1, 4), distort=0.2)
    )
    system = solid_system(mesh)
    assert mesh.volumes().sum() == pytest.approx(6e-6, rel=1e-13)
    assert system.node_mass.sum() == pytest.approx(6e-6 * 1040, rel=1e-13)
