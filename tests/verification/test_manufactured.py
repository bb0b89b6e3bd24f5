"""Manufactured solutions: order of convergence of every element type, for laws of both families.

A smooth motion x = X + u(X) is the solution for the body force b = -Div P(F(X)); P is computed here
from each law's invariants or polar decomposition, b by differences of it. The whole boundary of the
body is fixed.
"""

import numpy as np
import pytest

import sim
from tests.bodies import boundary, grid, tetrahedra

L, KAPPA = 0.02, 25e3
C10, C01, C20, C11, C02 = 2500.0, 800.0, 1175.0, 300.0, 150.0
YOUNG, POISSON = 15e3, 0.3
LAME, MU = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))

WAVE = 1.6 / L * np.array([[1.0, 0.5, 0.3], [0.4, 1.0, -0.6], [-0.5, 0.7, 1.0]])
PHASE = np.array([0.3, 1.1, 2.0])
SIZE = 0.08 * L * np.array([1.0, -0.8, 0.9])


def motion(X):
    """Positions (..., 3) of the material points X."""
    return X + SIZE * np.sin(X @ WAVE.T + PHASE)


def gradient(X):
    """Deformation gradient (..., 3, 3) of the motion."""
    return np.eye(3) + (SIZE * np.cos(X @ WAVE.T + PHASE))[..., None] * WAVE


def invariant_stress(F, C01, C11, C02):
    """P of the Mooney-Rivlin laws by dI1bar/dF and dI2bar/dF, with kappa/2 (J - 1)^2."""
    J = np.linalg.det(F)[..., None, None]
    inverse = np.linalg.inv(F).swapaxes(-1, -2)
    C = F.swapaxes(-1, -2) @ F
    I1 = np.trace(C, axis1=-2, axis2=-1)[..., None, None]
    I2 = 0.5 * (I1**2 - np.trace(C @ C, axis1=-2, axis2=-1)[..., None, None])
    I1bar, I2bar = J ** (-2 / 3) * I1, J ** (-4 / 3) * I2
    W1 = C10 + 2 * C20 * (I1bar - 3) + C11 * (I2bar - 3)
    W2 = C01 + C11 * (I1bar - 3) + 2 * C02 * (I2bar - 3)
    slope1 = 2 * J ** (-2 / 3) * (F - I1 / 3 * inverse)
    slope2 = 2 * J ** (-4 / 3) * (I1 * F - F @ C - 2 / 3 * I2 * inverse)
    return W1 * slope1 + W2 * slope2 + KAPPA * (J - 1) * J * inverse


def co_rotational_stress(F):
    """P = R (2 mu (U - I) + lame tr(U - I) I)."""
    left, stretch, right = np.linalg.svd(F)
    strain = stretch - 1
    principal = 2 * MU * strain + LAME * strain.sum(axis=-1, keepdims=True)
    return (left * principal[..., None, :]) @ right


BULK = sim.QuadraticBulk(KAPPA)
CASES = {
    "MooneyRivlin": (
        sim.Material(sim.MooneyRivlin(C10, C20), BULK),
        lambda F: invariant_stress(F, 0.0, 0.0, 0.0),
    ),
    "FiveTermMooneyRivlin": (
        sim.Material(sim.FiveTermMooneyRivlin(C10, C01, C20, C11, C02), BULK),
        lambda F: invariant_stress(F, C01, C11, C02),
    ),
    "CoRotational": (sim.Material(sim.CoRotational(YOUNG, POISSON)), co_rotational_stress),
}


def body_force(stress, X, h=1e-3 * L):
    """-Div P by differences of fourth order (..., 3) [N/m^3]."""
    b = np.zeros(X.shape)
    for j in range(3):
        for step, weight in ((-2, 1), (-1, -8), (1, 8), (2, -1)):
            moved = X.copy()
            moved[..., j] += step * h
            b -= weight / (12 * h) * stress(gradient(moved))[..., :, j]
    return b


def box_mesh(element, n):
    if element == "tet4":
        return tetrahedra((n, n, n), (L, L, L))
    return grid((n, n, n), (L, L, L), wedges=() if element == "hex8" else range(n * n))


def fine_rule(element):
    """Points and weights in natural coordinates, of a higher degree than those of the element."""
    g, w = np.polynomial.legendre.leggauss(3)
    points = np.stack(np.meshgrid(g, g, g, indexing="ij"), axis=-1).reshape(-1, 3)
    weights = np.einsum("i,j,k->ijk", w, w, w).ravel()
    if element == "hex8":
        return points, weights
    r, s, t = (0.5 * (1 + points)).T  # collapse of the cube
    if element == "wedge6":
        return np.stack([r, s * (1 - r), points[:, 2]], axis=1), weights / 4 * (1 - r)
    inside = np.stack([r, s * (1 - r), t * (1 - r) * (1 - s)], axis=1)
    return inside, weights / 8 * (1 - r) ** 2 * (1 - s)


def displacement_error(element, case, n):
    """Error of the displacement in L2 over its size, and the iterations."""
    material, stress = CASES[case]
    mesh = box_mesh(element, n)
    block = next(b for b in mesh.blocks if len(b.nodes))
    volume = block.gradients(mesh.X)[1] * block.kind.weights
    place = np.einsum("pa,eai->epi", block.kind.N, mesh.X[block.nodes])
    force = np.einsum("ep,pa,epi->eai", volume, block.kind.N, body_force(stress, place))
    load = sim.NodeLoad(block.nodes.ravel(), force.reshape(-1, 3))
    fixed = sim.Fixed(boundary(mesh))
    system = sim.compile_scene(sim.Scene(mesh, (sim.Solid((material,)), load), (fixed,)))
    x = motion(mesh.X)
    state, _ = sim.Static(tolerance=1e-9, residual_tolerance=1e-10).step(
        system,
        sim.State(0.0, x, np.zeros_like(x)),
        system.control(np.zeros(0)),
        1.0,
        sim.Workspace(system),
    )
    points, weights = fine_rule(element)
    N, dN = block.kind.shape(points)
    det = np.linalg.det(np.einsum("eai,paj->epij", mesh.X[block.nodes], dN))
    there = np.einsum("pa,eai->epi", N, mesh.X[block.nodes])
    miss = np.einsum("pa,eai->epi", N, state.q[block.nodes]) - motion(there)
    weight = (det * weights)[..., None]
    assert weight.sum() == pytest.approx(L**3, rel=1e-12)
    return np.sqrt((weight * miss**2).sum() / (weight * (motion(there) - there) ** 2).sum())


SIZES = {"hex8": (4, 8), "wedge6": (4, 8), "tet4": (5, 10)}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("element", SIZES)
def test_displacement_is_of_second_order_in_mesh_size(element, case):
    coarse, fine = (displacement_error(element, case, n) for n in SIZES[element])
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.1)
