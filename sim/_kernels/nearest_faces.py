"""Nearest faces, by a sweep along one axis.

Faces are sorted by the low end of their boxes, and a point looks only at those whose boxes can reach
it.
"""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import numba as nb
import numpy as np
from numpy.typing import NDArray

from sim._kernels.laws import FLAGS
from sim._kernels.triangles import point_triangle

Reals = NDArray[np.float64]
Indices = NDArray[np.int64]


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def first_reached(low, value):
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
def has_node(triangle, node):
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
        for k in range(first_reached(low[:, axis], p[i, axis] - r - widest), len(order)):
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
            if has_node(triangle, node[i]):
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
