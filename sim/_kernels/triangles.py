"""Triangles and segments: closest points, distances, normals."""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import numpy as np
from numpy.typing import NDArray

from sim._kernels.element import Indices, Reals
from sim._kernels.options import inner, kernel, kernel_and_inner

INSIDE_FACE, EDGE_0, EDGE_1, EDGE_2, CORNER_0, CORNER_1, CORNER_2 = 0, 1, 2, 3, 4, 5, 6
"""Feature of a triangle on which its closest point lies."""


@inner
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def between(p, a, b):
    """Fraction 0-1 of the segment from a to b at its point closest to p."""
    along = length = 0.0
    for i in range(3):
        along += (p[i] - a[i]) * (b[i] - a[i])
        length += (b[i] - a[i]) ** 2
    if not length > 0.0:
        return 0.0
    return min(max(along / length, 0.0), 1.0)


@kernel_and_inner
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
        # areas of the triangles formed by the projection of p and the sides
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
        s = between(p, start, end)
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


@kernel
def within(p: Reals, x: Reals, triangles: Indices, distance: float, out: NDArray[np.bool_]) -> None:
    """Mask of the points (rows of out) within a distance of each face (column)."""
    w = np.empty(3)
    for i in range(len(p)):
        for f in range(len(triangles)):
            t = triangles[f]
            d2, _ = point_triangle(p[i], x[t[0]], x[t[1]], x[t[2]], w)
            out[i, f] = d2 <= distance * distance


@kernel
def normals(x: Reals, triangles: Indices, face: Reals, corner: Reals, flat: Reals) -> None:
    """Unit normals of faces, and of vertices by the angles of their faces (corner is per vertex).

    flat: per vertex, mean cosine of the angles between its normal and those of its faces.

    The sign of a distance to the nearest edge or vertex follows from the mean normal of its faces,
    weighted by their angles (Baerentzen and Aanaes 2005).
    """
    corner[:], flat[:] = 0.0, 0.0
    u, v, n = np.empty(3), np.empty(3), np.empty(3)
    for f in range(len(triangles)):
        for k in range(3):
            a, b, c = triangles[f, k], triangles[f, (k + 1) % 3], triangles[f, (k + 2) % 3]
            for i in range(3):
                u[i], v[i] = x[b, i] - x[a, i], x[c, i] - x[a, i]
            if k == 0:
                n[0] = u[1] * v[2] - u[2] * v[1]
                n[1] = u[2] * v[0] - u[0] * v[2]
                n[2] = u[0] * v[1] - u[1] * v[0]
                size = np.sqrt(dot(n, n))
                for i in range(3):
                    n[i] /= size
                    face[f, i] = n[i]
            angle = np.arccos(min(max(dot(u, v) / np.sqrt(dot(u, u) * dot(v, v)), -1.0), 1.0))
            flat[a] += angle
            for i in range(3):
                corner[a, i] += angle * n[i]
    for a in range(len(corner)):
        size = np.sqrt(corner[a, 0] ** 2 + corner[a, 1] ** 2 + corner[a, 2] ** 2)
        if size > 0.0:
            flat[a] = size / flat[a]
            for i in range(3):
                corner[a, i] /= size
