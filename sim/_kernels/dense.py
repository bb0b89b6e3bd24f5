"""Small dense matrices: copies, factor of a symmetric one stored by its lower triangle, solutions.

Matrices are stored by columns, so that loops run along them. Zeros are skipped: bodies in a chain give
banded matrices. Indices are unsigned, because a signed one might count from the end of an array, which
keeps loops from being vectorised.
"""

# pyright: basic

import math

import numpy as np

from sim._kernels.options import inner

PIVOT = 1e-4
"""Least size of a negative pivot, relative to the diagonal; smaller ones would lose digits."""


@inner
def copy(source, target):
    """Copy an array (n, m); an assignment of slices would count references."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@inner
def factorise(A, sign, n):
    """Factor L J L' in place of a lower triangle, J = diag(sign), without exchange of rows.

    Returns the number of negative signs; -1 for a small or undefined pivot.
    """
    negative, one, n = 0, np.uint64(1), np.uint64(n)
    for k in range(n):
        sign[k] = PIVOT * abs(A[k, k])
    for k in range(n):
        d = A[k, k]
        if not d > 0.0:
            if not d < -sign[k]:
                return -1
            negative += 1
        sign[k] = 1.0 if d > 0.0 else -1.0
        A[k, k] = d = math.sqrt(abs(d))
        for i in range(k + one, n):
            A[i, k] /= d
        for j in range(k + one, n):
            x = sign[k] * A[j, k]
            if x != 0.0:
                for i in range(j, n):
                    A[i, j] -= x * A[i, k]
    return negative


@inner
def solve_lower(L, x, n):
    """Solve L y = x in place, for a lower triangle L."""
    one, n = np.uint64(1), np.uint64(n)
    for k in range(n):
        y = x[k]
        if y != 0.0:
            y /= L[k, k]
            x[k] = y
            for i in range(k + one, n):
                x[i] -= y * L[i, k]


@inner
def solve_upper(L, x, n):
    """Solve L'y = x in place, for a lower triangle L."""
    one, n = np.uint64(1), np.uint64(n)
    for k in range(n):
        i = n - one - k
        s = x[i]
        for j in range(i + one, n):
            s -= L[j, i] * x[j]
        x[i] = s / L[i, i]
