"""Faces near points: lists that remain complete for small motions, and the closest faces of a list."""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import numpy as np

from sim._kernels.element import Indices, Reals
from sim._kernels.grid import Grid, apart, boxes_near
from sim._kernels.options import inner, kernel
from sim._kernels.triangles import point_triangle


@inner
def has_node(triangle, node):
    return triangle[0] == node or triangle[1] == node or triangle[2] == node


@inner
def around(p, r, low, high):
    """Box of all points within r of p."""
    for j in range(3):
        low[j], high[j] = p[j] - r, p[j] + r


@inner
def opposed(a, b, c, away):
    """Test if the normal of triangle abc is opposite to a direction."""
    n0 = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
    n1 = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2])
    n2 = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return n0 * away[0] + n1 * away[1] + n2 * away[2] < 0.0


@kernel
def listed(
    p: Reals,
    radius: Reals,
    moves: Reals,
    node: Indices,
    x: Reals,
    triangles: Indices,
    grid: Grid,
    every: bool,
    reach: Reals,
    start: Indices,
) -> Indices:
    """Faces (k,) of every point that may be its closest one within a radius after motions.

    Parameters
    ----------
    p, radius, moves : points, their radii and the sum of the distances by which point and face may move.
    node : vertex of each point, -1 for none; faces that have it are omitted.
    every : True if farther faces are also listed, because closer ones may be omitted in a search.
    reach : set to the distance up to which faces are listed, infinite if up to the closest one and twice
        the motion, which suffices for every radius.
    start : (n + 1,) set to the places of the first faces.
    """
    w, low, high = np.empty(3), np.empty(3), np.empty(3)
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    near = np.empty(len(triangles), np.int64)
    face = np.empty(4 * len(p) + 16, np.int64)
    n = 0
    for i in range(len(p)):
        start[i], reach[i] = n, radius[i] + moves[i]
        most = reach[i]
        if not every:
            closest = most * most
            around(p[i], most, low, high)
            for k in range(boxes_near(grid, low, high, first, last, near)):
                t = triangles[near[k]]
                if has_node(t, node[i]) or apart(low, high, grid.low[near[k]], grid.high[near[k]]):
                    continue
                d2, _ = point_triangle(p[i], x[t[0]], x[t[1]], x[t[2]], w)
                if d2 < closest:
                    closest = d2
                    around(p[i], np.sqrt(d2), low, high)
            nearby = np.sqrt(closest) + 2.0 * moves[i]
            if nearby < most:
                most, reach[i] = nearby, np.inf
        around(p[i], most, low, high)
        for k in range(boxes_near(grid, low, high, first, last, near)):
            t = triangles[near[k]]
            if has_node(t, node[i]):
                continue
            d2, _ = point_triangle(p[i], x[t[0]], x[t[1]], x[t[2]], w)
            if d2 <= most * most:
                if n == len(face):
                    longer = np.empty(2 * n, np.int64)
                    longer[:n] = face
                    face = longer
                # in the order of the faces
                m = n
                while m > start[i] and face[m - 1] > near[k]:
                    face[m] = face[m - 1]
                    m -= 1
                face[m] = near[k]
                n += 1
    start[len(p)] = n
    return face[:n].copy()


@kernel
def complete(
    p0: Reals,
    p1: Reals,
    x0: Reals,
    x1: Reals,
    used: Indices,
    radius: Reals,
    p: Reals,
    x: Reals,
    moves: Reals,
    reach: Reals,
) -> bool:
    """Test if lists made at points p and vertices x are complete for a motion from p0, x0 to p1, x1."""
    farthest = 0.0
    for a in used:
        one = two = 0.0
        for j in range(3):
            one += (x0[a, j] - x[a, j]) ** 2
            two += (x1[a, j] - x[a, j]) ** 2
        farthest = max(farthest, max(one, two))
    farthest = np.sqrt(farthest)
    for i in range(len(p)):
        one = two = 0.0
        for j in range(3):
            one += (p0[i, j] - p[i, j]) ** 2
            two += (p1[i, j] - p[i, j]) ** 2
        moved = np.sqrt(max(one, two)) + farthest
        bounded = reach[i] < np.inf
        if not (radius[i] + moved <= reach[i] if bounded else moved <= moves[i]):
            return False
    return True


@inner
def near_listed(p, radius, x, triangles, first, size, listed, away, i, squared, what, w):
    """Squared distances, features and weights of listed faces; place of the closest one, or -1."""
    least, best = radius * radius, -1
    for k in range(size):
        t = triangles[listed[first + k]]
        a, b, c = x[t[0]], x[t[1]], x[t[2]]
        squared[k] = np.inf
        if len(away) and not opposed(a, b, c, away[i]):
            continue
        squared[k], what[k] = point_triangle(p, a, b, c, w[k])
        if squared[k] < least or (squared[k] == least and best < 0):
            least, best = squared[k], k
    return best


@kernel
def closest(
    p: Reals,
    radius: Reals,
    x: Reals,
    triangles: Indices,
    start: Indices,
    listed: Indices,
    away: Reals,
    slack: float,
    point: Indices,
    face: Indices,
    weight: Reals,
    distance: Reals,
    feature: Indices,
) -> int:
    """Closest face of every point within its radius, followed by those as close within a tolerance.

    Of faces at equal distance the one with the lowest index is the first. If `away` has rows, faces
    whose normals are not opposite to those are omitted. Returns the number of results, which are at most
    as many as the listed faces.
    """
    n, longest = 0, 0
    for i in range(len(p)):
        longest = max(longest, start[i + 1] - start[i])
    squared, what, w = np.empty(longest), np.empty(longest, np.int64), np.empty((longest, 3))
    for i in range(len(p)):
        first, size = start[i], start[i + 1] - start[i]
        best = near_listed(
            p[i], radius[i], x, triangles, first, size, listed, away, i, squared, what, w
        )
        if best < 0:
            continue
        most = np.sqrt(squared[best]) + slack
        for turn in range(-1, size):
            k = best if turn < 0 else turn
            if turn == best or not (turn < 0 or squared[k] <= most * most):
                continue
            point[n], face[n], feature[n] = i, listed[first + k], what[k]
            distance[n] = np.sqrt(squared[k])
            weight[n, 0], weight[n, 1], weight[n, 2] = w[k, 0], w[k, 1], w[k, 2]
            n += 1
    return n
