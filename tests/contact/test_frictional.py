"""Forces of frictional contacts that share one matrix, compared with Coulomb's law and with sweeps."""

import numpy as np
import pytest

from sim.contact import cone
from sim.contact.cone import Blocks, forces, frictional


def problem(seed, most=40, coefficients=(0.0, 0.1, 0.3, 0.8)):
    """Random positive definite matrix, gaps and slips, and contacts with and without friction."""
    rng = np.random.default_rng(seed)
    friction = rng.choice(coefficients, int(rng.integers(1, most)))
    size = np.where(friction > 0.0, 3, 1)
    first, m = np.cumsum(size) - size, int(size.sum())
    B = rng.normal(size=(m, m + int(rng.integers(0, 20))))
    return B @ B.T / m + 0.01 * np.eye(m), rng.normal(size=m), first, friction


def require_coulomb(G, c, first, friction, f, error):
    """Unilateral contact, Coulomb's bound, no slip below it, and friction against the slip at it."""
    u, force = G @ f + c, f[first]
    assert force.min() >= 0.0
    assert u[first].min() > -error
    assert np.abs(u[first][force > 0.0]).max(initial=0.0) < error
    for at, mu in zip(first[friction > 0.0], friction[friction > 0.0], strict=True):
        tangent, slip = f[at + 1 : at + 3], u[at + 1 : at + 3]
        size, bound = np.linalg.norm(tangent), mu * f[at]
        assert size <= bound * (1.0 + 1e-12)
        if size < bound * (1.0 - 1e-6):
            assert np.linalg.norm(slip) < error
        elif bound > 0.0:
            np.testing.assert_allclose(tangent * np.linalg.norm(slip), -bound * slip, atol=error)


@pytest.mark.parametrize("seed", range(40))
def test_forces_obey_coulombs_law(seed):
    G, c, first, friction = problem(seed)
    f, _ = frictional(G, c, first, friction, np.zeros(len(c)))
    require_coulomb(G, c, first, friction, f, 1e-4)
    # the second solution starts from the first
    f, _ = frictional(G, c, first, friction, f)
    require_coulomb(G, c, first, friction, f, 1e-8)


@pytest.mark.parametrize("seed", range(10))
def test_forces_equal_those_of_sweeps(seed):
    """Small coefficients, for which the forces are unique."""
    G, c, first, friction = problem(seed, coefficients=(0.0, 0.05, 0.1))
    swept, left = forces(
        G, c, Blocks(np.empty(0, np.int64), first, friction), np.zeros(len(c)), 1e-12
    )
    assert left <= 1e-12
    f, _ = frictional(G, c, first, friction, np.zeros(len(c)))
    f, _ = frictional(G, c, first, friction, f)
    np.testing.assert_allclose(f, swept, atol=1e-6 * np.abs(swept).max())


def test_without_convergence_the_bounds_are_obeyed(monkeypatch):
    """One iteration from each start leaves an error, but no force beyond a bound."""
    monkeypatch.setattr(cone, "NEWTON", 1)
    monkeypatch.setattr(cone, "BETWEEN", 1)
    G, c, first, friction = problem(3)
    f, missed = frictional(G, c, first, friction, np.zeros(len(c)))
    u = G @ f + c
    assert missed > 0.01 * np.abs(u).max()  # reported to the caller
    assert f[first].min() >= 0.0
    for at, mu in zip(first[friction > 0.0], friction[friction > 0.0], strict=True):
        assert np.linalg.norm(f[at + 1 : at + 3]) <= mu * f[at] * (1.0 + 1e-12)


def test_a_force_is_bounded_if_the_matrix_is_indefinite():
    G, c, first, friction = problem(5)
    f, _ = frictional(G - 0.3 * np.eye(len(c)), c, first, friction, np.zeros(len(c)))
    assert np.isfinite(f).all()


def test_redundant_rows_with_friction_share_the_force():
    """Two rows of one vertex, with the regularisation of their penalties."""
    one = np.eye(3)
    G = np.block([[one, one], [one, one]]) + 1e-3 * np.eye(6)
    c = np.array([-1.0, 0.05, 0.0, -1.0, 0.05, 0.0])
    first, friction = np.array([0, 3]), np.array([0.3, 0.3])
    f, _ = frictional(G, c, first, friction, np.zeros(6))
    f, _ = frictional(G, c, first, friction, f)
    require_coulomb(G, c, first, friction, f, 1e-8)
    np.testing.assert_allclose(f[:3], f[3:], atol=1e-8)
    assert f[0] + f[3] == pytest.approx(1.0, rel=1e-2)
