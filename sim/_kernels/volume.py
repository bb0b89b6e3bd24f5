"""Volume of elements and of nodal regions, with their first and second derivatives.

With h_a = dV cof(F) g_a at a Gauss point of rest volume dV, the present volume v = dV det F has

    dv/dx_a = h_a,      d2v/dx_a dx_b = (h_a h_b' - h_b h_a') / v.
"""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import numba as nb
import numpy as np
from numpy.typing import NDArray

from sim._kernels.laws import FLAGS
from sim._kernels.solid import CHUNKS, NODES, _gradient

Reals = NDArray[np.float64]
Indices = NDArray[np.int64]


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
def volumes(q: Reals, nodes: Indices, gradient: Reals, volume: Reals, v: Reals, h: Reals) -> None:
    """Present volume v (element, point) of every Gauss point and dv/dx h (element, point, 3, 8)."""
    n = nodes.shape[0]
    for chunk in nb.prange(CHUNKS):
        x = np.empty((3, NODES))
        F = np.empty((3, 3))
        C = np.empty((3, 3))
        for e in range(chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS):
            for a in range(NODES):
                for i in range(3):
                    x[i, a] = q[nodes[e, a], i]
            for k in range(gradient.shape[1]):
                dV = volume[e, k]
                g = gradient[e, k]
                v[e, k] = dV * _gradient(x, g, F, C)
                for i in range(3):
                    for a in range(NODES):
                        h[e, k, i, a] = dV * (
                            C[i, 0] * g[0, a] + C[i, 1] * g[1, a] + C[i, 2] * g[2, a]
                        )


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
def pressure_forces(p: Reals, h: Reals, out: Reals) -> None:
    """Element forces out (element, 3, 8) = sum over points of p dv/dx."""
    for e in nb.prange(h.shape[0]):
        for i in range(3):
            for a in range(NODES):
                s = 0.0
                for k in range(h.shape[1]):
                    s += p[e, k] * h[e, k, i, a]
                out[e, i, a] = s


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
def pressure_stiffness(p: Reals, v: Reals, h: Reals, stiffness: Reals, out: Reals) -> None:
    """Blocks out (element, 36, 9) of p d2v/dx2 + stiffness_e (sum_k h)(sum_k h)'.

    stiffness (element,) multiplies the product of the derivatives of the whole element's volume; it
    is zero where the pressure does not depend on that volume alone.
    """
    n = h.shape[0]
    for chunk in nb.prange(CHUNKS):
        total = np.empty((3, NODES))
        for e in range(chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS):
            total[:] = 0.0
            for k in range(h.shape[1]):
                for i in range(3):
                    for a in range(NODES):
                        total[i, a] += h[e, k, i, a]
            pair = 0
            for a in range(NODES):
                for b in range(a, NODES):
                    for i in range(3):
                        for j in range(3):
                            out[e, pair, 3 * i + j] = stiffness[e] * total[i, a] * total[j, b]
                    pair += 1
            for k in range(h.shape[1]):
                c = p[e, k] / v[e, k]
                pair = 0
                for a in range(NODES):
                    for b in range(a + 1, NODES):
                        pair += 1
                        for i in range(3):
                            for j in range(3):
                                out[e, pair, 3 * i + j] += c * (
                                    h[e, k, i, a] * h[e, k, j, b] - h[e, k, i, b] * h[e, k, j, a]
                                )
                    pair += 1


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
def gather_nodal(
    v: Reals,
    h: Reals,
    start: Indices,
    element: Indices,
    point: Indices,
    place: Indices,
    star_start: Indices,
    nodal_volume: Reals,
    g: Reals,
) -> None:
    """Volume of every nodal region and its derivative.

    The Gauss points (element[k], point[k]) for k in start[n]..start[n + 1] belong to node n;
    place[k, a] is where the node of slot a stands in the star of n, negative for an unused slot.
    Writes nodal_volume (node,) and g (star entries, 3) = d nodal_volume / dx.
    """
    for n in nb.prange(start.size - 1):
        total = 0.0
        for s in range(star_start[n], star_start[n + 1]):
            for i in range(3):
                g[s, i] = 0.0
        for k in range(start[n], start[n + 1]):
            e, q = element[k], point[k]
            total += v[e, q]
            for a in range(NODES):
                if place[k, a] >= 0:
                    for i in range(3):
                        g[place[k, a], i] += h[e, q, i, a]
        nodal_volume[n] = total


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
def add_products(
    stiffness: Reals,
    g: Reals,
    start: Indices,
    node: NDArray[np.int32],
    first: NDArray[np.int32],
    second: NDArray[np.int32],
    target: NDArray[np.int32],
    out: Reals,
) -> None:
    """Add sum over nodes of stiffness_n g_n g_n' to the matrix, block by block.

    Block p collects the nodes node[k], k in start[p]..start[p + 1], with the star entries first[k] and
    second[k] of its two nodes.
    """
    for p in nb.prange(start.size - 1):
        s = np.zeros(9)
        for k in range(start[p], start[p + 1]):
            c, a, b = stiffness[node[k]], first[k], second[k]
            for i in range(3):
                for j in range(3):
                    s[3 * i + j] += c * g[a, i] * g[b, j]
        for i in range(9):
            where = target[p, i]
            if where >= 0:
                out[where] += s[i]
