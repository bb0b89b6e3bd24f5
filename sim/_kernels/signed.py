"""Signed distances to the closest faces, their directions, and adjacent walls of grooves."""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import numpy as np
from numpy.typing import NDArray

from sim._kernels.element import Indices, Reals
from sim._kernels.nearest_faces import near_listed
from sim._kernels.options import allocating, inner, kernel
from sim._kernels.triangles import CORNER_0, EDGE_0, INSIDE_FACE, dot, point_triangle

OPPOSED = 0.5  #: length of the difference of two normals above which they are opposite

FLAT_COSINE = 0.95
"""Mean cosine of the angles between faces and their mean normal, below which an edge is sharp."""

CONCAVE = 0.1
"""Height of a face above its neighbour, of its longest side, from which the two make a groove."""

ON_EDGE = 1e-6  #: distance within a face below which a point is regarded as on its edge [m]
NO_LENGTH = 1e-6  #: relative distance below which the direction of a distance is undefined


@inner
def _length(v):
    return np.sqrt(dot(v, v))


@allocating
def _size(x, triangle):
    """Longest side of a triangle."""
    a, b, c = x[triangle[0]], x[triangle[1]], x[triangle[2]]
    return max(_length(b - a), _length(c - b), _length(a - c))


@allocating
def _on_edge(what, weight, x, triangle, across, free):
    """Feature of the closest point, with points close to an edge assigned to the edge.

    Bodies with coplanar sides are in contact at their edges, and rounding must not assign the
    contact to their sides. A free edge has no sign and is not assigned.
    """
    if what >= CORNER_0:
        return what
    double = _length(np.cross(x[triangle[1]] - x[triangle[0]], x[triangle[2]] - x[triangle[0]]))
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


@inner
def _place(f, what, weight, triangles, edge):
    """Index of a feature of face f: face, edge or vertex; weights near an edge are moved to it."""
    m = len(triangles)
    if what >= CORNER_0:
        weight[0] = weight[1] = weight[2] = 0.0
        weight[what - CORNER_0] = 1.0
        return 4 * m + triangles[f, what - CORNER_0]
    if what >= EDGE_0:
        weight[(what - EDGE_0 + 2) % 3] = 0.0
        size = weight[0] + weight[1] + weight[2]
        for k in range(3):
            weight[k] /= size
        return m + edge[f, what - EDGE_0]
    return f


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
    for i in range(len(face)):
        f = face[i]
        what = _on_edge(feature[i], weight[i], x, triangles[f], across[f], free)
        place[i] = _place(f, what, weight[i], triangles, edge)


@allocating
def _signed(
    p, f, weight, value, what, x, triangles, across, free, by_face, by_corner, flat, blur, against,
    normal, way, outward
):  # fmt: skip
    """Signed distance of a point from its closest feature; its direction in `normal`.

    `what` is the feature with edges rounded, `against` (3,) an outward normal of the point, or empty;
    way, outward (3,) are scratch.
    """
    t = triangles[f]
    open_edge, mean = False, 1.0
    for j in range(3):
        outward[j] = by_face[f, j]
    if what >= CORNER_0:
        vertex = t[what - CORNER_0]
        open_edge, mean = free[vertex], flat[vertex]
        for j in range(3):
            outward[j] = by_corner[vertex, j]
    elif what >= EDGE_0:
        other = across[f, what - EDGE_0]
        open_edge = other < 0
        if not open_edge:
            for j in range(3):
                outward[j] += by_face[other, j]
            mean = 0.5 * _length(outward)
    size = _length(outward)
    if size > 0.0:
        for j in range(3):
            outward[j] /= size
    for j in range(3):
        way[j] = p[j]
        for k in range(3):
            way[j] -= weight[k] * x[t[k], j]
    sign = -1.0 if dot(way, outward) < 0.0 else 1.0
    gap = np.nan if open_edge else sign * value
    # Within a face the normal is more accurate than the difference of two close points.
    far = what > 0 and value > NO_LENGTH * _size(x, t)
    for j in range(3):
        normal[j] = sign / value * way[j] if far else outward[j]
    if blur > 0.0 and what > 0:
        if len(against) > 0:
            size = 0.0
            for j in range(3):
                size += (outward[j] - against[j]) ** 2
            size = np.sqrt(size)
            if size > OPPOSED and mean < FLAT_COSINE:
                for j in range(3):
                    outward[j] = (outward[j] - against[j]) / size
        share = value / (value + blur)
        for j in range(3):
            normal[j] = share * normal[j] + (1.0 - share) * outward[j]
        size = _length(normal)
        for j in range(3):
            normal[j] /= size
        if not open_edge:
            gap = dot(way, normal)
    return gap


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
    gap: Reals,
    normal: Reals,
) -> None:
    """Signed distances and their directions; see `SignedFaces.signed`.

    across: (m, 3) faces beyond the edges of each, -1 at a free one; free, flat: of the vertices.
    """
    way, outward, none = np.empty(3), np.empty(3), np.empty(0)
    for i in range(len(at)):
        f = face[i]
        what = _on_edge(feature[i], weight[i], x, triangles[f], across[f], free)
        gap[i] = _signed(
            points[at[i]], f, weight[i], distance[i], what, x, triangles, across, free,
            by_face, by_corner, flat, 0.0, none, normal[i], way, outward
        )  # fmt: skip


@allocating
def _grouped(
    p, listed, first, ties, tie, squared, what, w, x, triangles, across, free, edge, by_face, by_corner,
    flat, blur, against, own, sums, gaps, at, group, nearest, rounded, way, outward
):  # fmt: skip
    """Number of features of equally close faces, whose leading faces are in `group`, ordered by feature.

    sums: of the normals of the faces of each feature; nearest: the closest of these faces.
    """
    groups = 0
    for j in range(ties):
        k = tie[j]
        f = listed[first + k]
        feature = _on_edge(what[k], w[k], x, triangles[f], across[f], free)
        here = _signed(
            p, f, w[k], np.sqrt(squared[k]), feature, x, triangles, across, free,
            by_face, by_corner, flat, blur, against, own[j], way, outward
        )  # fmt: skip
        for c in range(3):
            rounded[j, c] = w[k, c]
        at[j] = _place(f, feature, rounded[j], triangles, edge)
        g = 0
        while g < groups and at[group[g]] < at[j]:
            g += 1
        if g < groups and at[group[g]] == at[j]:
            lead = group[g]
            for c in range(3):
                sums[lead, c] += own[j, c]
            if not gaps[lead] >= here:  # a number rather than NaN
                gaps[lead] = here if here == here else gaps[lead]
            # of faces that share the feature, the closest determines the place, independent of numbering
            if squared[k] < squared[tie[nearest[lead]]]:
                nearest[lead] = j
            continue
        for k in range(groups, g, -1):
            group[k] = group[k - 1]
        group[g] = j
        groups += 1
        gaps[j], nearest[j] = here, j
        for c in range(3):
            sums[j, c] = own[j, c]
    return groups


@allocating
def adjacent_walls(
    p, i, n, radius, may, listed, first, ties, tie, at, x, triangles, across, by_face, blur, deepest,
    point, face, place, wall, weight, gap, normal, way
):  # fmt: skip
    """Number of results after those of faces that form a groove with a closest one of point i.

    Such a face has a row if the point is above both.
    """
    walls = n
    for j in range(ties):
        one = listed[first + tie[j]]
        for side in range(3):
            f = across[one, side]
            if f < 0:
                continue
            height = 0.0
            for k in range(3):
                rise = 0.0
                for c in range(3):
                    corner = x[triangles[one, side], c]
                    rise += (x[triangles[f, k], c] - corner) * by_face[one, c]
                height = max(height, rise)
            if not height > CONCAVE * _size(x, triangles[f]):
                continue
            t = triangles[f]
            apart, feature = point_triangle(p, x[t[0]], x[t[1]], x[t[2]], weight[n])
            if not (feature == INSIDE_FACE or apart < blur * blur):
                continue
            known = False
            for k in range(ties):
                known = known or at[k] == f
            for k in range(walls, n):
                known = known or face[k] == f
            if known:
                continue
            for c in range(3):
                way[c], normal[n, c] = p[c], by_face[f, c]
                for k in range(3):
                    way[c] -= weight[n, k] * x[t[k], c]
            gap[n] = dot(way, by_face[f])
            if gap[n] > deepest and gap[n] + may < radius:
                point[n], face[n], place[n], wall[n] = i, f, f, True
                n += 1
    return n


@kernel
def met(
    points: Reals,
    radius: Reals,
    may: Reals,
    x: Reals,
    triangles: Indices,
    start: Indices,
    listed: Indices,
    away: Reals,
    slack: float,
    across: Indices,
    free: NDArray[np.bool_],
    edge: Indices,
    by_face: Reals,
    by_corner: Reals,
    flat: Reals,
    blur: float,
    against: Reals,
    deepest: float,
    point: Indices,
    face: Indices,
    place: Indices,
    wall: NDArray[np.bool_],
    weight: Reals,
    gap: Reals,
    normal: Reals,
) -> int:
    """Features that points meet; see `SignedFaces.met`. Returns their number.

    may: depth that each point may have. Other arguments as of `signed` and
    `sim._kernels.nearest_faces.closest`; place, wall, gap, normal: of each result.
    """
    longest = 0
    for i in range(len(points)):
        longest = max(longest, start[i + 1] - start[i])
    squared, what, w = np.empty(longest), np.empty(longest, np.int64), np.empty((longest, 3))
    tie, rounded = np.empty(longest, np.int64), np.empty((longest, 3))
    own, sums, gaps = np.empty((longest, 3)), np.empty((longest, 3)), np.empty(longest)
    at, group = np.empty(longest, np.int64), np.empty(longest, np.int64)
    nearest = np.empty(longest, np.int64)
    way, outward, n = np.empty(3), np.empty(3), 0
    for i in range(len(points)):
        p = points[i]
        first, size = start[i], start[i + 1] - start[i]
        best = near_listed(
            p, radius[i], x, triangles, first, size, listed, away, i, squared, what, w
        )
        if best < 0:
            continue
        most = np.sqrt(squared[best]) + slack
        ties = 0
        for turn in range(-1, size):
            k = best if turn < 0 else turn
            if turn != best and (turn < 0 or squared[k] <= most * most):
                tie[ties] = k
                ties += 1
        groups = _grouped(
            p, listed, first, ties, tie, squared, what, w, x, triangles, across, free, edge, by_face,
            by_corner, flat, blur, against[i], own, sums, gaps, at, group, nearest, rounded, way, outward
        )  # fmt: skip
        for g in range(groups):
            j = group[g]
            length = _length(sums[j])
            for c in range(3):
                normal[n, c] = sums[j, c] / length if length > 0.0 else own[j, c]
            # a point inside, midway between faces with opposite normals, keeps the first
            if g > 0 and gaps[j] < 0.0 and dot(normal[n], sums[group[0]]) < 0.0:
                continue
            if gaps[j] > deepest and gaps[j] + may[i] < radius[i]:
                lead = nearest[j]
                point[n], face[n], place[n], wall[n] = i, listed[first + tie[lead]], at[j], False
                gap[n] = gaps[j]
                for c in range(3):
                    weight[n, c] = rounded[lead, c]
                n += 1
        n = adjacent_walls(
            p, i, n, radius[i], may[i], listed, first, ties, tie, at, x, triangles, across, by_face,
            blur, deepest, point, face, place, wall, weight, gap, normal, way
        )  # fmt: skip
    return n
