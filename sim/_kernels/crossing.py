"""Entry of points into faces on straight paths within a step.

The broad phase are lists of faces near the points (`sim._kernels.nearest_faces`).
"""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import numpy as np

from sim._kernels.element import Indices, Reals
from sim._kernels.grid import BOX_ROUNDING
from sim._kernels.options import allocating, inner, kernel
from sim._kernels.triangles import dot, point_triangle

BARYCENTRIC_TOLERANCE = 1e-9  # Barycentric tolerance, so that no point passes between two faces.


@inner
def _cubic(c0, c1, c2, c3, t):
    return c0 + t * (c1 + t * (c2 + t * c3))


@allocating
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
    count = 0
    for k in range(n):
        t0, t1 = cut[k], cut[k + 1]
        f0, f1 = _cubic(c0, c1, c2, c3, t0), _cubic(c0, c1, c2, c3, t1)
        if f0 == 0.0:
            out[count] = t0
            count += 1
            continue
        if f1 == 0.0 and k == n - 1:
            out[count] = t1
            count += 1
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
        out[count] = t1
        count += 1
    return count


@allocating
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
        if d2 <= BARYCENTRIC_TOLERANCE * BARYCENTRIC_TOLERANCE * size:
            return t
    return 2.0


@inner
def _pass_by(p0, p1, a0, a1, b0, b1, c0, c1):
    """Test if the boxes of the paths of a point and of a triangle are disjoint."""
    for j in range(3):
        low = min(min(min(a0[j], a1[j]), min(b0[j], b1[j])), min(c0[j], c1[j]))
        high = max(max(max(a0[j], a1[j]), max(b0[j], b1[j])), max(c0[j], c1[j]))
        rounding = BOX_ROUNDING * max(abs(low), abs(high))
        if max(p0[j], p1[j]) < low - rounding or min(p0[j], p1[j]) > high + rounding:
            return True
    return False


@kernel
def entries(
    p0: Reals,
    p1: Reals,
    x0: Reals,
    x1: Reals,
    triangles: Indices,
    start: Indices,
    listed: Indices,
    slack: float,
    point: Indices,
    face: Indices,
    when: Reals,
    weight: Reals,
) -> int:
    """Faces that points enter first through their fronts on straight paths.

    Each is followed by those that are entered at the same time within a tolerance. Arguments as of
    `sim._kernels.nearest_faces.closest`, with fractions of the path instead of distances.
    """
    n, longest = 0, 0
    for i in range(len(p0)):
        longest = max(longest, start[i + 1] - start[i])
    time, w = np.empty(longest), np.empty((longest, 3))
    for i in range(len(p0)):
        first, size = start[i], start[i + 1] - start[i]
        earliest, best = 2.0, -1
        for k in range(size):
            t = triangles[listed[first + k]]
            a, b, c = t[0], t[1], t[2]
            time[k] = 2.0
            if _pass_by(p0[i], p1[i], x0[a], x1[a], x0[b], x1[b], x0[c], x1[c]):
                continue
            time[k] = _entry(p0[i], p1[i], x0[a], x1[a], x0[b], x1[b], x0[c], x1[c], w[k])
            if time[k] < earliest:
                earliest, best = time[k], k
        if best < 0:
            continue
        for turn in range(-1, size):
            k = best if turn < 0 else turn
            if turn == best or not (turn < 0 or time[k] <= min(earliest + slack, 1.0)):
                continue
            point[n], face[n], when[n] = i, listed[first + k], time[k]
            weight[n, 0], weight[n, 1], weight[n, 2] = w[k, 0], w[k, 1], w[k, 2]
            n += 1
    return n
