"""Signed distances to the closest faces, their directions, and adjacent walls of grooves."""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import numpy as np
from numpy.typing import NDArray

from sim._kernels.options import inner, kernel
from sim._kernels.triangles import CORNER_0, EDGE_0, INSIDE_FACE, dot, point_triangle

Reals = NDArray[np.float64]
Indices = NDArray[np.int64]

OPPOSED = 0.5
"""Length of the difference of two normals above which they are opposite."""

FLAT = 0.95
"""Mean cosine of the angles between faces and their mean normal, below which an edge is sharp."""

CONCAVE = 0.1
"""Height of a face above its neighbour, of its longest side, from which the two make a groove."""

ON_EDGE = 1e-6
"""Distance within a face below which a point is regarded as on its edge [m]."""

NO_LENGTH = 1e-6
"""Relative distance below which the direction of a distance is undefined."""


@inner
def _length(v):
    return np.sqrt(dot(v, v))


@inner
def _size(x, triangle):
    """Longest side of a triangle."""
    a, b, c = x[triangle[0]], x[triangle[1]], x[triangle[2]]
    return max(_length(b - a), _length(c - b), _length(a - c))


@inner
def _on_edge(what, weight, x, triangle, across, free):
    """Feature of the closest point, with points close to an edge assigned to the edge.

    Bodies with coplanar sides are in contact at their edges, and rounding must not assign the
    contact to their sides. A free edge has no sign and is not assigned.
    """
    if what >= CORNER_0:
        return what
    double = _length(
        np.cross(x[triangle[1]] - x[triangle[0]], x[triangle[2]] - x[triangle[0]]),
    )
    count = near = away = 0
    for k in range(3):
        side = _length(x[triangle[(k + 2) % 3]] - x[triangle[(k + 1) % 3]])
        # distance of the nearest point from the side opposite to the corner
        if weight[k] * double < ON_EDGE * side:
            count, near = count + 1, k
        else:
            away = k
    first = (near + 1) % 3
    if what == INSIDE_FACE and count == 1 and across[first] >= 0:
        return EDGE_0 + first
    if count == 2 and not free[triangle[away]]:
        return CORNER_0 + away
    return what


@kernel
def places(
    face: Indices,
    weight: Reals,
    feature: Indices,
    x: Reals,
    triangles: Indices,
    across: Indices,
    free: NDArray[np.bool_],
    edge: Indices,
    place: Indices,
) -> None:
    """Indices of the closest features: face, edge or vertex; weights near an edge are moved to it.

    edge: (m, 3) number of the edges of each face, the same for both faces of an edge.
    """
    m = len(triangles)
    for i in range(len(face)):
        f = face[i]
        what = _on_edge(feature[i], weight[i], x, triangles[f], across[f], free)
        if what >= CORNER_0:
            place[i] = 4 * m + triangles[f, what - CORNER_0]
            weight[i, :] = 0.0
            weight[i, what - CORNER_0] = 1.0
        elif what >= EDGE_0:
            place[i] = m + edge[f, what - EDGE_0]
            opposite = (what - EDGE_0 + 2) % 3
            weight[i, opposite] = 0.0
            weight[i, :] /= weight[i].sum()
        else:
            place[i] = f


@kernel
def signed(
    points: Reals,
    at: Indices,
    face: Indices,
    weight: Reals,
    distance: Reals,
    feature: Indices,
    x: Reals,
    triangles: Indices,
    across: Indices,
    free: NDArray[np.bool_],
    by_face: Reals,
    by_corner: Reals,
    flat: Reals,
    blur: float,
    against: Reals,
    gap: Reals,
    normal: Reals,
) -> None:
    """Signed distances and their directions; see `SignedFaces.signed`.

    across: (m, 3) faces beyond the edges of each, -1 at a free one; free, flat: of the vertices.
    """
    way, outward, along = np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(at)):
        f, value = face[i], distance[i]
        t = triangles[f]
        what = _on_edge(feature[i], weight[i], x, t, across[f], free)
        outward[:] = by_face[f]
        open_edge, mean = False, 1.0
        if what >= CORNER_0:
            vertex = t[what - CORNER_0]
            outward[:], open_edge, mean = by_corner[vertex], free[vertex], flat[vertex]
        elif what >= EDGE_0:
            other = across[f, what - EDGE_0]
            open_edge = other < 0
            if not open_edge:
                outward += by_face[other]
                mean = 0.5 * _length(outward)
        size = _length(outward)
        if size > 0.0:
            outward /= size
        for j in range(3):
            way[j] = points[at[i], j]
            for k in range(3):
                way[j] -= weight[i, k] * x[t[k], j]
        sign = -1.0 if dot(way, outward) < 0.0 else 1.0
        gap[i] = np.nan if open_edge else sign * value
        # Within a face the normal is more accurate than the difference of two close points.
        if what > 0 and value > NO_LENGTH * _size(x, t):
            along[:] = sign / value * way
        else:
            along[:] = outward
        if blur > 0.0 and what > 0:
            if len(against) > 0:
                between = outward - against[at[i]]
                size = _length(between)
                if size > OPPOSED and mean < FLAT:
                    outward[:] = between / size
            share = value / (value + blur)
            along[:] = share * along + (1.0 - share) * outward
            along /= _length(along)
            if not open_edge:
                gap[i] = dot(way, along)
        normal[i] = along


@kernel
def walls(
    points: Reals,
    at: Indices,
    face: Indices,
    x: Reals,
    triangles: Indices,
    across: Indices,
    by_face: Reals,
    near: float,
    which: Indices,
    wall: Indices,
    weight: Reals,
    gap: Reals,
    feature: Indices,
) -> int:
    """Number of faces that form a groove with the closest ones; see `SignedFaces.beside`.

    which: (3 k,) row of each; wall, weight, gap, feature: as those of the nearest faces.
    """
    n, nearest = 0, np.empty(3)
    for i in range(len(at)):
        first, p = face[i], points[at[i]]
        for side in range(3):
            f = across[first, side]
            if f < 0:
                continue
            height = 0.0
            for k in range(3):
                opposite = x[triangles[f, k]] - x[triangles[first, side]]
                height = max(height, dot(opposite, by_face[first]))
            if not height > CONCAVE * _size(x, triangles[f]):
                continue
            a, b, c = x[triangles[f, 0]], x[triangles[f, 1]], x[triangles[f, 2]]
            squared, what = point_triangle(p, a, b, c, weight[n])
            if what == INSIDE_FACE or squared < near * near:
                for j in range(3):
                    nearest[j] = weight[n, 0] * a[j] + weight[n, 1] * b[j] + weight[n, 2] * c[j]
                which[n], wall[n], feature[n] = i, f, what
                gap[n] = dot(p - nearest, by_face[f])
                n += 1
    return n
