"""Solutions under rows, against the saddle system solved as a whole."""

import numpy as np
import pytest
from scipy.sparse import csr_array

import sim
from sim.dense import solve_under_rows

RNG = np.random.default_rng(0)
B = RNG.normal(size=(30, 30))
A, G, C = B @ B.T + np.eye(30), RNG.normal(size=(3, 30)), np.array([0.0, 0.1, 0.2])


def push(f):
    return np.linalg.solve(A, (f @ G).T).T


@pytest.mark.parametrize("shape", [(30,), (4, 30)])
@pytest.mark.parametrize("sparse", [False, True])
def test_solutions_are_those_of_the_saddle_system(shape, sparse):
    r, b = RNG.normal(size=shape), RNG.normal(size=(*shape[:-1], 3))
    x0 = np.linalg.solve(A, r.T).T
    rows, S = csr_array(G) if sparse else G, G @ np.linalg.solve(A, G.T)
    x, f = solve_under_rows(x0, rows, S, push, "S", wanted=b, soft=C)
    saddle = np.block([[A, -G.T], [G, np.diag(C)]])
    whole = np.linalg.solve(saddle, np.concatenate([r, b], axis=-1).T).T
    np.testing.assert_allclose(np.concatenate([x, f], axis=-1), whole, rtol=1e-9, atol=1e-12)


def test_corrections_with_a_similar_matrix_are_repeated_until_the_rows_are_closed():
    S, x0 = 1.2 * G @ np.linalg.solve(A, G.T), np.linalg.solve(A, np.ones(30))
    once = solve_under_rows(x0, G, S, push, "S")[0]
    assert np.abs(G @ once).max() > 0.1 * np.abs(G @ x0).max()
    assert (
        np.abs(G @ solve_under_rows(x0, G, S, push, "S", repeats=30, most=1e-12)[0]).max() <= 1e-12
    )


def test_rows_that_repeat_each_other_need_a_cutoff():
    twice = np.concatenate([G, G[:1]])
    S, x0 = twice @ np.linalg.solve(A, twice.T), np.linalg.solve(A, np.ones(30))

    def both(f):
        return np.linalg.solve(A, (f @ twice).T).T

    x, f = solve_under_rows(x0, twice, S, both, "S", cutoff=1e-9)
    assert np.abs(twice @ x).max() < 1e-12 and f[0] == pytest.approx(f[3])
    with pytest.raises(sim.SingularSystem, match="of two rows"):
        solve_under_rows(x0, G[[0, 0]], np.ones((2, 2)), push, "the matrix of two rows")


def test_without_rows_nothing_changes():
    x0 = np.ones((2, 30))
    x, f = solve_under_rows(x0, G[:0], np.zeros((0, 0)), push, "S")
    assert x is x0 and f.shape == (2, 0)
