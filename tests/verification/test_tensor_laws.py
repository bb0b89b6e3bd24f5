"""Laws of the strain tensor compared with formulae in principal stretches and with each other."""

import numpy as np
import pytest
from scipy.linalg import polar

import sim
from tests.bodies import (
    crossed_muscles,
    dense,
    grid,
    mean_stress,
    rotation,
    solid_system,
    tetrahedra,
)

MESH = grid((2, 1, 1), wedges=(0,))
MESHES = {
    "hex": grid((2, 1, 1)),
    "wedge": grid((2, 1, 1), wedges=(0, 1)),
    "tet": tetrahedra((2, 1, 1)),
}
KAPPA = 25e3
BULK = sim.QuadraticBulk(KAPPA)
NONE = np.zeros(0)

C10, C01, C20, C11, C02 = 2500.0, 800.0, 1175.0, 300.0, 150.0
OGDEN = ((1250.0, -250.0, 40.0), (6.0, -10.0, 1.3))
YOUNG, POISSON = 15e3, 0.4
LAME = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
MU = YOUNG / (2 * (1 + POISSON))


def five_terms(I1bar, I2bar):
    """dW/dI1bar and dW/dI2bar."""
    x, y = I1bar - 3, I2bar - 3
    return C10 + 2 * C20 * x + C11 * y, C01 + C11 * x + 2 * C02 * y


def nominal_of_five_terms(stretch):
    """P_i = dW/dl_i with I1bar = J^(-2/3) sum l^2 and I2bar = J^(2/3) sum l^(-2)."""
    J = stretch.prod()
    I1bar, I2bar = J ** (-2 / 3) * (stretch**2).sum(), J ** (2 / 3) * (stretch**-2.0).sum()
    W1, W2 = five_terms(I1bar, I2bar)
    slope1 = 2 * J ** (-2 / 3) * stretch - 2 / 3 * I1bar / stretch
    slope2 = -2 * J ** (2 / 3) * stretch**-3.0 + 2 / 3 * I2bar / stretch
    return W1 * slope1 + W2 * slope2 + KAPPA * (J - 1) * J / stretch


def nominal_of_ogden(stretch):
    """P_i = sum mu (lbar_i^alpha - mean of lbar^alpha)/l_i + dU/dl_i."""
    J = stretch.prod()
    P = KAPPA * (J - 1) * J / stretch
    for mu, alpha in zip(*OGDEN, strict=True):
        power = (J ** (-1 / 3) * stretch) ** alpha
        P += mu * (power - power.mean()) / stretch
    return P


def nominal_of_co_rotational(stretch):
    return 2 * MU * (stretch - 1) + LAME * (stretch - 1).sum()


CASES = {
    "five terms": (sim.FiveTermMooneyRivlin(C10, C01, C20, C11, C02), BULK, nominal_of_five_terms),
    "ogden": (sim.Ogden(*OGDEN), BULK, nominal_of_ogden),
    "co-rotational": (sim.CoRotational(YOUNG, POISSON), None, nominal_of_co_rotational),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("shape", MESHES)
@pytest.mark.parametrize(
    "stretches",
    [(1.4, 0.9, 0.9), (0.6, 1.2, 1.2), (1.3, 1.3, 0.7), (1.1, 1.1, 1.1), (1.5, 0.8, 1.0)],
    ids=["uniaxial", "compression", "equibiaxial", "dilation", "triaxial"],
)
def test_stress_of_principal_stretches(case, shape, stretches):
    law, bulk, nominal = CASES[case]
    Q, R = rotation(5), rotation(6)
    P = mean_stress(solid_system(MESHES[shape], law, bulk), Q @ np.diag(stretches) @ R.T, [])
    expected = Q @ np.diag(nominal(np.array(stretches))) @ R.T
    np.testing.assert_allclose(P, expected, atol=1e-10 * np.abs(expected).max())


def shear_stress_of_ogden(gamma):
    """dW/dgamma with the principal stretches l, 1, 1/l of simple shear, l - 1/l = gamma."""
    stretch = gamma / 2 + np.sqrt(1 + gamma**2 / 4)
    return sum(
        mu * (stretch ** (alpha - 1) - stretch ** (-alpha - 1)) / (1 + stretch**-2)
        for mu, alpha in zip(*OGDEN, strict=True)
    )


@pytest.mark.parametrize("gamma", [0.2, 1.0])
@pytest.mark.parametrize(
    ("case", "expected"),
    [
        # both invariants are 3 + gamma^2 and sigma_12 = 2 (W1 + W2) gamma
        ("five terms", lambda g: 2 * g * sum(five_terms(3 + g**2, 3 + g**2))),
        ("ogden", shear_stress_of_ogden),
    ],
)
def test_simple_shear(case, expected, gamma):
    law, bulk, _ = CASES[case]
    F = np.eye(3)
    F[0, 1] = gamma
    sigma = mean_stress(solid_system(MESH, law, bulk), F, []) @ F.T
    assert sigma[0, 1] == pytest.approx(expected(gamma), rel=1e-10)
    # Rivlin's universal relation of simple shear
    assert sigma[0, 0] - sigma[1, 1] == pytest.approx(gamma * sigma[0, 1], rel=1e-10)


@pytest.mark.parametrize(
    ("scalar", "tensor"),
    [
        (sim.MooneyRivlin(C10, C20), sim.FiveTermMooneyRivlin(C10, 0.0, C20)),
        (sim.NeoHooke(5000.0), sim.Ogden((5000.0,), (2.0,))),
        (sim.NeoHooke(5000.0), sim.FiveTermMooneyRivlin(2500.0, 0.0, 0.0)),
    ],
    ids=["five terms", "ogden", "neo-hooke"],
)
@pytest.mark.parametrize("shape", MESHES)
def test_the_two_element_loops_agree(scalar, tensor, shape):
    """The same energy through both loops, with two muscles in every element."""
    mesh = MESHES[shape]
    q = mesh.X + np.random.default_rng(0).normal(size=mesh.X.shape) * 8e-4
    muscles = crossed_muscles(mesh)
    results = []
    for law in (scalar, tensor):
        system = solid_system(mesh, law, BULK, muscles)
        results.append(system.tangent(q, system.control(np.array([0.3, 0.8]))))
    (one, K_one), (two, K_two) = results
    assert two.energy == pytest.approx(one.energy, rel=1e-12)
    assert two.smallest_J == pytest.approx(one.smallest_J, rel=1e-12)
    assert np.abs(two.f - one.f).max() < 1e-12 * np.abs(one.f).max()
    assert np.abs(K_two - K_one).max() < 1e-12 * np.abs(K_one).max()


def fung_energy(law, F, axes):
    """Energy by its definition from K_i = a_i.C a_i and L_i = a_i.C^2 a_i of the isochoric C."""
    J = np.linalg.det(F)
    C = J ** (-2 / 3) * F.T @ F
    K = np.array([a @ C @ a for a in axes.T])
    L = np.array([a @ C @ C @ a for a in axes.T])
    l11, l22, l33, l12, l23, l31 = law.lame
    lame = np.array([[l11, l12, l31], [l12, l22, l23], [l31, l23, l33]])
    Q = (2 * np.array(law.mu) @ (L - 2 * K + 1) + (K - 1) @ lame @ (K - 1)) / (4 * law.c)
    return law.c / 2 * (np.exp(Q) - 1) + KAPPA / 2 * (J - 1) ** 2


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_fung_energy_equals_its_definition(seed):
    law = sim.Fung((17773.0, 5931.0, 4000.0), (1000.0, 900.0, 800.0, 700.0, 600.0, 500.0))
    system, axes = solid_system(MESH, law, BULK), rotation(8)  # the axes of solid_system
    F = np.eye(3) + 0.15 * np.random.default_rng(seed).normal(size=(3, 3))
    energy = system.force(MESH.X @ F.T, system.control(NONE)).energy / MESH.volumes().sum()
    assert energy == pytest.approx(fung_energy(law, F, axes), rel=1e-12)
    P, h = mean_stress(system, F, []), 1e-6
    for i, j in np.ndindex(3, 3):
        step = np.zeros((3, 3))
        step[i, j] = h
        slope = fung_energy(law, F + step, axes) - fung_energy(law, F - step, axes)
        assert P[i, j] == pytest.approx(slope / (2 * h), abs=1e-7 * np.abs(P).max())


def test_fung_is_stiffest_along_its_first_axis():
    """Isochoric stretch of 5 % along each axis in turn."""
    system, axes = solid_system(MESH, sim.Fung(), BULK), rotation(8)
    stress = []
    for i in range(3):
        stretch = np.full(3, 1.05**-0.5)
        stretch[i] = 1.05
        sigma = axes.T @ mean_stress(system, axes @ np.diag(stretch) @ axes.T, []) @ axes
        stress.append(sigma[i, i])
    assert stress[0] > 1.5 * stress[1]
    assert stress[1] == pytest.approx(stress[2], rel=1e-10)  # mu2 = mu3 by default


@pytest.mark.parametrize("shape", MESHES)
def test_linear_stress_and_constant_stiffness(shape):
    mesh = MESHES[shape]
    system = solid_system(mesh, sim.LinearElastic(YOUNG, POISSON))
    H = 0.05 * rotation(2)
    strain = (H + H.T) / 2
    P = mean_stress(system, np.eye(3) + H, [])
    expected = 2 * MU * strain + LAME * np.trace(strain) * np.eye(3)
    np.testing.assert_allclose(P, expected, atol=1e-11 * np.abs(expected).max())
    u = np.random.default_rng(0).normal(size=mesh.X.shape) * 8e-4
    evaluation, K = system.tangent(mesh.X + u, system.control(NONE))
    K_rest = system.tangent(mesh.X, system.control(NONE))[1]
    np.testing.assert_allclose(K, K_rest, atol=1e-11 * np.abs(K).max())
    force = -(dense(system, K) @ u.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(evaluation.f, force, atol=1e-11 * np.abs(force).max())


@pytest.mark.parametrize("shape", MESHES)
def test_co_rotational_is_linear_for_small_strains_in_turned_axes(shape):
    mesh, Q = MESHES[shape], rotation(7)
    turning = solid_system(mesh, sim.CoRotational(YOUNG, POISSON))
    linear = solid_system(mesh, sim.LinearElastic(YOUNG, POISSON))
    direction = np.random.default_rng(0).normal(size=mesh.X.shape) * 1e-3
    differences = []
    for size in (1e-2, 1e-3):
        u = size * direction
        f = turning.force((mesh.X + u) @ Q.T, turning.control(NONE)).f
        expected = linear.force(mesh.X + u, linear.control(NONE)).f @ Q.T
        differences.append(np.abs(f - expected).max() / np.abs(expected).max())
    assert differences[0] < 0.02  # the difference is of second order in the strain
    assert differences[1] == pytest.approx(differences[0] / 10, rel=0.1)


def test_co_rotational_tetrahedron_is_stiffness_warping():
    """f = -R K (R'x - X), R from the polar decomposition of F (Mueller and Gross 2004, Eq. 2)."""
    mesh = sim.mesh_from_arrays(
        np.array([[0, 0, 0], [1.1, 0.1, 0], [0.2, 0.9, 0], [0.1, 0.3, 1.2]]) * 1e-2,
        tet4=[[0, 1, 2, 3]],
    )
    turning = solid_system(mesh, sim.CoRotational(YOUNG, POISSON))
    linear = solid_system(mesh, sim.LinearElastic(YOUNG, POISSON))
    K = dense(linear, linear.tangent(mesh.X, linear.control(NONE))[1])
    x = mesh.X @ rotation(3).T + np.random.default_rng(4).normal(size=(4, 3)) * 1.5e-3
    edges, rest = (x[1:] - x[0]).T, (mesh.X[1:] - mesh.X[0]).T
    R, _ = polar(edges @ np.linalg.inv(rest))
    expected = -(K @ (x @ R - mesh.X).ravel()).reshape(4, 3) @ R.T
    f = turning.force(x, turning.control(NONE)).f
    np.testing.assert_allclose(f, expected, atol=1e-12 * np.abs(expected).max())


def test_laws_of_both_families_may_be_combined_in_one_solid():
    """The force of every element is that in a solid of its own material."""
    mesh = grid((3, 2, 1), (0.03, 0.02, 0.01), wedges=(1, 4))
    n = mesh.n_elements
    materials = (
        sim.Material(),
        sim.Material(sim.Fung(), sim.QuadraticBulk(250e3), density=1200.0),
        sim.Material(sim.LinearElastic()),
        sim.Material(sim.NeoHooke(), relaxation=sim.Prony((0.4,), (0.1,))),
    )
    region = np.arange(n) % 4
    muscles, axes = crossed_muscles(mesh), np.broadcast_to(rotation(2), (n, 3, 3))
    q = mesh.X + np.random.default_rng(1).normal(size=mesh.X.shape) * 5e-4

    def system_of(chosen, region):
        solid = sim.Solid(chosen, region, muscles, axes=axes)
        system = sim.compile_scene(sim.Scene(mesh, (solid,)))
        return system.during(system.rest_state(), 0.05)

    def of_elements(system, weight):
        f, K = np.zeros_like(q), np.zeros(system.pattern.nnz)
        control = system.control(np.array([0.2, 0.7]))
        return f, K, system.terms[0].add(q, control, f, K, weight).energy

    mixed = system_of(materials, region)
    for i, material in enumerate(materials):
        own = region == i
        assert own.sum() == 2  # a hexahedron and a wedge
        f, K, energy = of_elements(mixed, own.astype(float))
        expected = of_elements(system_of((material,), None), own.astype(float))
        np.testing.assert_allclose(f, expected[0], rtol=0, atol=1e-15)
        np.testing.assert_allclose(K, expected[1], atol=1e-14 * np.abs(expected[1]).max())
        assert energy == pytest.approx(expected[2], rel=1e-13)
    density = np.where(region == 1, 1200.0, 1040.0)
    assert mixed.node_mass.sum() == pytest.approx(density @ mesh.volumes(), rel=1e-13)


@pytest.mark.parametrize(
    ("axes", "said"),
    [
        (None, "material axes have shape None"),
        (np.eye(3), "have shape \\(3, 3\\)"),
        (np.full((MESH.n_elements, 3, 3), np.nan), "element 0 are .*nan"),
        (np.tile(np.diag([1.0, 1.0, -1.0]), (MESH.n_elements, 1, 1)), "right-handed"),
        (np.tile(1.1 * np.eye(3), (MESH.n_elements, 1, 1)), "orthonormal"),
    ],
)
def test_invalid_axes_are_refused(axes, said):
    solid = sim.Solid((sim.Material(sim.Fung()),), axes=axes)
    with pytest.raises(sim.SceneError, match=said):
        sim.compile_scene(sim.Scene(MESH, (solid,)))


def test_two_laws_for_one_volume_are_refused():
    with pytest.raises(sim.SceneError, match="determines the volume change itself"):
        sim.Material(sim.CoRotational(), sim.QuadraticBulk())
    assert sim.Material(sim.CoRotational()).bulk is None
    assert sim.Material(sim.Fung()).bulk == sim.QuadraticBulk()


def test_axes_follow_the_rotation_of_a_prestretch():
    """Fung tissue rotated by R into the mesh, with axes rotated accordingly, is free of stress; with an
    additional stretch along an axis, its stress is the rotated stress of the body without rotation."""
    n, R, axes = MESH.n_elements, rotation(3), rotation(8)
    material = sim.Material(sim.Fung())

    def stress(F, axes, prestretch):
        solid = sim.Solid(
            (material,),
            prestretch=None if prestretch is None else np.tile(prestretch, (n, 1, 1)),
            axes=np.tile(axes, (n, 1, 1)),
        )
        return mean_stress(sim.compile_scene(sim.Scene(MESH, (solid,))), F, [])

    U = axes @ np.diag([1.1, 0.95, 1.0]) @ axes.T
    before = stress(U, axes, None) @ U.T / np.linalg.det(U)
    turned = stress(np.eye(3), R @ axes, R @ U)
    np.testing.assert_allclose(turned, R @ before @ R.T, atol=1e-10 * np.abs(before).max())
