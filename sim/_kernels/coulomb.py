"""Block Gauss-Seidel sweeps of a complementarity problem with Coulomb friction."""

# pyright: basic
# numba compiles these functions; those called from Python carry types

import math

import numpy as np
from numpy.typing import NDArray

from sim._kernels.options import inner, kernel

Array = NDArray[np.float64]


@inner
def _rate(S, b, f, i):
    u = b[i]
    for j in range(len(f)):
        u += S[i, j] * f[j]
    return u


@inner
def _rub(S, b, f, i, bound):
    """Set forces i + 1, i + 2 within a disc, opposite to the slip; return the change of their rates."""
    j, k = i + 1, i + 2
    u, v = _rate(S, b, f, j), _rate(S, b, f, k)
    x, y = f[j], f[k]
    A, B, C = S[j, j], S[j, k], S[k, k]
    determinant = A * C - B * B
    stuck = False
    if determinant > 1e-12 * A * C:
        f[j] = x - (C * u - B * v) / determinant
        f[k] = y - (A * v - B * u) / determinant
        stuck = f[j] * f[j] + f[k] * f[k] <= bound * bound
    rho = 0.5 * (A + C) + math.sqrt(0.25 * (A - C) * (A - C) + B * B)
    if not stuck and rho > 0.0:
        f[j], f[k] = x - u / rho, y - v / rho
        size = math.sqrt(f[j] * f[j] + f[k] * f[k])
        if size > bound:
            f[j], f[k] = f[j] * bound / size, f[k] * bound / size
    return max(abs(f[j] - x), abs(f[k] - y)) * rho


@kernel
def sweep(
    S: Array, b: Array, first: NDArray[np.int64], friction: Array, f: Array, most: int, error: float
) -> float:
    """Improve forces f (n,) in place; return the largest change of a rate S f + b in the last sweep.

    Block k begins at first[k]: one inequality, or with friction[k] > 0 a normal force followed by two
    tangential ones. At a fixed point 0 <= f_n, u_n >= 0, f_n u_n = 0 of the rates u = S f + b, and
    |f_t| <= mu f_n, f_t opposite to u_t with equality unless u_t = 0.
    """
    changed = math.inf
    for _ in range(most):
        changed = 0.0
        for k in range(len(first)):
            i = first[k]
            if S[i, i] > 0.0:
                before = f[i]
                f[i] = max(0.0, before - _rate(S, b, f, i) / S[i, i])
                changed = max(changed, abs(f[i] - before) * S[i, i])
            if friction[k] > 0.0:
                changed = max(changed, _rub(S, b, f, i, friction[k] * f[i]))
        if changed <= error:
            break
    return float(changed)
