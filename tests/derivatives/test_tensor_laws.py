"""Every registered law of the strain tensor: derivatives, symmetry, state at rest."""

import numpy as np
import pytest

import sim
from sim._kernels import tensor_laws as kernel
from sim._kernels.symmetric import COLUMN, ROW, principal
from sim._kernels.tensor_point import project
from sim.laws import ISOCHORIC_LAWS, TENSOR_LAWS
from tests.bodies import rotation

WEIGHT = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])  # multiplicity of a component in the tensor
AXES = rotation(4)
WORK = np.empty((4, 6, 6))

EXAMPLES = {
    sim.FiveTermMooneyRivlin: sim.FiveTermMooneyRivlin(2500.0, 800.0, 1175.0, 300.0, 150.0),
    sim.Ogden: sim.Ogden((1250.0, -250.0, 40.0), (6.0, -10.0, 1.3)),
    sim.Fung: sim.Fung((17773.0, 5931.0, 4000.0), (1000.0, 900.0, 800.0, 700.0, 600.0, 500.0)),
    sim.LinearElastic: sim.LinearElastic(15e3, 0.4),
    sim.CoRotational: sim.CoRotational(15e3, 0.4),
}
"""One law of each class with generic parameters; a registered class without one fails below."""


def six(A):
    return np.ascontiguousarray(A[ROW, COLUMN])


def full(s):
    A = np.empty((3, 3))
    A[ROW, COLUMN] = A[COLUMN, ROW] = s
    return A


def evaluate(code, p, C):
    S, D = np.full(6, np.nan), np.full((6, 6), np.nan)
    W = kernel.tensor_law(code, np.array(p), six(C), AXES, S, D, True, WORK)
    return W, S, D


def strain(stretches, seed=1):
    Q = rotation(seed)
    return Q @ np.diag(np.square(stretches)) @ Q.T


# Principal values are ill-conditioned for nearly equal stretches.
STRETCHES = [
    (1.3, 0.8, 1.05),
    (1.0, 1.0, 1.0),
    (1.2, 1.2, 0.7),
    (1.2, 1.2 + 1e-9, 0.7),
    (1.2, 1.2 + 3e-5, 1.2 - 1e-5),
    (0.5, 1.9, 1.1),
]


@pytest.mark.parametrize("stretches", STRETCHES)
@pytest.mark.parametrize("cls", TENSOR_LAWS)
def test_S_and_D_are_the_derivatives_of_W(cls, stretches):
    law, C, h = EXAMPLES[cls], strain(stretches), 1e-6
    W, S, D = evaluate(law.code, law.parameters(), C)
    scale = np.abs(D).max()
    assert law.energy(C, AXES) == pytest.approx(W, rel=1e-12, abs=1e-13 * scale)
    np.testing.assert_allclose(D, D.T, atol=1e-11 * scale)
    for b in range(6):
        step = np.zeros(6)
        step[b] = h
        above = evaluate(law.code, law.parameters(), C + full(step))
        below = evaluate(law.code, law.parameters(), C - full(step))
        slope = (above[0] - below[0]) / (2 * h)
        assert slope == pytest.approx(0.5 * WEIGHT[b] * S[b], abs=1e-8 * scale)
        moduli = 2 * (above[1] - below[1]) / (2 * h) / WEIGHT[b]
        np.testing.assert_allclose(D[:, b], moduli, atol=1e-7 * scale)


@pytest.mark.parametrize("cls", TENSOR_LAWS)
def test_at_rest_the_energy_is_zero_and_the_stress_a_pressure(cls):
    law = EXAMPLES[cls]
    W, S, D = evaluate(law.code, law.parameters(), np.eye(3))
    assert abs(W) < 1e-12 * np.abs(D).max()
    if law.measure == kernel.ISOCHORIC:  # The projection removes a pressure of Cbar.
        S = S - S[:3].mean() * (np.arange(6) < 3)
    assert np.abs(S).max() < 1e-12 * np.abs(D).max()


@pytest.mark.parametrize("cls", [c for c in TENSOR_LAWS if not c.needs_axes])
def test_isotropy(cls):
    law, Q = EXAMPLES[cls], rotation(9)
    C = strain((1.3, 0.8, 1.05))
    W, S, _ = evaluate(law.code, law.parameters(), C)
    turned_W, turned_S, _ = evaluate(law.code, law.parameters(), Q @ C @ Q.T)
    assert turned_W == pytest.approx(W, rel=1e-13)
    np.testing.assert_allclose(full(turned_S), Q @ full(S) @ Q.T, atol=1e-12 * np.abs(S).max())


@pytest.mark.parametrize("cls", ISOCHORIC_LAWS)
def test_projection_gives_the_derivatives_by_C(cls):
    """W(J^(-2/3) C) of the scalar laws: derivatives by C against central differences."""
    law, C, h = cls(), strain((1.3, 0.8, 1.25)), 1e-6
    code = kernel.ISOCHORIC_FIRST + law.code

    def at(C):
        J = np.sqrt(np.linalg.det(C))
        W, Sb, Db = evaluate(code, law.parameters(), J ** (-2 / 3) * C)
        S, D = np.zeros(6), np.zeros((6, 6))
        project(Sb, Db, J, six(C), six(np.linalg.inv(C)), S, D, True, WORK)
        return W, S, D

    W, S, D = at(C)
    assert abs((WEIGHT * S) @ six(C)) < 1e-12 * np.abs(S).max()  # isochoric: no pressure
    for b in range(6):
        step = np.zeros(6)
        step[b] = h
        above, below = at(C + full(step)), at(C - full(step))
        scale = np.abs(D).max()
        slope = (above[0] - below[0]) / (2 * h)
        assert slope == pytest.approx(0.5 * WEIGHT[b] * S[b], abs=1e-8 * scale)
        moduli = (above[1] - below[1]) / h / WEIGHT[b]
        np.testing.assert_allclose(D[:, b], moduli, atol=1e-7 * scale)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("spread", [1.0, 1e-3, 1e-8, 1e-15, 0.0])
def test_principal_values_of_coincident_stretches(seed, spread):
    Q = rotation(seed)
    c = 1.3 + spread * np.array([1.0, 0.5, 0.0])
    C = Q @ np.diag(c) @ Q.T
    values, N = np.empty(3), np.empty((3, 3))
    principal(six(C), values, N)
    np.testing.assert_allclose(np.sort(values), np.linalg.eigvalsh(full(six(C))), rtol=1e-14)
    np.testing.assert_allclose(N.T @ N, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(N @ np.diag(values) @ N.T, full(six(C)), atol=1e-14)


def test_an_unknown_code_gives_nan():
    W, S, D = evaluate(50, (1.0,), np.eye(3))
    assert np.isnan(W) and np.isnan(S).all() and np.isnan(D).all()


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: sim.FiveTermMooneyRivlin(-1.0, 0.5), "C10 \\+ C01"),
        (lambda: sim.Ogden((1.0,), (2.0, 3.0)), "1 values of mu for 2"),
        (lambda: sim.Ogden((1.0,), (-2.0,)), "mu_p alpha_p"),
        (lambda: sim.Fung((1.0, 2.0)), "2 values of mu"),
        (lambda: sim.Fung(c=0.0), "c = 0.0"),
        (lambda: sim.LinearElastic(poisson=0.5), "poisson"),
        (lambda: sim.CoRotational(young=float("nan")), "young"),
        (lambda: sim.Prony((0.5, 0.5), (1.0, 2.0)), "1 - sum of g"),
        (lambda: sim.Prony((0.5,), (1.0, 2.0)), "1 fractions g for 2"),
        (lambda: sim.Prony((0.5,), (0.0,)), "tau = 0.0"),
    ],
)
def test_parameters_out_of_range_are_refused(make, said):
    with pytest.raises(sim.SceneError, match=said):
        make()
