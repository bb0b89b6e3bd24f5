"""Which vertices are near which faces, and which enter one during a step.

Each direction of a pairing is the vertices of one surface against the faces of the other. All searches
end at the same answer as a comparison of every vertex with every face.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim._kernels import contact as kernel
from sim.contact.surfaces import Surface
from sim.scene import Index
from sim.state import Array

NO_NODES = np.empty(0, dtype=np.int64)
NO_NORMALS = np.empty((0, 3))


@dataclass(frozen=True, eq=False)
class Found:
    """A face per point, where there is one.

    Attributes
    ----------
    point : (k,) indices of the points that have one, ascending.
    face : (k,) triangles.
    weight : (k, 3) barycentric weights of the nearest or entered point of the face.
    value : (k,) distance [m] of the nearest face, or share 0-1 of the way at which it is entered.
    feature : (k,) 0 within the face; 1, 2, 3 on the edge from corner 0, 1, 2; 4, 5, 6 at a corner.
    """

    point: Index
    face: Index
    weight: Array
    value: Array
    feature: Index


@dataclass(frozen=True, eq=False)
class _Sweep:
    """Boxes of faces, sorted by their low ends along the longest axis."""

    order: Index
    low: Array
    high: Array
    widest: float
    axis: int

    @classmethod
    def over(cls, triangles: Index, *positions: Array) -> "_Sweep":
        corners = np.concatenate([x[triangles] for x in positions], axis=1)
        low, high = corners.min(axis=1), corners.max(axis=1)
        # what rounding could hide behind a box
        slack = 1e-12 * float(np.abs(corners).max())
        low, high = low - slack, high + slack
        axis = int(np.argmax(high.max(axis=0) - low.min(axis=0)))
        order = np.argsort(low[:, axis], kind="stable")
        widest = float((high - low)[:, axis].max())
        return cls(order, low[order], high[order], widest, axis)


def nearest_faces(
    points: Array,
    radius: Array | float,
    x: Array,
    triangles: Index,
    *,
    nodes: Index = NO_NODES,
    away: Array = NO_NORMALS,
) -> Found:
    """Nearest face of every point within a radius.

    Parameters
    ----------
    points : (n, 3) [m]
    radius : (n,) or float
        Faces farther away are not looked for [m]; may be infinite.
    x : (m, 3) positions that the triangles name [m].
    triangles : (k, 3) int
    nodes : (n,) int, optional
        Index of every point among `x`, -1 for none: faces that have it are left out.
    away : (n, 3), optional
        Outward normals of the points: faces that do not oppose them are left out.

    Returns
    -------
    Found
        With distances.
    """
    n = len(points)
    face, weight = np.empty(n, dtype=np.int64), np.zeros((n, 3))
    squared, feature = np.empty(n), np.zeros(n, dtype=np.int64)
    sweep = _Sweep.over(triangles, x)
    kernel.nearest(
        np.ascontiguousarray(points),
        np.array(np.broadcast_to(radius, n), dtype=np.float64),
        nodes if len(nodes) else np.full(n, -1, dtype=np.int64),
        x,
        triangles,
        sweep.order,
        sweep.low,
        sweep.high,
        sweep.widest,
        sweep.axis,
        away,
        face,
        weight,
        squared,
        feature,
    )
    hit = np.flatnonzero(face >= 0)
    return Found(hit, face[hit], weight[hit], np.sqrt(squared[hit]), feature[hit])


def faces_within(points: Array, x: Array, triangles: Index, distance: float) -> NDArray[np.bool_]:
    """Whether each point (row) is within a distance [m] of each face (column)."""
    out = np.empty((len(points), len(triangles)), dtype=np.bool_)
    kernel.within(np.ascontiguousarray(points), x, triangles, distance, out)
    return out


def entered_faces(
    before: Array,
    after: Array,
    x_before: Array,
    x_after: Array,
    triangles: Index,
    *,
    nodes: Index = NO_NODES,
) -> Found:
    """First face that every point enters through its front, all on straight ways.

    The instant solves the cubic that the volume of point and triangle is over the step.

    Parameters
    ----------
    before, after : (n, 3) points at both ends of the step [m].
    x_before, x_after : (m, 3) positions that the triangles name [m].
    triangles : (k, 3) int
    nodes : (n,) int, optional
        As in `nearest_faces`.

    Returns
    -------
    Found
        With the share of the step.
    """
    n = len(before)
    face, when, weight = np.empty(n, dtype=np.int64), np.empty(n), np.zeros((n, 3))
    sweep = _Sweep.over(triangles, x_before, x_after)
    kernel.entries(
        np.ascontiguousarray(before),
        np.ascontiguousarray(after),
        nodes if len(nodes) else np.full(n, -1, dtype=np.int64),
        x_before,
        x_after,
        triangles,
        sweep.order,
        sweep.low,
        sweep.high,
        sweep.widest,
        sweep.axis,
        face,
        when,
        weight,
    )
    hit = np.flatnonzero(face >= 0)
    none = np.zeros(len(hit), dtype=np.int64)
    return Found(hit, face[hit], weight[hit], when[hit], none)


def inside(points: Array, surface: Surface, x: Array) -> NDArray[np.bool_]:
    """Whether each point lies inside a closed surface, by its winding number.

    Parameters
    ----------
    points : (n, 3) [m]
    surface : NodeSurface or RigidShell
    x : (m, 3) positions that the surface's triangles name [m].

    Raises
    ------
    ContactFailure
        The surface is open.
    """
    surface.require_closed("a test of inside and outside")
    out = np.empty(len(points))
    kernel.winding(np.ascontiguousarray(points), x, surface.triangles, out)
    return out > 0.5


class SignedFaces:
    """Outward directions of a surface, for the signed distance to it.

    Parameters
    ----------
    surface : NodeSurface or RigidShell

    Notes
    -----
    The sign follows from the normal of the nearest face, or from the sum of the normals of the nearest
    edge, or from the angle-weighted normals of the nearest vertex (Baerentzen and Aanaes 2005, Signed
    distance computation using the angle weighted pseudonormal). At a free edge of an open surface there
    is no sign.
    """

    def __init__(self, surface: Surface) -> None:
        self.triangles = surface.triangles
        sides = surface.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        size = int(surface.triangles.max()) + 1
        key, back = sides[:, 0] * size + sides[:, 1], sides[:, 1] * size + sides[:, 0]
        order = np.argsort(key)
        place = np.minimum(np.searchsorted(key[order], back), len(key) - 1)
        match = order[place]
        self._across = np.where(key[match] == back, match // 3, -1).reshape(-1, 3)
        self._free = np.zeros(size, dtype=bool)
        self._free[surface.open_edges] = True

    def normals(self, x: Array) -> tuple[Array, Array]:
        """Unit normals of the faces (k, 3) and of the positions x (m, 3), zero where none is named."""
        face, corner = np.empty((len(self.triangles), 3)), np.empty((len(x), 3))
        kernel.normals(x, self.triangles, face, corner)
        return face, corner

    def signed(self, points: Array, found: Found, x: Array) -> tuple[Array, Array]:
        """Signed distances and their directions.

        Parameters
        ----------
        points : (n, 3) [m]
        found : Found
            Of `nearest_faces`.
        x : (m, 3) positions that the triangles name [m].

        Returns
        -------
        gap : (k,) distance, negative inside [m]; NaN at a free edge.
        normal : (k, 3) unit vectors out of the surface, the gradient of the gap.
        """
        by_face, by_corner = self.normals(x)
        f, what = found.face, found.feature
        outward = by_face[f].copy()
        free = np.zeros(len(f), dtype=bool)
        edge = np.flatnonzero((what >= 1) & (what <= 3))
        across = self._across[f[edge], what[edge] - 1]
        outward[edge] += np.where(across[:, None] >= 0, by_face[across], 0.0)
        free[edge] = across < 0
        corner = np.flatnonzero(what >= 4)
        vertex = self.triangles[f[corner], what[corner] - 4]
        outward[corner] = by_corner[vertex]
        free[corner] = self._free[vertex]
        size = np.linalg.norm(outward, axis=1, keepdims=True)
        outward /= np.where(size > 0.0, size, 1.0)

        nearest = np.einsum("kj,kji->ki", found.weight, x[self.triangles[f]])
        way = points[found.point] - nearest
        side = np.einsum("ki,ki->k", way, outward)
        sign = np.where(side < 0.0, -1.0, 1.0)
        gap = np.where(free, np.nan, sign * found.value)
        # within a face the normal is known better than the difference of two near points
        reach = np.sqrt(((x[self.triangles[f, 1]] - x[self.triangles[f, 0]]) ** 2).sum(axis=1))
        apart = (what > 0) & (found.value > 1e-6 * reach)
        length = np.where(found.value > 0.0, found.value, 1.0)
        normal = np.where(apart[:, None], (sign / length)[:, None] * way, outward)
        return gap, normal
