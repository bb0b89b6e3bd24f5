"""Saddle systems of constraints, against dense matrices and for many right-hand sides at once."""

from dataclasses import replace

import numpy as np
import pytest

import sim
from sim.linear import SinglePardiso, SuperLU, pardiso_is_available
from sim.linear.reused import ReusedFactor
from sim.linear.saddle import Saddle
from tests.verification.test_linear import body, dense, moved, needs_pardiso, step_matrix

FACTORS = {
    "direct": None,
    "superlu": SuperLU,
    "pardiso_single": SinglePardiso,
}
SYSTEM = sim.compile_scene(
    replace(body(sim.ElementVolume(25e3)).scene, constraints=(sim.HardElementVolume(),))
)


def saddle(name, q):
    """Solver with the matrices at a configuration, that of a dense A, and G."""
    conditions = SYSTEM.constraints
    G = conditions.evaluate(replace(SYSTEM.rest_state().pose, q=q))[1]
    A = step_matrix(SYSTEM, q)
    solver = Saddle(SYSTEM.pattern, conditions, FACTORS[name] and FACTORS[name]())
    solver.factorise(A, G)
    return solver, dense(SYSTEM.pattern, A), conditions.matrix(G).toarray()


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=needs_pardiso) if "pardiso" in n else n for n in FACTORS]
)
def test_solutions_satisfy_the_equations(name):
    solver, A, G = saddle(name, moved(1e-4))
    rng = np.random.default_rng(0)
    r, gamma = rng.normal(size=len(A)), 1e-6 * rng.normal(size=len(G))
    x, y = solver.solve(r, gamma)
    whole = np.block([[A, G.T], [G, np.zeros((len(G), len(G)))]])
    z = np.linalg.lstsq(whole, np.concatenate([r, gamma]))[0]
    np.testing.assert_allclose(x, z[: len(A)], atol=1e-8 * np.abs(x).max())
    np.testing.assert_allclose(A @ x + G.T @ y, r, atol=1e-7 * np.abs(r).max())


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=needs_pardiso) if "pardiso" in n else n for n in FACTORS]
)
def test_many_right_hand_sides_have_the_solutions_of_each(name):
    """Those with an existing factor, of the same matrix."""
    solver, A, G = saddle(name, moved(1e-4))
    rng = np.random.default_rng(0)
    solver.solve(rng.normal(size=len(A)), np.zeros(len(G)))
    rhs = rng.normal(size=(5, len(A)))
    rhs[3] = 0.0
    together = solver.roughly(rhs)
    alone = np.array([solver.roughly(row) for row in rhs])
    accuracy = 1e-3 if "single" in name else 1e-9
    np.testing.assert_allclose(together, alone, atol=accuracy * np.abs(alone).max())
    assert not together[3].any()
    assert solver.roughly(rhs[:0]).shape == (0, len(A))
    # rows are satisfied up to the compliance of the preconditioner
    free = np.linalg.solve(A, rhs[0])
    assert np.abs(G @ together[0]).max() < 0.2 * np.abs(G @ free).max()


@pytest.mark.skipif(not pardiso_is_available(), reason="pypardiso is not installed")
def test_the_factor_of_hard_volumes_is_in_single_precision():
    solver, A, G = saddle("pardiso_single", moved(1e-4))
    solver.solve(np.ones(len(A)), np.zeros(len(G)))
    assert isinstance(solver._solver, ReusedFactor)
    assert not solver._solver.factor._factor.in_double
