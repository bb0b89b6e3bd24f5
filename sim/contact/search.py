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
OPPOSED = 0.5  # length of the difference of two normals from which they face each other
FLAT = 0.95  # cosine of the angle between a face and a mean normal, below which an edge is sharp
CONCAVE = 0.1  # sine of the angle from which two faces make a groove
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

    def take(self, which: Index) -> "Found":
        """Some of the rows."""
        return Found(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def joined(self, other: "Found") -> "Found":
        """These rows, then the others."""
        names = self.__dataclass_fields__
        return Found(*(np.concatenate([getattr(self, n), getattr(other, n)]) for n in names))


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

    def beside(
        self, points: Array, found: Found, x: Array, near: float
    ) -> tuple[Found, Array, Array]:
        """Faces that meet the nearest one at a concave edge, where a point is above both.

        A point in a groove is held by both its walls.

        Parameters
        ----------
        points : (n, 3) [m]
        found : Found
            Of `nearest_faces`.
        x : (m, 3) positions that the triangles name [m].
        near : float
            A further face counts where the point is above it, or nearer to it than this [m].

        Returns
        -------
        found : Found
            The same points again, once per further face, with the distances from its plane.
        gap : (k,) distance from the plane of the face, negative behind [m].
        normal : (k, 3) its unit normal.
        """
        by_face, _ = self.normals(x)
        across = self._across[found.face]
        row, side = np.nonzero(across >= 0)
        face, first = across[row, side], found.face[row]
        opposite = x[self.triangles[face]] - x[self.triangles[first, side]][:, None]
        height = np.einsum("kji,ki->kj", opposite, by_face[first]).max(axis=1)
        reach = np.sqrt((opposite**2).sum(axis=2).max(axis=1))
        keep = np.flatnonzero(height > CONCAVE * reach)
        row, face = row[keep], face[keep]
        at, k = found.point[row], len(row)
        weight, squared = np.empty((k, 3)), np.empty(k)
        feature = np.empty(k, dtype=np.int64)
        kernel.closest(
            np.ascontiguousarray(points[at]), x, self.triangles[face], weight, squared, feature
        )
        keep = np.flatnonzero((feature == 0) | (squared < near * near))
        at, face, weight = at[keep], face[keep], weight[keep]
        nearest = np.einsum("kj,kji->ki", weight, x[self.triangles[face]])
        gap = np.einsum("ki,ki->k", points[at] - nearest, by_face[face])
        return Found(at, face, weight, np.abs(gap), feature[keep]), gap, by_face[face]

    def signed(
        self,
        points: Array,
        found: Found,
        x: Array,
        blur: float = 0.0,
        against: Array = NO_NORMALS,
    ) -> tuple[Array, Array]:
        """Signed distances and their directions.

        Parameters
        ----------
        points : (n, 3) [m]
        found : Found
            Of `nearest_faces`.
        x : (m, 3) positions that the triangles name [m].
        blur : float
            Nearer than about this to an edge or a vertex [m] the mean normal of its faces serves as
            direction, since that of the distance turns within the distance itself; the gap is then
            counted along it.
        against : (n, 3), optional
            Outward normals of the points, which share in that mean: two rims that meet push each other
            straight, not along their diagonals.

        Returns
        -------
        gap : (k,) distance, negative inside [m]; NaN at a free edge.
        normal : (k, 3) unit vectors out of the surface, without blur the gradient of the gap.
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
        if blur > 0.0:
            if len(against):
                between = outward - against[found.point]
                size = np.linalg.norm(between, axis=1, keepdims=True)
                sharp = np.einsum("ki,ki->k", outward, by_face[f]) < FLAT
                use = (size > OPPOSED) & sharp[:, None]
                outward = np.where(use, between / np.maximum(size, OPPOSED), outward)
            share = found.value / (found.value + blur)
            mixed = share[:, None] * normal + (1.0 - share)[:, None] * outward
            mixed /= np.linalg.norm(mixed, axis=1, keepdims=True)
            normal = np.where((what > 0)[:, None], mixed, normal)
            along = np.einsum("ki,ki->k", way, normal)
            gap = np.where((what > 0) & ~free, along, gap)
        return gap, normal
