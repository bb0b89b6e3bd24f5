"""Small dense matrices: copies, factor of a symmetric one stored by its lower triangle, solutions.

Matrices are stored by columns, so that loops run along them. Zeros are skipped: bodies in a chain give
banded matrices.
"""

# pyright: basic

import math

from sim._kernels.options import bare

PIVOT = 1e-4
"""Least size of a negative pivot, relative to the diagonal; smaller ones would lose digits."""


@bare
def copy(source, target):
    """Copy an array (n, m); an assignment of slices would count references."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@bare
def factorise(A, sign, n):
    """Factor L J L' in place of a lower triangle, J = diag(sign), without exchange of rows.

    Returns the number of negative signs; -1 for a small or undefined pivot.
    """
    negative = 0
    for k in range(n):
        sign[k] = PIVOT * abs(A[k, k])
    for k in range(n):
        d = A[k, k]
        if not d > 0.0:
            if not d < -sign[k]:
                return -1
            negative += 1
        sign[k] = 1.0 if d > 0.0 else -1.0
        A[k, k] = math.sqrt(abs(d))
        for i in range(k + 1, n):
            A[i, k] /= A[k, k]
        for j in range(k + 1, n):
            x = sign[k] * A[j, k]
            if x != 0.0:
                for i in range(j, n):
                    A[i, j] -= x * A[i, k]
    return negative


@bare
def solve_lower(L, x, n):
    """Solve L y = x in place, for a lower triangle L."""
    for k in range(n):
        if x[k] != 0.0:
            x[k] /= L[k, k]
            for i in range(k + 1, n):
                x[i] -= x[k] * L[i, k]


@bare
def solve_lower_all(L, X, n, m):
    """Solve L Y = X (n, m) in place; X is stored by rows."""
    for k in range(n):
        for r in range(m):
            X[k, r] /= L[k, k]
        for i in range(k + 1, n):
            x = L[i, k]
            if x != 0.0:
                for r in range(m):
                    X[i, r] -= x * X[k, r]


@bare
def solve_upper(L, x, n):
    """Solve L'y = x in place, for a lower triangle L."""
    for i in range(n - 1, -1, -1):
        s = x[i]
        for k in range(i + 1, n):
            s -= L[k, i] * x[k]
        x[i] = s / L[i, i]


@bare
def add_product(S, i, x, Y, k):
    """Add x Y[k, j] to the entries S[i, j] of a lower triangle."""
    if x != 0.0:
        for j in range(i + 1):
            S[i, j] += x * Y[k, j]
