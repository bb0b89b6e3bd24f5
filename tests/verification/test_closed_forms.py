"""Homogeneous deformations compared with formulae in principal stretches, independent of F."""

import numpy as np
import pytest

import sim
from tests.bodies import dense, grid, mean_stress, rotation, solid_system

C10, C20, KAPPA = 2500.0, 1175.0, 25e3
MESH = grid((2, 1, 1), wedges=(0,))


def principal_nominal_stress(stretches, bulk):
    """P_i = dW/dl_i for W = C10 (I-3) + C20 (I-3)^2 + U(J), I = J^(-2/3) sum l^2 (Eskes Eq. 1)."""
    stretch = np.asarray(stretches)
    J = stretch.prod()
    I1bar = J ** (-2 / 3) * (stretch**2).sum()
    slope = C10 + 2 * C20 * (I1bar - 3)
    pressure = KAPPA * (J - 1) if bulk is sim.QuadraticBulk else KAPPA * np.log(J) / J
    return slope * (2 * J ** (-2 / 3) * stretch - 2 / 3 * I1bar / stretch) + pressure * J / stretch


@pytest.mark.parametrize("bulk", [sim.QuadraticBulk, sim.LogarithmicBulk])
@pytest.mark.parametrize(
    "stretches",
    [(1.4, 0.9, 0.9), (0.6, 1.2, 1.2), (1.3, 1.3, 0.7), (1.1, 1.1, 1.1), (1.5, 0.8, 1.0)],
    ids=["uniaxial", "compression", "equibiaxial", "dilation", "triaxial"],
)
def test_stress_of_principal_stretches(bulk, stretches):
    system = solid_system(MESH, sim.MooneyRivlin(C10, C20), bulk(KAPPA))
    Q, R = rotation(5), rotation(6)
    P = mean_stress(system, Q @ np.diag(stretches) @ R.T, [])
    expected = Q @ np.diag(principal_nominal_stress(stretches, bulk)) @ R.T
    np.testing.assert_allclose(P, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("gamma", [0.2, 1.0])
def test_simple_shear(gamma):
    """sigma_12 = 2 (C10 + 2 C20 gamma^2) gamma at J = 1, I1 = 3 + gamma^2."""
    system = solid_system(MESH, sim.MooneyRivlin(C10, C20))
    F = np.eye(3)
    F[0, 1] = gamma
    sigma = mean_stress(system, F, []) @ F.T
    assert sigma[0, 1] == pytest.approx(2 * (C10 + 2 * C20 * gamma**2) * gamma, rel=1e-10)
    # Rivlin's universal relation of simple shear
    assert sigma[0, 0] - sigma[1, 1] == pytest.approx(gamma * sigma[0, 1], rel=1e-10)


def blemker_fibre_stress(r, activation, sigma_max):
    """The law for stretch_opt = 1, from its definition."""
    active = (
        0.0
        if r < 0.4 or r > 1.6
        else 9 * (r - 0.4) ** 2
        if r <= 0.6
        else 9 * (r - 1.6) ** 2
        if r >= 1.4
        else 1 - 4 * (1 - r) ** 2
    )
    passive = 0.0
    if r > 1.0:
        P1, P2, star = 0.05, 6.6, 1.4
        P3 = P1 * P2 * np.exp(P2 * (star - 1))
        P4 = P1 * (np.exp(P2 * (star - 1)) - 1) - P3 * star
        passive = P1 * (np.exp(P2 * (r - 1)) - 1) if r <= star else P3 * r + P4
    return sigma_max * (passive + activation * active)


@pytest.mark.parametrize("stretch", [0.5, 0.8, 1.0, 1.2, 1.45, 1.55])
@pytest.mark.parametrize("activation", [0.0, 0.5, 1.0])
def test_active_fibre(stretch, activation):
    """Cauchy stress (stretch f / J)(a a' - I/3) in addition to the passive one."""
    n = MESH.n_elements
    muscles = sim.Muscles(
        ("m",), np.arange(n), np.zeros(n, int), np.tile([1.0, 0, 0], (n, 1)), sim.Blemker(200e3)
    )
    F = np.diag([stretch, stretch**-0.5, stretch**-0.5])
    with_muscle = mean_stress(solid_system(MESH, muscles=muscles), F, [activation])
    sigma = (with_muscle - mean_stress(solid_system(MESH), F, [])) @ F.T
    expected = stretch * blemker_fibre_stress(stretch, activation, 200e3)
    np.testing.assert_allclose(
        sigma, expected * np.diag([2 / 3, -1 / 3, -1 / 3]), atol=1e-9 * 200e3
    )


def test_a_muscle_that_fills_a_share_of_its_elements_has_that_share_of_its_stress():
    """Exact in force and tangent: rows of weights 0.3 and 0.7 together equal the row without weight."""
    n, rng = MESH.n_elements, np.random.default_rng(4)
    direction = rng.normal(size=(n, 3))
    every = np.arange(n)
    q = MESH.X + rng.normal(size=MESH.X.shape) * 1e-4

    def body(*shares):
        k = len(shares)
        muscles = sim.Muscles(
            ("m",),
            np.tile(every, k),
            np.zeros(k * n, int),
            np.tile(direction, (k, 1)),
            sim.Blemker(200e3),
            np.repeat(np.array(shares), n) if shares != (None,) else None,
        )
        system = solid_system(MESH, muscles=muscles)
        at_q, K = system.tangent(q, system.control(np.array([0.6])))
        return at_q.energy, at_q.f, dense(system, K)

    for whole, parts, none, most in zip(
        body(None), body(0.3, 0.7), body(0.0), body(0.7), strict=True
    ):
        size = np.abs(whole).max()
        np.testing.assert_allclose(parts, whole, rtol=0, atol=1e-12 * size)
        np.testing.assert_allclose(most, none + 0.7 * (whole - none), rtol=0, atol=1e-12 * size)


def test_bundles_in_one_element_superpose():
    n = MESH.n_elements
    rows = dict(element=np.arange(n), muscle=np.zeros(n, int))
    along, across = (np.tile(d, (n, 1)) for d in ([1.0, 0.2, 0], [0.1, 1.0, 0.4]))
    one = sim.Muscles(("a",), **rows, direction=along)
    two = sim.Muscles(("b",), **rows, direction=across)
    both = sim.Muscles(
        ("a", "b"),
        np.tile(np.arange(n), 2),
        np.repeat([0, 1], n),
        np.concatenate([along, across]),
    )
    F = np.eye(3) + 0.1 * rotation(2)
    passive = mean_stress(solid_system(MESH), F, [])
    alone = [
        mean_stress(solid_system(MESH, muscles=m), F, [a]) for m, a in ((one, 0.3), (two, 0.9))
    ]
    together = mean_stress(solid_system(MESH, muscles=both), F, [0.3, 0.9])
    np.testing.assert_allclose(together, sum(alone) - passive, atol=1e-6)
