"""Small dense matrices: copies, Cholesky factor of a stored lower triangle, and solutions."""

# pyright: basic

import math

from sim._kernels.options import bare


@bare
def copy(source, target):
    """Copy an array (n, m); an assignment of slices would count references."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@bare
def row_product(A, i, B, j, n):
    """Product of the first n entries of row i of A and row j of B."""
    s = 0.0
    for k in range(n):
        s += A[i, k] * B[j, k]
    return s


@bare
def cholesky(A, n):
    """Lower factor in place of a lower triangle; False unless it is positive definite."""
    for i in range(n):
        for j in range(i + 1):
            s = A[i, j] - row_product(A, i, A, j, j)
            if j < i:
                A[i, j] = s / A[j, j]
            elif s > 0.0:
                A[i, i] = math.sqrt(s)
            else:
                return False
    return True


@bare
def solve_lower(L, x, n):
    """Solve L y = x in place, for a lower triangle L; zeros at the start of x stay zero."""
    first = 0
    while first < n and x[first] == 0.0:
        first += 1
    for i in range(first, n):
        s = x[i]
        for j in range(first, i):
            s -= L[i, j] * x[j]
        x[i] = s / L[i, i]


@bare
def solve_upper(L, x, n):
    """Solve L'y = x in place, for a lower triangle L."""
    for i in range(n - 1, -1, -1):
        x[i] /= L[i, i]
        for j in range(i):
            x[j] -= L[i, j] * x[i]
