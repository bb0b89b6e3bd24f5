"""What every element loop does: deformation at the points, sums over points and over elements.

With the natural derivatives d_a = dN_a/dxi, the material ones are g_a = A' d_a with A = (dX/dxi)^-1, so
that a stress P and moduli A_ij (3 x 3 for every pair of axes) act at the nodes as

    f_ia = sum_l Pn_il d_la,            Pn = P A',
    K_ia,jb = sum_lm d_la An_ij,lm d_mb,    An_ij = A A_ij A'

summed over the points. Only A and the volumes of the points differ from element to element; d is that of
the type. Quantities of the eight points are lanes; a type with fewer points repeats its first one with
volume zero. Tensors are tuples of nine lanes, row by row.

A `Part` of the elements comes in chunks of neighbours, and these in colours: chunks of one colour
have no node in common. The colours follow one another, the chunks of one run in parallel, and each adds
to the nodes and the matrix directly: every entry receives its summands in an order that does not depend
on the number of threads.
"""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false
# numba compiles these functions; those called from Python carry types

import math
from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from sim._kernels.lanes import LANES, fetch, load, smallest, store, total
from sim._kernels.laws import FLAGS

NODES = 8
PAIRS = 36  # (a, b) with a <= b, row by row
BLOCKS = 6  # axes (i, j) with i <= j, row by row

Reals = NDArray[np.float64]
Indices = NDArray[np.int64]


class Part(NamedTuple):
    """Elements of one type, in chunks.

    Attributes
    ----------
    element : (n,) their places among all elements.
    nodes : (n, 8) node of every slot; one that is not used repeats the first.
    slope : (3 * points, 8) natural derivatives of the shape functions, the nodes as lanes.
    slope_at : (3 * 8 nodes, 8) the same, the points as lanes.
    inverse : (9 * n, 8) A [1/m], row 9 e + 3 l + J, the points as lanes.
    volume : (n, 8) rest volume of the points [m^3], zero where the type has no such point.
    chunk : (chunks + 1,) first element of every chunk.
    colour : (colours + 1,) first chunk of every colour.
    """

    element: Indices
    nodes: Indices
    slope: Reals
    slope_at: Reals
    inverse: Reals
    volume: Reals
    chunk: Indices
    colour: Indices


class Places(NamedTuple):
    """Where the blocks of the elements of a part go among the values of the matrix.

    Attributes
    ----------
    order : (n, 8) slots by ascending node, those not used last.
    start : (n, 36, 3) for the pairs of slots in this order, where row i of the block begins, had it an
        entry in each column; negative where the pair is not stored.
    special : (n,) row of target for elements with a node that is free in some directions only, or that
        stands in two slots; else -1.
    target : (m, 36, 9) place of every entry of their blocks, negative where it is not stored.
    """

    order: NDArray[np.int8]
    start: NDArray[np.int32]
    special: NDArray[np.int32]
    target: NDArray[np.int32]


@nb.njit(cache=True, fastmath=FLAGS)
def gather(q, nodes, e, x):
    """Positions x (8, 3) of the nodes of element e, seen from its first one, which spares rounding."""
    first = nodes[e, 0]
    for a in range(NODES):
        for i in range(3):
            x[a, i] = q[nodes[e, a], i] - q[first, i]


@nb.njit(cache=True, fastmath=FLAGS)
def _column(x, slope_at, n):
    d = load(slope_at, NODES * n)
    c0, c1, c2 = x[0, 0] * d, x[0, 1] * d, x[0, 2] * d
    for a in range(1, NODES):
        d = load(slope_at, NODES * n + a)
        c0 += x[a, 0] * d
        c1 += x[a, 1] * d
        c2 += x[a, 2] * d
    return c0, c1, c2


@nb.njit(cache=True, fastmath=FLAGS)
def deformation(x, slope_at, inverse, e):
    """F = (dx/dxi) A of element e, from derivatives slope_at (3 * 8 nodes, point)."""
    a0, b0, c0 = _column(x, slope_at, 0)
    a1, b1, c1 = _column(x, slope_at, 1)
    a2, b2, c2 = _column(x, slope_at, 2)
    r = 9 * e
    A00, A10, A20 = load(inverse, r), load(inverse, r + 3), load(inverse, r + 6)
    A01, A11, A21 = load(inverse, r + 1), load(inverse, r + 4), load(inverse, r + 7)
    A02, A12, A22 = load(inverse, r + 2), load(inverse, r + 5), load(inverse, r + 8)
    return (
        a0 * A00 + a1 * A10 + a2 * A20,
        a0 * A01 + a1 * A11 + a2 * A21,
        a0 * A02 + a1 * A12 + a2 * A22,
        b0 * A00 + b1 * A10 + b2 * A20,
        b0 * A01 + b1 * A11 + b2 * A21,
        b0 * A02 + b1 * A12 + b2 * A22,
        c0 * A00 + c1 * A10 + c2 * A20,
        c0 * A01 + c1 * A11 + c2 * A21,
        c0 * A02 + c1 * A12 + c2 * A22,
    )


@nb.njit(cache=True, fastmath=FLAGS)
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


@nb.njit(cache=True, fastmath=FLAGS)
def least(J):
    """Smallest of the lanes, NaN if one is."""
    return smallest(J) if total(J) == total(J) else math.nan


@nb.njit(cache=True, fastmath=FLAGS)
def natural(B, inverse, e):
    """B A' of a tensor B whose second index is material."""
    r = 9 * e
    A00, A10, A20 = load(inverse, r), load(inverse, r + 3), load(inverse, r + 6)
    A01, A11, A21 = load(inverse, r + 1), load(inverse, r + 4), load(inverse, r + 7)
    A02, A12, A22 = load(inverse, r + 2), load(inverse, r + 5), load(inverse, r + 8)
    return (
        B[0] * A00 + B[1] * A01 + B[2] * A02,
        B[0] * A10 + B[1] * A11 + B[2] * A12,
        B[0] * A20 + B[1] * A21 + B[2] * A22,
        B[3] * A00 + B[4] * A01 + B[5] * A02,
        B[3] * A10 + B[4] * A11 + B[5] * A12,
        B[3] * A20 + B[4] * A21 + B[5] * A22,
        B[6] * A00 + B[7] * A01 + B[8] * A02,
        B[6] * A10 + B[7] * A11 + B[8] * A12,
        B[6] * A20 + B[7] * A21 + B[8] * A22,
    )


@nb.njit(cache=True, fastmath=FLAGS)
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


@nb.njit(cache=True, fastmath=FLAGS)
def clear(w, first, n):
    """Write zeros into n rows."""
    for r in range(first, first + n):
        for k in range(LANES):
            w[r, k] = 0.0


@nb.njit(cache=True, fastmath=FLAGS)
def nodal(w, P, slope):
    """Rows f_0, f_1, f_2 over the nodes, from nine rows P over the points.

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
    return f0, f1, f2


@nb.njit(cache=True, fastmath=FLAGS)
def stiffness_block(w, A, slope, K):
    """Rows K..K + 7 over the nodes: sum over points of d_la A_lm d_mb, from nine rows A over the points.

    Eight sums, that is eight registers, run through all points; everything else is read.
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


@nb.njit(cache=True, fastmath=FLAGS)
def add_to_nodes(w, row, nodes, e, sign, f):
    """f[node, i] += sign * w[row + i, slot] of all slots; one that is not used holds zero."""
    for a in range(NODES):
        for i in range(3):
            f[nodes[e, a], i] += sign * w[row + i, a]


@nb.njit(cache=True, fastmath=FLAGS)
def add_to_matrix(w, K, nodes, places, e, values):
    """Add the six blocks in rows K to the values of the matrix, the upper triangle alone."""
    if places.special[e] >= 0:
        _add_some(w, K, nodes, places.order, e, places.target, places.special[e], values)
        return
    order, start = places.order, places.start
    p = 0
    for i in range(NODES):
        a = order[e, i]
        s, t, u = start[e, p, 0], start[e, p, 1], start[e, p, 2]
        if s >= 0:
            values[s] += w[K + a, a]
            values[s + 1] += w[K + 8 + a, a]
            values[s + 2] += w[K + 16 + a, a]
            values[t + 1] += w[K + 24 + a, a]
            values[t + 2] += w[K + 32 + a, a]
            values[u + 2] += w[K + 40 + a, a]
        p += 1
        for j in range(i + 1, NODES):
            b = order[e, j]
            s, t, u = start[e, p, 0], start[e, p, 1], start[e, p, 2]
            if s >= 0:
                values[s] += w[K + a, b]
                values[s + 1] += w[K + 8 + a, b]
                values[s + 2] += w[K + 16 + a, b]
                values[t] += w[K + 8 + b, a]
                values[t + 1] += w[K + 24 + a, b]
                values[t + 2] += w[K + 32 + a, b]
                values[u] += w[K + 16 + b, a]
                values[u + 1] += w[K + 32 + b, a]
                values[u + 2] += w[K + 40 + a, b]
            p += 1


@nb.njit(cache=True, fastmath=FLAGS)
def fetch_matrix(places, e, values):
    """Ask early for the lines that `add_to_matrix` will change, to compute while they arrive."""
    for p in range(PAIRS):
        if places.start[e, p, 0] >= 0:
            for i in range(3):
                fetch(values, places.start[e, p, i])


@nb.njit(cache=True, fastmath=FLAGS)
def _add_some(w, K, nodes, order, e, target, row, values):
    """Add those entries of the blocks that have a place."""
    p = 0
    for n in range(NODES):
        for m in range(n, NODES):
            a, b = order[e, n], order[e, m]
            twice = n < m and nodes[e, a] == nodes[e, b]  # the pair stands for (b, a), too
            block = K
            for i in range(3):
                for j in range(i, 3):
                    above, below = target[row, p, 3 * i + j], target[row, p, 3 * j + i]
                    if above >= 0:
                        values[above] += w[block + a, b]
                    if above >= 0 and twice:
                        values[above] += w[block + b, a]
                    if i < j and below >= 0:
                        values[below] += w[block + b, a]
                    block += NODES
            p += 1
