"""Symmetric tensors of three dimensions: six components, principal values, divided differences.

Six numbers in the order xx yy zz xy yz zx, all of them tensor components (no factor two on shears).
"""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import math

import numpy as np

from sim._kernels.options import inner, kernel_and_inner

# row and column of the six components, and the inverse map
ROW = np.array([0, 1, 2, 0, 1, 2])
COLUMN = np.array([0, 1, 2, 1, 2, 0])
PLACE = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])


@inner
def contract(A, B):
    """A : B of two symmetric tensors."""
    return A[0] * B[0] + A[1] * B[1] + A[2] * B[2] + 2.0 * (A[3] * B[3] + A[4] * B[4] + A[5] * B[5])


@inner
def turn(aii, ajj, aij):
    """Tangent, cosine and sine of the Jacobi rotation that makes aij zero."""
    theta = (ajj - aii) / (2.0 * aij)
    if abs(theta) > 1e150:  # theta^2 would overflow
        return 0.5 / theta, 1.0, 0.5 / theta
    t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
    if theta < 0.0:
        t = -t
    c = 1.0 / math.sqrt(t * t + 1.0)
    return t, c, t * c


@inner
def turn_columns(N, i, j, c, s):
    """Rotate columns i and j of N (3, 3)."""
    for m in range(3):
        ni, nj = N[m, i], N[m, j]
        N[m, i] = c * ni - s * nj
        N[m, j] = s * ni + c * nj


@kernel_and_inner
def principal(C, c, N):
    """Eigenvalues c (3,) of a symmetric tensor and unit eigenvectors in the columns of N (3, 3).

    Cyclic Jacobi rotations: accurate also where eigenvalues coincide, unlike the closed form.
    """
    a, b, d, ab, bd, da = C[0], C[1], C[2], C[3], C[4], C[5]
    for i in range(3):
        for j in range(3):
            N[i, j] = 1.0 if i == j else 0.0
    size = a * a + b * b + d * d
    for _ in range(12):
        if not (ab * ab + bd * bd + da * da > 1e-33 * size):  # The iteration also ends with NaN.
            break
        if ab != 0.0:
            t, co, si = turn(a, b, ab)
            a, b, ab = a - t * ab, b + t * ab, 0.0
            da, bd = co * da - si * bd, si * da + co * bd
            turn_columns(N, 0, 1, co, si)
        if da != 0.0:
            t, co, si = turn(a, d, da)
            a, d, da = a - t * da, d + t * da, 0.0
            ab, bd = co * ab - si * bd, si * ab + co * bd
            turn_columns(N, 0, 2, co, si)
        if bd != 0.0:
            t, co, si = turn(b, d, bd)
            b, d, bd = b - t * bd, d + t * bd, 0.0
            ab, da = co * ab - si * da, si * ab + co * da
            turn_columns(N, 1, 2, co, si)
    c[0], c[1], c[2] = a, b, d


@inner
def power_slope(x, y, b):
    """Divided difference (x^b - y^b)/(x - y), and its limit for equal x and y."""
    r = (x - y) / y
    if r == 0.0:
        return b * y ** (b - 1.0)
    return y ** (b - 1.0) * math.expm1(b * math.log1p(r)) / r


@inner
def from_principal(N, s, d, shear, S, D, with_tangent, work):
    """S and D of an isotropic law from its principal values.

    s (3,) principal stresses; d (3, 3) the derivatives 2 ds_i/dc_j; shear (3,) the divided
    differences 2 (s_i - s_j)/(c_i - c_j) of the pairs 01, 12, 20.
    """
    for a in range(6):
        S[a] = 0.0
        for i in range(3):
            S[a] += s[i] * N[ROW[a], i] * N[COLUMN[a], i]
    if not with_tangent:
        return
    G, H = work[2], work[3]  # G: the dyads of the eigenvectors, then those of the pairs
    for a in range(6):
        k, m = ROW[a], COLUMN[a]
        for i in range(3):
            j = (i + 1) % 3
            G[i, a] = N[k, i] * N[m, i]
            G[3 + i, a] = 0.5 * (N[k, i] * N[m, j] + N[k, j] * N[m, i])
    for i in range(3):
        for b in range(6):
            H[i, b] = d[i, 0] * G[0, b] + d[i, 1] * G[1, b] + d[i, 2] * G[2, b]
    for a in range(6):
        for b in range(6):
            x = 0.0
            for i in range(3):
                x += G[i, a] * H[i, b] + 2.0 * shear[i] * G[3 + i, a] * G[3 + i, b]
            D[a, b] = x
