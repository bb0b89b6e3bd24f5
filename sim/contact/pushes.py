"""Linear complementarity problem of contact forces."""

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import nnls

from sim.contact.rows import Flags
from sim.dense import reported
from sim.state import Array

CHANGES = 20  #: largest number of active-set updates before the robust method is used
SOFTENED = 1e-6  #: smallest eigenvalue relative to the largest one


def pushes(G: Array, c: Array, pushing: Flags) -> Array:
    """Forces f (m,) with f >= 0, G f + c >= 0 and f . (G f + c) = 0.

    G (m, m) is symmetric [m/N], and regularised until it is positive definite; c (m,) are the gaps
    without the forces [m]; `pushing` is the initial active set.

    Source: Hintermueller, Ito and Kunisch 2002, The primal-dual active set strategy as a semismooth
    Newton method, SIAM J. Optim. 13, 865-888. It may cycle for a general G; then the least squares |L'
    f + L^-1 c| with f >= 0 and G = L L' are solved by Lawson and Hanson 1974, which always ends.
    """
    try:
        return _pushes(G, c, pushing)
    except LinAlgError:
        with reported("the matrix of contacts"):
            values = np.linalg.eigvalsh(G)
            more = SOFTENED * np.abs(values).max() - values[0]
            return _pushes(G + more * np.eye(len(G)), c, pushing)


def _pushes(G: Array, c: Array, pushing: Flags) -> Array:
    for _ in range(CHANGES):
        f, on = np.zeros(len(c)), np.flatnonzero(pushing)
        factor = cho_factor(G[on[:, None], on], check_finite=False)
        f[on] = cho_solve(factor, -c[on], check_finite=False)
        new = np.where(pushing, f > 0.0, G @ f + c < 0.0)
        if np.array_equal(new, pushing):
            return f
        pushing = new
    L = cholesky(G, lower=True)
    return np.asarray(nnls(L.T, -solve_triangular(L, c, lower=True))[0])
