"""Operations common to element loops: deformation at the points, sums over the points.

With the natural derivatives d_a = dN_a/dxi, the material ones are g_a = A' d_a with A =
(dX/dxi)^-1, so that a stress P and moduli A_ij (3 x 3 for every pair of axes) contribute at the
nodes

    f_ia = sum_l Pn_il d_la,            Pn = P A',
    K_ia,jb = sum_lm d_la An_ij,lm d_mb,    An_ij = A A_ij A'

summed over the points. Only A and the volumes of the points depend on the element, d on its type.
Quantities of the eight points are lanes; a type with fewer points repeats its first one with
volume zero. Tensors are tuples of nine lanes, row by row.
"""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false
# numba compiles these functions; those called from Python carry types

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim._kernels.lanes import LANES, load, smallest, store, total
from sim._kernels.options import inner

NODES = 8
BLOCKS = 6  # axes (i, j) with i <= j, row by row
_FIRST, _SECOND, _THIRD = map(np.int64, range(3))  # a function is compiled for each literal number

Reals = NDArray[np.float64]
Indices = NDArray[np.int64]


class Part(NamedTuple):
    """Elements of one type, in chunks."""

    element: Indices  #: (n,) indices among all elements
    nodes: Indices  #: (n, 8) node of every slot; unused slots repeat the first
    slope: Reals  #: (3 * points, 8) natural derivatives of the shape functions, the nodes as lanes
    slope_at: Reals  #: (3 * 8 nodes, 8) the same, the points as lanes
    inverse: Reals  #: (9 * n, 8) A [1/m], row 9 e + 3 l + J, the points as lanes
    volume: Reals  #: (n, 8) rest volume of the points [m^3], zero if the type has no such point
    chunk: Indices  #: (chunks + 1,) first element of every chunk
    colour: Indices  #: (colours + 1,) first chunk of every colour


@inner
def gather(q, nodes, e, x):
    """Positions x (8, 3) of the nodes of element e relative to its first one, to reduce rounding."""
    first = nodes[e, 0]
    for a in range(NODES):
        for i in range(3):
            x[a, i] = q[nodes[e, a], i] - q[first, i]


@inner
def _column(x, slope_at, n):
    d = load(slope_at, NODES * n)
    c0, c1, c2 = x[0, 0] * d, x[0, 1] * d, x[0, 2] * d
    for a in range(1, NODES):
        d = load(slope_at, NODES * n + a)
        c0 += x[a, 0] * d
        c1 += x[a, 1] * d
        c2 += x[a, 2] * d
    return c0, c1, c2


@inner
def gradient(x, slope_at):
    """Natural derivatives dx/dxi of element positions (8, 3), from slope_at (3 * 8 nodes, point)."""
    a0, b0, c0 = _column(x, slope_at, _FIRST)
    a1, b1, c1 = _column(x, slope_at, _SECOND)
    a2, b2, c2 = _column(x, slope_at, _THIRD)
    return a0, a1, a2, b0, b1, b2, c0, c1, c2


@inner
def take(w, row):
    """Nine lanes of a tensor from rows, as written by `put`."""
    first = load(w, row), load(w, row + 1), load(w, row + 2)
    second = load(w, row + 3), load(w, row + 4), load(w, row + 5)
    return first + second + (load(w, row + 6), load(w, row + 7), load(w, row + 8))


@inner
def product(S, T):
    """S T of two tensors."""
    return (
        S[0] * T[0] + S[1] * T[3] + S[2] * T[6],
        S[0] * T[1] + S[1] * T[4] + S[2] * T[7],
        S[0] * T[2] + S[1] * T[5] + S[2] * T[8],
        S[3] * T[0] + S[4] * T[3] + S[5] * T[6],
        S[3] * T[1] + S[4] * T[4] + S[5] * T[7],
        S[3] * T[2] + S[4] * T[5] + S[5] * T[8],
        S[6] * T[0] + S[7] * T[3] + S[8] * T[6],
        S[6] * T[1] + S[7] * T[4] + S[8] * T[7],
        S[6] * T[2] + S[7] * T[5] + S[8] * T[8],
    )


@inner
def along(T, direction, row):
    """T a of a tensor and a direction a, direction[row], equal at all points."""
    a0, a1, a2 = direction[row, 0], direction[row, 1], direction[row, 2]
    return (
        T[0] * a0 + T[1] * a1 + T[2] * a2,
        T[3] * a0 + T[4] * a1 + T[5] * a2,
        T[6] * a0 + T[7] * a1 + T[8] * a2,
    )


@inner
def deformation(x, slope_at, inverse, e):
    """F = (dx/dxi) A of element e, from derivatives slope_at (3 * 8 nodes, point)."""
    return product(gradient(x, slope_at), take(inverse, 9 * e))


@inner
def cofactor(F):
    """Cofactor of F, J F^-T."""
    return (
        F[4] * F[8] - F[5] * F[7],
        F[5] * F[6] - F[3] * F[8],
        F[3] * F[7] - F[4] * F[6],
        F[2] * F[7] - F[1] * F[8],
        F[0] * F[8] - F[2] * F[6],
        F[1] * F[6] - F[0] * F[7],
        F[1] * F[5] - F[2] * F[4],
        F[2] * F[3] - F[0] * F[5],
        F[0] * F[4] - F[1] * F[3],
    )


@inner
def determinant(F, C):
    """Det F, from F and its cofactor."""
    return F[0] * C[0] + F[1] * C[1] + F[2] * C[2]


@inner
def least(J):
    """Smallest of the lanes, NaN if one is."""
    return smallest(J) if total(J) == total(J) else math.nan


@inner
def natural(B, inverse, e):
    """B A' of a tensor B whose second index is material."""
    A = take(inverse, 9 * e)
    return product(B, (A[0], A[3], A[6], A[1], A[4], A[7], A[2], A[5], A[8]))


@inner
def put(w, row, T):
    """Write the nine lanes of a tensor into rows."""
    store(w, row, T[0])
    store(w, row + 1, T[1])
    store(w, row + 2, T[2])
    store(w, row + 3, T[3])
    store(w, row + 4, T[4])
    store(w, row + 5, T[5])
    store(w, row + 6, T[6])
    store(w, row + 7, T[7])
    store(w, row + 8, T[8])


@inner
def clear(w, first, n):
    """Write zeros into n rows."""
    for r in range(first, first + n):
        for k in range(LANES):
            w[r, k] = 0.0


@inner
def nodal(w, P, slope, f):
    """Write rows f..f + 2 over the nodes: sum over points of P_il d_la, from nine rows P of points.

    slope (3 * points, node) holds d of point k in rows 3 k..3 k + 2.
    """
    d = load(slope, 0)
    f0, f1, f2 = w[P, 0] * d, w[P + 3, 0] * d, w[P + 6, 0] * d
    for r in range(1, slope.shape[0]):
        k, n = r // 3, r % 3
        d = load(slope, r)
        f0 += w[P + n, k] * d
        f1 += w[P + 3 + n, k] * d
        f2 += w[P + 6 + n, k] * d
    store(w, f, f0)
    store(w, f + 1, f1)
    store(w, f + 2, f2)


@inner
def stiffness_block(w, A, slope, K):
    """Rows K..K + 7 over the nodes: sum over points of d_la A_lm d_mb, from nine rows A over the points.

    Eight sums, in eight registers, run through all points; all other values are read.
    """
    d = load(slope, 0)
    c0 = c1 = c2 = c3 = c4 = c5 = c6 = c7 = d - d
    for k in range(slope.shape[0] // 3):
        r = 3 * k
        d0, d1, d2 = load(slope, r), load(slope, r + 1), load(slope, r + 2)
        for n in range(3):
            a = A + 3 * n
            b = w[a, k] * d0 + w[a + 1, k] * d1 + w[a + 2, k] * d2
            c0 += slope[r + n, 0] * b
            c1 += slope[r + n, 1] * b
            c2 += slope[r + n, 2] * b
            c3 += slope[r + n, 3] * b
            c4 += slope[r + n, 4] * b
            c5 += slope[r + n, 5] * b
            c6 += slope[r + n, 6] * b
            c7 += slope[r + n, 7] * b
    store(w, K, c0)
    store(w, K + 1, c1)
    store(w, K + 2, c2)
    store(w, K + 3, c3)
    store(w, K + 4, c4)
    store(w, K + 5, c5)
    store(w, K + 6, c6)
    store(w, K + 7, c7)


@inner
def stiffness_blocks(w, A, slope, K):
    """The six blocks in rows K..K + 47, from the moduli in rows A..A + 53."""
    for block in range(BLOCKS):
        stiffness_block(w, A + 9 * block, slope, K + NODES * block)
