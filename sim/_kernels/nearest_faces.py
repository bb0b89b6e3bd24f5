"""Closest faces of points, among those with boxes within reach."""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import numpy as np
from numpy.typing import NDArray

from sim._kernels.grid import Grid, apart, boxes_near
from sim._kernels.options import inner, kernel
from sim._kernels.triangles import point_triangle

Reals = NDArray[np.float64]
Indices = NDArray[np.int64]


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
def nearest(
    p: Reals,
    radius: Reals,
    node: Indices,
    x: Reals,
    triangles: Indices,
    grid: Grid,
    away: Reals,
    face: Indices,
    weight: Reals,
    squared: Reals,
    feature: Indices,
) -> int:
    """Nearest face of every point within its radius; -1 if there is none.

    A face that has the point's own node (`node`, -1 for none) is omitted and, if `away` has rows,
    one whose normal is not opposite to that row. Returns the number of pairs whose distance was
    computed.
    """
    looked = 0
    w, low, high = np.empty(3), np.empty(3), np.empty(3)
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    near = np.empty(len(triangles), np.int64)
    for i in range(len(p)):
        face[i], squared[i] = -1, radius[i] * radius[i]
        around(p[i], radius[i], low, high)
        for k in range(boxes_near(grid, low, high, first, last, near)):
            f = near[k]
            triangle = triangles[f]
            if has_node(triangle, node[i]) or apart(low, high, grid.low[f], grid.high[f]):
                continue
            a, b, c = x[triangle[0]], x[triangle[1]], x[triangle[2]]
            if len(away) and not opposed(a, b, c, away[i]):
                continue
            looked += 1
            d2, what = point_triangle(p[i], a, b, c, w)
            # Of faces at equal distance the first, independent of the order of the search.
            if d2 < squared[i] or (d2 == squared[i] and (face[i] < 0 or f < face[i])):
                squared[i], face[i], feature[i] = d2, f, what
                weight[i, 0], weight[i, 1], weight[i, 2] = w[0], w[1], w[2]
                around(p[i], np.sqrt(d2), low, high)
    return looked


@kernel
def as_near(
    p: Reals,
    node: Indices,
    x: Reals,
    triangles: Indices,
    grid: Grid,
    away: Reals,
    slack: float,
    at: Indices,
    face: Indices,
    distance: Reals,
    which: Indices,
    other: Indices,
    weight: Reals,
    value: Reals,
    feature: Indices,
) -> int:
    """Number of further faces as close as the closest ones, within a tolerance [m].

    at, face, distance: points that have a nearest face, this face and its distance. The other
    arrays are filled up to their length: index of the row, the further face, its weights, distance
    and feature.
    """
    n = 0
    w, low, high = np.empty(3), np.empty(3), np.empty(3)
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    near = np.empty(len(triangles), np.int64)
    for i in range(len(at)):
        point, most = p[at[i]], distance[i] + slack
        around(point, most, low, high)
        for k in range(boxes_near(grid, low, high, first, last, near)):
            f = near[k]
            triangle = triangles[f]
            if f == face[i] or has_node(triangle, node[at[i]]):
                continue
            a, b, c = x[triangle[0]], x[triangle[1]], x[triangle[2]]
            if len(away) and not opposed(a, b, c, away[at[i]]):
                continue
            d2, what = point_triangle(point, a, b, c, w)
            if d2 <= most * most and n < len(which):
                which[n], other[n], value[n], feature[n] = i, f, np.sqrt(d2), what
                weight[n, 0], weight[n, 1], weight[n, 2] = w[0], w[1], w[2]
                n += 1
    return n
