"""Volume of elements and of nodal regions, with their first and second derivatives.

With N = cof(F) A' in natural coordinates (`sim._kernels.element`) and h_a = dV N d_a at a point of
rest volume dV, the current volume v = dV det F has

    dv/dx_a = h_a,      d2v/dx_a dx_b = (h_a h_b' - h_b h_a') / v.
"""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false
# numba compiles these functions; those called from Python carry types

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim._kernels.element import (
    BLOCKS,
    NODES,
    Indices,
    Part,
    Reals,
    clear,
    cofactor,
    deformation,
    determinant,
    gather,
    natural,
    nodal,
    put,
    stiffness_block,
)
from sim._kernels.lanes import load, rows, store, total
from sim._kernels.options import LEAST_ROWS, by_chunk, by_colour, in_threads, inner
from sim._kernels.scatter import Places, add_to_matrix, fetch_matrix, subtract_from_nodes

# rows of the scratch array: N, pressure or 1 times dV N, derivative of the volume, moduli, blocks
_N, _P, _H, _A, _K = map(np.int64, (0, 9, 18, 21, 48))
VOLUME_ROWS = 96
_OFF_DIAGONAL = (1, 2, 4)  # The second derivative has no blocks of equal axes.


@inner
def _deform(w, q, part, e, x):
    """Write N; det F."""
    gather(q, part.nodes, e, x)
    F = deformation(x, part.slope_at, part.inverse, e)
    C = cofactor(F)
    put(w, _N, natural(C, part.inverse, e))
    return determinant(F, C)


@inner
def _derivative(w, factor, slope):
    """Write into rows _H the sum over points of factor N d."""
    for r in range(9):
        store(w, _P + r, factor * load(w, _N + r))
    nodal(w, _P, slope, _H)


@inner
def _curvature(w, c, slope):
    """Write into rows _K the sum over points of c (N d_a (N d_b)' - N d_b (N d_a)')."""
    row = _A
    for i in range(3):
        for j in range(i + 1, 3):
            for n in range(3):
                p, r = c * load(w, _N + 3 * i + n), c * load(w, _N + 3 * j + n)
                for m in range(3):
                    value = p * load(w, _N + 3 * j + m) - r * load(w, _N + 3 * i + m)
                    store(w, row + 3 * n + m, value)
            row += 9
    for n, block in enumerate(_OFF_DIAGONAL):
        stiffness_block(w, _A + 9 * n, slope, _K + NODES * block)


@inner
def _add_square(w, stiffness):
    """Add stiffness h h' to the blocks."""
    block = _K
    for i in range(3):
        for j in range(i, 3):
            h = stiffness * load(w, _H + j)
            for a in range(NODES):
                store(w, block + a, load(w, block + a) + w[_H + i, a] * h)
            block += NODES


@in_threads(by_colour)
def add_pressure(
    first: int,
    last: int,
    q: Reals,
    part: Part,
    places: Places,
    kappa: Reals,
    pressure: Reals,
    with_force: bool,
    with_tangent: bool,
    f: Reals,
    energy: Reals,
    values: Reals,
) -> None:
    """Pressure in the points of every element: f -= p dv/dx, values += p d2v/dx2 + dp/dx dv/dx.

    With kappa (element,) the pressure is kappa (v/V - 1) of the volume of the whole element, and
    energy receives kappa/2 V (v/V - 1)^2; elements of kappa 0 are skipped. With an empty kappa, the
    pressure (element, 8) is given and does not depend on x.
    """
    by_element = kappa.size > 0
    x = np.empty((NODES, 3))
    w = rows(VOLUME_ROWS)
    for e in range(part.chunk[first], part.chunk[last]):
        own = part.element[e]
        if by_element:
            energy[own] = 0.0
            if kappa[own] == 0.0:
                continue
        if with_tangent:
            fetch_matrix(places, e, values)
        J = _deform(w, q, part, e, x)
        dV = load(part.volume, e)
        stiffness = 0.0
        if by_element:
            rest = total(dV)
            strain = total(dV * J) / rest - 1.0
            stiffness = kappa[own] / rest
            energy[own] = 0.5 * kappa[own] * strain * strain * rest
            p = kappa[own] * strain * dV
        else:
            p = load(pressure, own) * dV
        if with_force:
            _derivative(w, p, part.slope)
            subtract_from_nodes(w, _H, part.nodes, e, f)
        if with_tangent:
            clear(w, _K, BLOCKS * NODES)
            _curvature(w, p / J, part.slope)
            if by_element:
                _derivative(w, dV, part.slope)
                _add_square(w, stiffness)
            add_to_matrix(w, _K, part.nodes, places, e, values)


@in_threads(by_chunk)
def element_volumes(first: int, last: int, q: Reals, part: Part, v: Reals, h: Reals) -> None:
    """Current volume v (element,) of every element and its derivative h (3 * element, 8)."""
    x = np.empty((NODES, 3))
    w = rows(VOLUME_ROWS)
    for e in range(part.chunk[first], part.chunk[last]):
        own = part.element[e]
        J = _deform(w, q, part, e, x)
        dV = load(part.volume, e)
        v[own] = total(dV * J)
        _derivative(w, dV, part.slope)
        for i in range(3):
            store(h, 3 * own + i, load(w, _H + i))


@in_threads(by_chunk)
def point_volumes(first: int, last: int, q: Reals, part: Part, v: Reals, n: Reals) -> None:
    """Current volume v (element, 8) of every point and dV N into n (element, 8, 9)."""
    x = np.empty((NODES, 3))
    w = rows(VOLUME_ROWS)
    for e in range(part.chunk[first], part.chunk[last]):
        own = part.element[e]
        J = _deform(w, q, part, e, x)
        dV = load(part.volume, e)
        store(v, own, dV * J)
        for r in range(9):
            store(w, _P + r, dV * load(w, _N + r))
        for k in range(part.slope.shape[0] // 3):
            for r in range(9):
                n[own, k, r] = w[_P + r, k]


class NodePoints(NamedTuple):
    """Quadrature points of the regions of nodes.

    start, element, point : the points (element[k], point[k]) for k in start[m]..start[m + 1] belong to
        node m.
    place : (k, 8) position of the node of every slot in the star of m, negative for an unused slot.
    star_start : first entry of the star of every node.
    """

    start: Indices
    element: Indices
    point: Indices
    place: Indices
    star_start: Indices


@in_threads(lambda v, n, slope, kind, corners, *_: [(0, corners.start.size - 1)], LEAST_ROWS)
def gather_nodal(
    first: int,
    last: int,
    v: Reals,
    n: Reals,
    slope: Reals,
    kind: Indices,
    corners: NodePoints,
    nodal_volume: Reals,
    g: Reals,
) -> None:
    """Volume of every nodal region and its derivative.

    v and n are those of `point_volumes`, and the natural derivatives at point p of element e are rows
    24 kind[e] + 3 p onwards of slope. Writes nodal_volume (node,) and g (star entries, 3) = d
    nodal_volume / dx.
    """
    h, start, star_start, place = (
        np.empty((3, NODES)),
        corners.start,
        corners.star_start,
        corners.place,
    )
    for m in range(first, last):
        sum_v = 0.0
        for s in range(star_start[m], star_start[m + 1]):
            for i in range(3):
                g[s, i] = 0.0
        for k in range(start[m], start[m + 1]):
            e, p = corners.element[k], corners.point[k]
            sum_v += v[e, p]
            r = 24 * kind[e] + 3 * p
            d0, d1, d2 = load(slope, r), load(slope, r + 1), load(slope, r + 2)
            for i in range(3):
                j = 3 * i
                store(h, i, n[e, p, j] * d0 + n[e, p, j + 1] * d1 + n[e, p, j + 2] * d2)
            for a in range(NODES):
                if place[k, a] >= 0:
                    for i in range(3):
                        g[place[k, a], i] += h[i, a]
        nodal_volume[m] = sum_v


@in_threads(lambda stiffness, g, start, *_: [(0, start.size - 1)], LEAST_ROWS)
def add_products(
    begin: int,
    end: int,
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

    Block p is the sum over the nodes node[k], k in start[p]..start[p + 1], with the star entries
    first[k] and second[k] of its two nodes.
    """
    s = np.empty(9)
    for p in range(begin, end):
        s00 = s01 = s02 = s10 = s11 = s12 = s20 = s21 = s22 = 0.0
        for k in range(start[p], start[p + 1]):
            c, a, b = stiffness[node[k]], first[k], second[k]
            b0, b1, b2 = g[b, 0], g[b, 1], g[b, 2]
            a0, a1, a2 = c * g[a, 0], c * g[a, 1], c * g[a, 2]
            s00, s01, s02 = s00 + a0 * b0, s01 + a0 * b1, s02 + a0 * b2
            s10, s11, s12 = s10 + a1 * b0, s11 + a1 * b1, s12 + a1 * b2
            s20, s21, s22 = s20 + a2 * b0, s21 + a2 * b1, s22 + a2 * b2
        s[0], s[1], s[2], s[3], s[4] = s00, s01, s02, s10, s11
        s[5], s[6], s[7], s[8] = s12, s20, s21, s22
        for i in range(9):
            if target[p, i] >= 0:
                out[target[p, i]] += s[i]
