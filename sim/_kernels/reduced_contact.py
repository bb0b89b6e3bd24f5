"""Contact rows of points of a reduced solid, and their impulses."""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# numba compiles these functions; those called from Python carry types

import numpy as np
from numpy.typing import NDArray

from sim._kernels.element import Indices, Reals
from sim._kernels.options import inner, kernel
from sim._kernels.triangles import CORNER_0, EDGE_0, INSIDE_FACE, point_triangle

SAME = 1e-9  #: difference of the distances of equally close faces [m]


@inner
def _at_free_edge(feature, t, across, free):
    """Test if the closest point is on the free edge of an open surface, where there is no sign."""
    if feature >= CORNER_0:
        return free[t[feature - CORNER_0]]
    return feature >= EDGE_0 and across[feature - EDGE_0] < 0


@kernel
def contact_rows(
    points: Reals,
    radius: Reals,
    deepest: float,
    x: Reals,
    triangles: Indices,
    across: Indices,
    free: NDArray[np.bool_],
    start: Indices,
    listed: Indices,
    of_points: Reals,
    of_nodes: Reals,
    N: Reals,
    gap: Reals,
    at: Indices,
) -> int:
    """Rows of the points whose closest face is within their radius; returns their number.

    Of faces that share the closest point, that whose normal is most nearly parallel to the distance
    determines the sign. A row is N = n' (d point/dy - d face/dy), with n the unit vector of the
    distance, or the normal of the face within it and at less than a nanometre.

    Parameters
    ----------
    points, radius : (n, 3), (n,) [m].
    deepest : depth below which a point behind the faces is not met [m].
    x, triangles, across, free : vertices, faces, the faces beyond their edges, -1 at a free one, and
        True for the vertices of free edges.
    start, listed : faces near every point.
    of_points, of_nodes : (n, 3, m), (k, 3, m) derivatives of points and vertices by the coordinates,
        or without entries if they are rigid.
    N, gap, at : rows (n, m), distances (n,) [m], negative inside, and their points (n,).
    """
    w, best_w, normal, way, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    count = 0
    for i in range(len(points)):
        least = radius[i] * radius[i]
        for k in range(start[i], start[i + 1]):
            t = triangles[listed[k]]
            d2, _ = point_triangle(points[i], x[t[0]], x[t[1]], x[t[2]], w)
            least = min(least, d2)
        most = (np.sqrt(least) + SAME) ** 2
        best, steepest, feature = -1, -1.0, INSIDE_FACE
        for k in range(start[i], start[i + 1]):
            t = triangles[listed[k]]
            a, b, c = x[t[0]], x[t[1]], x[t[2]]
            d2, what = point_triangle(points[i], a, b, c, w)
            if d2 > most:
                continue
            for j in range(3):
                one, two = (j + 1) % 3, (j + 2) % 3
                n[j] = (b[one] - a[one]) * (c[two] - a[two]) - (b[two] - a[two]) * (c[one] - a[one])
            size = np.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2)
            along = 0.0
            for j in range(3):
                n[j] /= size
                way[j] = points[i, j] - w[0] * a[j] - w[1] * b[j] - w[2] * c[j]
                along += n[j] * way[j]
            if abs(along) > steepest:
                steepest, best, feature = abs(along), listed[k], what
                length = np.sqrt(d2)
                sign = -1.0 if along < 0.0 else 1.0
                gap[count] = sign * length
                straight = what == INSIDE_FACE or length < SAME
                for j in range(3):
                    normal[j] = n[j] if straight else sign * way[j] / length
                    best_w[j] = w[j]
        if (
            best < 0
            or gap[count] < -deepest
            or _at_free_edge(feature, triangles[best], across[best], free)
        ):
            continue
        t = triangles[best]
        for m in range(N.shape[1]):
            s = 0.0
            for j in range(3):
                if len(of_points) > 0:
                    s += normal[j] * of_points[i, j, m]
                if len(of_nodes) > 0:
                    for c in range(3):
                        s -= normal[j] * best_w[c] * of_nodes[t[c], j, m]
            N[count, m] = s
        at[count] = i
        count += 1
    return count


@kernel
def push_apart(
    W: Reals, rate: Reals, softness: float, most: int, tolerance: float, p: Reals
) -> float:
    """Impulses p >= 0 (k,) with rate + W (p - p0) + softness p >= 0, complementary, in place.

    Projected Gauss-Seidel sweeps from the given p0, at which the rates are `rate` (k,); they become
    those at p. Returns the largest change of a rate in the last sweep [m/s].
    """
    changed = 0.0
    for _ in range(most):
        changed = 0.0
        for i in range(p.size):
            if not W[i, i] > 0.0:
                p[i] = 0.0
                continue
            new = max(p[i] - (rate[i] + softness * p[i]) / (W[i, i] + softness), 0.0)
            step = new - p[i]
            if step != 0.0:
                p[i] = new
                for j in range(p.size):
                    rate[j] += W[i, j] * step
                changed = max(changed, abs(step) * W[i, i])
        if changed <= tolerance:
            break
    return changed
