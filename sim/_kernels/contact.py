"""Search of contact: nearest faces, crossings of vertices and faces within a step, inside or outside.

Broad phase of both searches is a sweep along one axis: faces are sorted by the low end of their boxes,
and a vertex looks only at those whose boxes can reach its own.
"""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import numba as nb
import numpy as np
from numpy.typing import NDArray

from sim._kernels.laws import FLAGS

Reals = NDArray[np.float64]
Indices = NDArray[np.int64]

INSIDE_FACE, EDGE_0, EDGE_1, EDGE_2, CORNER_0, CORNER_1, CORNER_2 = 0, 1, 2, 3, 4, 5, 6
SHARP = 1e-9  # barycentric slack, so that nothing slips through between two faces


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def _between(p, a, b):
    """Share of the way from a to b at which the line is nearest to p, within 0-1."""
    along = length = 0.0
    for i in range(3):
        along += (p[i] - a[i]) * (b[i] - a[i])
        length += (b[i] - a[i]) ** 2
    if not length > 0.0:
        return 0.0
    return min(max(along / length, 0.0), 1.0)


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def point_triangle(p: Reals, a: Reals, b: Reals, c: Reals, weight: Reals) -> tuple[float, int]:
    """Squared distance and feature of the point of a triangle nearest to p; its barycentric weights.

    Feature 0: within the face; 1, 2, 3: on edge ab, bc, ca; 4, 5, 6: at corner a, b, c.
    """
    ab0, ab1, ab2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    ac0, ac1, ac2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    n0, n1, n2 = ab1 * ac2 - ab2 * ac1, ab2 * ac0 - ab0 * ac2, ab0 * ac1 - ab1 * ac0
    nn = n0 * n0 + n1 * n1 + n2 * n2
    if nn > 0.0:
        r0, r1, r2 = p[0] - a[0], p[1] - a[1], p[2] - a[2]
        # areas of the triangles that the projection of p makes with the sides
        wc = (
            (ab1 * r2 - ab2 * r1) * n0 + (ab2 * r0 - ab0 * r2) * n1 + (ab0 * r1 - ab1 * r0) * n2
        ) / nn
        wb = (
            (r1 * ac2 - r2 * ac1) * n0 + (r2 * ac0 - r0 * ac2) * n1 + (r0 * ac1 - r1 * ac0) * n2
        ) / nn
        wa = 1.0 - wb - wc
        if wa > 0.0 and wb > 0.0 and wc > 0.0:
            weight[0], weight[1], weight[2] = wa, wb, wc
            away = r0 * n0 + r1 * n1 + r2 * n2
            return away * away / nn, INSIDE_FACE
    best, feature = np.inf, EDGE_0
    for k in range(3):
        if k == 0:
            start, end = a, b
        elif k == 1:
            start, end = b, c
        else:
            start, end = c, a
        s = _between(p, start, end)
        d2 = 0.0
        for i in range(3):
            d2 += (p[i] - start[i] - s * (end[i] - start[i])) ** 2
        if d2 < best:
            best = d2
            weight[0] = weight[1] = weight[2] = 0.0
            weight[k] = 1.0 - s
            weight[(k + 1) % 3] += s
            if s <= 0.0:
                feature = CORNER_0 + k
            elif s >= 1.0:
                feature = CORNER_0 + (k + 1) % 3
            else:
                feature = EDGE_0 + k
    return best, feature


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def edge_edge(a: Reals, b: Reals, c: Reals, d: Reals, share: Reals) -> float:
    """Squared distance of the segments ab and cd; the shares of the way along each where it is."""
    # the least of the crossing of the two lines, if within both, and of each end to the other segment
    best = np.inf
    uu = vv = uv = uw = vw = 0.0
    for i in range(3):
        u, v, w = b[i] - a[i], d[i] - c[i], c[i] - a[i]
        uu, vv, uv, uw, vw = uu + u * u, vv + v * v, uv + u * v, uw + u * w, vw + v * w
    det = uu * vv - uv * uv
    if det > 1e-14 * uu * vv:
        s, t = (uw * vv - uv * vw) / det, (uv * uw - uu * vw) / det
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            d2 = 0.0
            for i in range(3):
                d2 += (a[i] + s * (b[i] - a[i]) - c[i] - t * (d[i] - c[i])) ** 2
            share[0], share[1] = s, t
            return d2
    for k in range(4):
        if k == 0:
            s, t = 0.0, _between(a, c, d)
        elif k == 1:
            s, t = 1.0, _between(b, c, d)
        elif k == 2:
            s, t = _between(c, a, b), 0.0
        else:
            s, t = _between(d, a, b), 1.0
        d2 = 0.0
        for i in range(3):
            d2 += (a[i] + s * (b[i] - a[i]) - c[i] - t * (d[i] - c[i])) ** 2
        if d2 < best:
            best = d2
            share[0], share[1] = s, t
    return best


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def _first(low, value):
    """Index of the first entry of an ascending array that is not below a value."""
    i, j = 0, low.size
    while i < j:
        m = (i + j) // 2
        if low[m] < value:
            i = m + 1
        else:
            j = m
    return i


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def _shares(triangle, node):
    return triangle[0] == node or triangle[1] == node or triangle[2] == node


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def nearest(
    p: Reals,
    radius: Reals,
    node: Indices,
    x: Reals,
    triangles: Indices,
    order: Indices,
    low: Reals,
    high: Reals,
    widest: float,
    axis: int,
    away: Reals,
    face: Indices,
    weight: Reals,
    squared: Reals,
    feature: Indices,
) -> int:
    """Nearest face of every point within its radius; -1 where there is none.

    A face that has the point's own node (`node`, -1 for none) is left out, and, where `away` has rows,
    one whose normal does not oppose that row. Returns the number of pairs looked at closely.
    """
    looked = 0
    w = np.empty(3)
    for i in range(len(p)):
        face[i], squared[i] = -1, radius[i] * radius[i]
        r = radius[i]
        for k in range(_first(low[:, axis], p[i, axis] - r - widest), len(order)):
            if low[k, axis] > p[i, axis] + r:
                break
            apart = False
            for j in range(3):
                if p[i, j] < low[k, j] - r or p[i, j] > high[k, j] + r:
                    apart = True
            if apart:
                continue
            f = order[k]
            triangle = triangles[f]
            if _shares(triangle, node[i]):
                continue
            a, b, c = x[triangle[0]], x[triangle[1]], x[triangle[2]]
            if len(away):
                n0 = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
                n1 = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2])
                n2 = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
                if n0 * away[i, 0] + n1 * away[i, 1] + n2 * away[i, 2] >= 0.0:
                    continue
            looked += 1
            d2, what = point_triangle(p[i], a, b, c, w)
            # of faces at one distance the first, whatever the order of the sweep
            if d2 < squared[i] or (d2 == squared[i] and (face[i] < 0 or f < face[i])):
                squared[i], face[i], feature[i] = d2, f, what
                weight[i, 0], weight[i, 1], weight[i, 2] = w[0], w[1], w[2]
                r = np.sqrt(d2)
    return looked


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def closest(
    p: Reals, x: Reals, corners: Indices, weight: Reals, squared: Reals, feature: Indices
) -> None:
    """Nearest point of one triangle (row of corners) to each point."""
    for i in range(len(p)):
        t = corners[i]
        squared[i], feature[i] = point_triangle(p[i], x[t[0]], x[t[1]], x[t[2]], weight[i])


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def within(p: Reals, x: Reals, triangles: Indices, distance: float, out: NDArray[np.bool_]) -> None:
    """Whether each point (row of out) is within a distance of each face (column)."""
    w = np.empty(3)
    for i in range(len(p)):
        for f in range(len(triangles)):
            t = triangles[f]
            d2, _ = point_triangle(p[i], x[t[0]], x[t[1]], x[t[2]], w)
            out[i, f] = d2 <= distance * distance


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def _cubic(c0, c1, c2, c3, t):
    return c0 + t * (c1 + t * (c2 + t * c3))


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
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


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def _entry(p0, p1, a0, a1, b0, b1, c0, c1, weight):
    """Earliest time 0-1 at which a moving point enters a moving triangle through its front, or 2."""
    # (p - a) . (b - a) x (c - a), each difference linear in time
    r, dr = p0 - a0, (p1 - a1) - (p0 - a0)
    u, du = b0 - a0, (b1 - a1) - (b0 - a0)
    v, dv = c0 - a0, (c1 - a1) - (c0 - a0)
    k0 = np.cross(u, v)
    k1 = np.cross(u, dv) + np.cross(du, v)
    k2 = np.cross(du, dv)
    e0, e1 = _dot(r, k0), _dot(r, k1) + _dot(dr, k0)
    e2, e3 = _dot(r, k2) + _dot(dr, k1), _dot(dr, k2)
    roots = np.empty(4)
    x, a, b, c = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(_roots(e0, e1, e2, e3, roots)):
        t = roots[k]
        if e1 + t * (2.0 * e2 + t * 3.0 * e3) >= 0.0:
            continue  # from behind, or along
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


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def entries(
    p0: Reals,
    p1: Reals,
    node: Indices,
    x0: Reals,
    x1: Reals,
    triangles: Indices,
    order: Indices,
    low: Reals,
    high: Reals,
    widest: float,
    axis: int,
    face: Indices,
    when: Reals,
    weight: Reals,
) -> int:
    """First face that every point enters through its front on straight ways; -1 where there is none.

    low, high: boxes of the ways of the faces in sweep order. Returns the number of pairs looked at.
    """
    looked = 0
    w = np.empty(3)
    for i in range(len(p0)):
        face[i], when[i] = -1, 2.0
        first, last = min(p0[i, axis], p1[i, axis]), max(p0[i, axis], p1[i, axis])
        for k in range(_first(low[:, axis], first - widest), len(order)):
            if low[k, axis] > last:
                break
            apart = False
            for j in range(3):
                if max(p0[i, j], p1[i, j]) < low[k, j] or min(p0[i, j], p1[i, j]) > high[k, j]:
                    apart = True
            if apart:
                continue
            f = order[k]
            t = triangles[f]
            if _shares(t, node[i]):
                continue
            looked += 1
            s = _entry(p0[i], p1[i], x0[t[0]], x1[t[0]], x0[t[1]], x1[t[1]], x0[t[2]], x1[t[2]], w)
            if s < when[i] or (s == when[i] and s < 2.0 and f < face[i]):
                when[i], face[i] = s, f
                weight[i, 0], weight[i, 1], weight[i, 2] = w[0], w[1], w[2]
    return looked


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def winding(p: Reals, x: Reals, triangles: Indices, out: Reals) -> None:
    """How often a closed surface winds around every point: 1 inside, 0 outside."""
    for i in range(len(p)):
        total = 0.0
        for t in triangles:
            a, b, c = x[t[0]] - p[i], x[t[1]] - p[i], x[t[2]] - p[i]
            la, lb, lc = np.sqrt(_dot(a, a)), np.sqrt(_dot(b, b)), np.sqrt(_dot(c, c))
            # solid angle of a triangle (van Oosterom and Strackee 1983)
            total += np.arctan2(
                _dot(a, np.cross(b, c)),
                la * lb * lc + _dot(a, b) * lc + _dot(b, c) * la + _dot(c, a) * lb,
            )
        out[i] = total / (2.0 * np.pi)


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def normals(x: Reals, triangles: Indices, face: Reals, corner: Reals) -> None:
    """Unit normals of faces, and of vertices by the angles of their faces (corner is per vertex).

    The sign of a distance to the nearest edge or vertex follows from the mean normal of its faces,
    weighted by their angles (Baerentzen and Aanaes 2005).
    """
    corner[:] = 0.0
    for f in range(len(triangles)):
        t = triangles[f]
        n = np.cross(x[t[1]] - x[t[0]], x[t[2]] - x[t[0]])
        n /= np.sqrt(_dot(n, n))
        face[f] = n
        for k in range(3):
            u, v = x[t[(k + 1) % 3]] - x[t[k]], x[t[(k + 2) % 3]] - x[t[k]]
            angle = np.arccos(min(max(_dot(u, v) / np.sqrt(_dot(u, u) * _dot(v, v)), -1.0), 1.0))
            corner[t[k]] += angle * n
    for i in range(len(corner)):
        size = np.sqrt(_dot(corner[i], corner[i]))
        if size > 0.0:
            corner[i] /= size
