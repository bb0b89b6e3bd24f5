"""Entry of points into faces on straight paths within a step.

The broad phase is the grid of `nearest_faces`, over the boxes of the paths.
"""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import numpy as np
from numpy.typing import NDArray

from sim._kernels.grid import Grid, boxes_near
from sim._kernels.nearest_faces import has_node
from sim._kernels.options import inner, kernel
from sim._kernels.triangles import dot, point_triangle

Reals = NDArray[np.float64]
Indices = NDArray[np.int64]

SHARP = 1e-9  # Barycentric tolerance, so that no point passes between two faces.


@inner
def _cubic(c0, c1, c2, c3, t):
    return c0 + t * (c1 + t * (c2 + t * c3))


@inner
def _roots(c0, c1, c2, c3, out):
    """Roots within 0-1 of a cubic, ascending, by bisection between its extrema."""
    cut = np.empty(4)
    n = 1
    cut[0] = 0.0
    a, b, c = 3.0 * c3, 2.0 * c2, c1
    root = b * b - 4.0 * a * c
    if root >= 0.0:
        q = -0.5 * (b + np.copysign(np.sqrt(root), b))
        e0 = q / a if a != 0.0 else -1.0
        e1 = c / q if q != 0.0 else -1.0
        if e0 > e1:
            e0, e1 = e1, e0
        if 0.0 < e0 < 1.0:
            cut[n] = e0
            n += 1
        if 0.0 < e1 < 1.0 and e1 > e0:
            cut[n] = e1
            n += 1
    cut[n] = 1.0
    found = 0
    for k in range(n):
        t0, t1 = cut[k], cut[k + 1]
        f0, f1 = _cubic(c0, c1, c2, c3, t0), _cubic(c0, c1, c2, c3, t1)
        if f0 == 0.0:
            out[found] = t0
            found += 1
            continue
        if f1 == 0.0 and k == n - 1:
            out[found] = t1
            found += 1
            continue
        if f0 * f1 >= 0.0:
            continue
        for _ in range(60):
            t = 0.5 * (t0 + t1)
            f = _cubic(c0, c1, c2, c3, t)
            if f * f0 > 0.0:
                t0 = t
            else:
                t1 = t
        out[found] = t1
        found += 1
    return found


@inner
def _entry(p0, p1, a0, a1, b0, b1, c0, c1, weight):
    """Earliest time 0-1 at which a moving point enters a moving triangle through its front, or 2."""
    # (p - a) . (b - a) x (c - a), each difference linear in time
    r, dr = p0 - a0, (p1 - a1) - (p0 - a0)
    u, du = b0 - a0, (b1 - a1) - (b0 - a0)
    v, dv = c0 - a0, (c1 - a1) - (c0 - a0)
    k0 = np.cross(u, v)
    k1 = np.cross(u, dv) + np.cross(du, v)
    k2 = np.cross(du, dv)
    e0, e1 = dot(r, k0), dot(r, k1) + dot(dr, k0)
    e2, e3 = dot(r, k2) + dot(dr, k1), dot(dr, k2)
    roots = np.empty(4)
    x, a, b, c = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(_roots(e0, e1, e2, e3, roots)):
        t = roots[k]
        if e1 + t * (2.0 * e2 + t * 3.0 * e3) >= 0.0:
            continue  # from behind, or parallel to the face
        for i in range(3):
            x[i] = p0[i] + t * (p1[i] - p0[i])
            a[i] = a0[i] + t * (a1[i] - a0[i])
            b[i] = b0[i] + t * (b1[i] - b0[i])
            c[i] = c0[i] + t * (c1[i] - c0[i])
        d2, what = point_triangle(x, a, b, c, weight)
        size = 0.0
        for i in range(3):
            size += (b[i] - a[i]) ** 2 + (c[i] - a[i]) ** 2
        if d2 <= SHARP * SHARP * size:
            return t
    return 2.0


@kernel
def entries(
    p0: Reals,
    p1: Reals,
    node: Indices,
    x0: Reals,
    x1: Reals,
    triangles: Indices,
    grid: Grid,
    face: Indices,
    when: Reals,
    weight: Reals,
) -> int:
    """First face that every point enters through its front on a straight path; -1 if none.

    grid: of the boxes of the paths of the faces. Returns the number of pairs examined.
    """
    looked = 0
    w, low, high = np.empty(3), np.empty(3), np.empty(3)
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    near = np.empty(len(triangles), np.int64)
    for i in range(len(p0)):
        face[i], when[i] = -1, 2.0
        for j in range(3):
            low[j], high[j] = min(p0[i, j], p1[i, j]), max(p0[i, j], p1[i, j])
        for k in range(boxes_near(grid, low, high, first, last, near)):
            f = near[k]
            t = triangles[f]
            if has_node(t, node[i]):
                continue
            looked += 1
            a, b, c = t[0], t[1], t[2]
            s = _entry(p0[i], p1[i], x0[a], x1[a], x0[b], x1[b], x0[c], x1[c], w)
            if s < when[i] or (s == when[i] and s < 2.0 and f < face[i]):
                when[i], face[i] = s, f
                weight[i, 0], weight[i, 1], weight[i, 2] = w[0], w[1], w[2]
    return looked


@kernel
def as_early(
    p0: Reals,
    p1: Reals,
    node: Indices,
    x0: Reals,
    x1: Reals,
    triangles: Indices,
    grid: Grid,
    slack: float,
    at: Indices,
    face: Indices,
    when: Reals,
    which: Indices,
    other: Indices,
    weight: Reals,
    value: Reals,
) -> int:
    """Number of further faces that points enter together with the first ones, within a tolerance.

    Arguments as of `sim._kernels.nearest_faces.as_near`, with fractions of the path instead of
    distances.
    """
    n = 0
    w, low, high = np.empty(3), np.empty(3), np.empty(3)
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    near = np.empty(len(triangles), np.int64)
    for i in range(len(at)):
        one, end = p0[at[i]], p1[at[i]]
        for j in range(3):
            low[j], high[j] = min(one[j], end[j]), max(one[j], end[j])
        for k in range(boxes_near(grid, low, high, first, last, near)):
            f = near[k]
            t = triangles[f]
            if f == face[i] or has_node(t, node[at[i]]):
                continue
            a, b, c = t[0], t[1], t[2]
            s = _entry(one, end, x0[a], x1[a], x0[b], x1[b], x0[c], x1[c], w)
            if s <= when[i] + slack and n < len(which):
                which[n], other[n], value[n] = i, f, s
                weight[n, 0], weight[n, 1], weight[n, 2] = w[0], w[1], w[2]
                n += 1
    return n
