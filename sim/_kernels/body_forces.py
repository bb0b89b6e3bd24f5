"""Generalised forces of line muscles and loads on rigid bodies, and their share of the step's matrix."""

# pyright: basic

import math

import numpy as np

from sim._kernels.frames import add, cross, inner_product, minus, put, vector
from sim._kernels.lines import tension, velocity_factor
from sim._kernels.options import inner

NEXT = tuple(np.uint64(k) for k in range(6))
"""Offsets of unsigned indices, which cannot count from the end of an array."""


@inner
def _add_block(A, row, column, s, t, e, across, along):
    """A += V'(across 1 + along e e')W of derivatives V, W of two points by twists, with arms s, t.

    V = (1, -s x), so the block is along (e, s x e)(e, t x e)' + across (1, -t x; s x, s.t - t s').
    """
    m, n = cross(s, e), cross(t, e)
    x, y, z = along * e[0], along * e[1], along * e[2]
    _add_column(A, row, column, e, m, x, (across, 0.0, 0.0), (0.0, across * s[2], -across * s[1]))
    _add_column(
        A, row, column + NEXT[1], e, m, y, (0.0, across, 0.0), (-across * s[2], 0.0, across * s[0])
    )
    _add_column(
        A, row, column + NEXT[2], e, m, z, (0.0, 0.0, across), (across * s[1], -across * s[0], 0.0)
    )
    x, y, z = along * n[0], along * n[1], along * n[2]
    t, st = (across * t[0], across * t[1], across * t[2]), across * inner_product(s, t)
    _add_column(A, row, column + NEXT[3], e, m, x, (0.0, -t[2], t[1]), _less(t, s[0], st, 0.0, 0.0))
    _add_column(A, row, column + NEXT[4], e, m, y, (t[2], 0.0, -t[0]), _less(t, s[1], 0.0, st, 0.0))
    _add_column(A, row, column + NEXT[5], e, m, z, (-t[1], t[0], 0.0), _less(t, s[2], 0.0, 0.0, st))


@inner
def _less(t, x, a, b, c):
    """Vector (a, b, c) - x t."""
    return (a - x * t[0], b - x * t[1], c - x * t[2])


@inner
def _add_column(A, i, j, e, m, x, u, v):
    """A[i:i + 6, j] += x (e, m) + (u, v)."""
    A[i, j] += x * e[0] + u[0]
    A[i + NEXT[1], j] += x * e[1] + u[1]
    A[i + NEXT[2], j] += x * e[2] + u[2]
    A[i + NEXT[3], j] += x * m[0] + v[0]
    A[i + NEXT[4], j] += x * m[1] + v[1]
    A[i + NEXT[5], j] += x * m[2] + v[2]


@inner
def add_wrench(x, c, s, f, factor):
    """x[c:c + 6] += factor (f, s x f)."""
    m = cross(s, f)
    x[c] += factor * f[0]
    x[c + 1] += factor * f[1]
    x[c + 2] += factor * f[2]
    x[c + 3] += factor * m[0]
    x[c + 4] += factor * m[1]
    x[c + 5] += factor * m[2]


@inner
def measure_segments(start, point, q, way):
    """Unit vectors and lengths of the segments of all fibres from positions q."""
    for k in range(len(start) - 1):
        for i in range(start[k], start[k + 1] - 1):
            d = minus(vector(q, point[i + 1]), vector(q, point[i]))
            size = math.sqrt(inner_product(d, d))
            put(way, i, 0, d, 1.0 / size if size > 0.0 else 0.0)
            way[i, 3] = size


@inner
def _add_segment(a, b, first, arm, e, across, along, A, whole, g):
    """A += across V'V + along (V'e)(V'e)' and, if whole, g += V'e, for a segment a to b along e.

    V is the derivative of the vector from a to b by twists.
    """
    later = first[a] > first[b]
    for block in range(3):
        p = a if block == 0 or (block == 2 and later) else b
        q = p if block < 2 else (b if later else a)
        if first[p] < 0 or first[q] < 0:
            continue
        row, column = np.uint64(first[p]), np.uint64(first[q])
        sign = 1.0 if block < 2 else -1.0
        s, t = vector(arm, p), vector(arm, q)
        _add_block(A, row, column, s, t, e, sign * across, sign * along)
        if whole and block < 2:
            add_wrench(g, row, s, e, 2.0 * block - 1.0)


@inner
def _rate(point, first, last, v, way):
    """Rate of the length of segments first..last by the velocities v of points [m/s]."""
    rate = 0.0
    for i in range(first, last):
        rate += inner_product(vector(way, i), minus(vector(v, point[i + 1]), vector(v, point[i])))
    return rate


@inner
def add_line(table, lines, k, activation, points, by_damping, by_stiffness, A, r, g):
    """Forces of fibre k on its points, and its share of A, after `measure_segments`.

    With the length L of the path the stiffness is F' g g' + F d2L/dx2, and the damping d g g', g =
    dL/dw. The rotation of lever arms is added with the forces of all terms; segments between points of
    one body contribute nothing. A force-velocity relation is linear about the rate r of the start of the
    step, with the force F_act (f_v(r) - 1 - f_v' r) and the damping F_act f_v'.
    """
    way, point, n = points.way, table.point, len(g)
    total, first, last = 0.0, table.start[k], table.start[k + 1] - 1
    for i in range(first, last):
        total += way[i, 3]
    rated, F, passive, slope = lines.relation[k, 0] > 0.0, 0.0, 0.0, 0.0
    for active in range(0 if rated else 1, 2):
        passive = F
        _, F, slope = tension(lines, k, total, activation, float(active))
    damping, excess = lines.damping[k], 0.0
    if rated:
        rate = _rate(point, first, last, points.v, way)
        excess, steep = velocity_factor(lines, k, rate)
        excess = (F - passive) * (excess - steep * rate)
        damping += (F - passive) * steep
    along = by_stiffness * slope + by_damping * damping
    one = last == first + 1
    pull = damping * _rate(point, first, last, points.carried, way) + excess
    whole = pull != 0.0 or not one
    if whole:
        for i in range(n):
            g[i] = 0.0
    for i in range(first, last):
        a, b, e = np.uint64(point[i]), np.uint64(point[i + 1]), vector(way, i)
        if table.first[a] == table.first[b]:
            continue
        add(points.force, a, 0, e, F)
        add(points.force, b, 0, e, -F)
        across = by_stiffness * F / way[i, 3]
        rest = (along if one else 0.0) - across
        _add_segment(a, b, table.first, points.arm, e, across, rest, A, whole, g)
    if whole:
        for i in range(n):
            r[i] -= pull * g[i]
    if not one and along != 0.0:
        for i in range(n):
            if g[i] != 0.0:
                x = along * g[i]
                for j in range(i + 1):
                    A[i, j] += x * g[j]


@inner
def add_tension(table, lines, k, activation, points):
    """Forces of fibre k at rest on its points, after `measure_segments`."""
    way, point, total = points.way, table.point, 0.0
    first, last = table.start[k], table.start[k + 1] - 1
    for i in range(first, last):
        total += way[i, 3]
    _, F, _ = tension(lines, k, total, activation, 1.0)
    for i in range(first, last):
        a, b, e = point[i], point[i + 1], vector(way, i)
        if table.first[a] != table.first[b]:
            add(points.force, a, 0, e, F)
            add(points.force, b, 0, e, -F)


@inner
def add_morsels(morsel, plane, first, whole, points, by_damping, by_stiffness, A):
    """Forces of whole morsels on their points, and their share of A, as `sim.terms.crushable`."""
    for k in range(len(morsel)):
        p = morsel[k]
        normal = vector(plane[k : k + 1, 3:6], 0)
        left = plane[k, 6] - morsel_gap(plane, k, vector(points.q, p))
        if not whole[k] or left <= 0.0:
            continue
        stiffness = plane[k, 7] / plane[k, 6]
        add(points.force, p, 0, normal, stiffness * left)
        s = vector(points.arm, p)
        if first[p] >= 0:
            c = np.uint64(first[p])
            along = by_stiffness * stiffness + by_damping * plane[k, 8]
            _add_block(A, c, c, s, s, normal, 0.0, along)


@inner
def morsel_gap(plane, k, x):
    """Distance of a point x from the plane of morsel k."""
    return inner_product(minus(x, vector(plane, k)), vector(plane[k : k + 1, 3:6], 0))


@inner
def add_points(first, points, by_stiffness, A, r):
    """Forces and moments of the loads of all points, and the rotation of their arms."""
    for p in range(len(first)):
        if first[p] < 0:
            continue
        s, f = vector(points.arm, p), vector(points.force, p)
        sf = inner_product(s, f)
        add_wrench(r, first[p], s, f, 1.0)
        # trace(s f') 1 less the symmetric part of s f'
        k, half = first[p] + 3, 0.5 * by_stiffness
        A[k, k] += by_stiffness * (sf - s[0] * f[0])
        A[k + 1, k + 1] += by_stiffness * (sf - s[1] * f[1])
        A[k + 2, k + 2] += by_stiffness * (sf - s[2] * f[2])
        A[k + 1, k] -= half * (s[1] * f[0] + s[0] * f[1])
        A[k + 2, k] -= half * (s[2] * f[0] + s[0] * f[2])
        A[k + 2, k + 1] -= half * (s[2] * f[1] + s[1] * f[2])
