"""Faces close to points or entered by them during a step, signed distances and their directions.

Lists of the faces near points are kept while points and faces have moved little. In each direction of
a pairing, the vertices of one surface are searched against the faces of the other. All searches have
the same result as a comparison of every vertex with every face.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from sim._kernels.crossing import entries
from sim._kernels.grid import grid_of
from sim._kernels.nearest_faces import closest, complete, listed
from sim._kernels.signed import met, places, signed
from sim._kernels.triangles import normals, within
from sim.contact.surfaces import NodeSurface, Surface, sides_of
from sim.scene import Index
from sim.state import Array

NO_NODES = np.empty(0, dtype=np.int64)
NO_NORMALS = np.empty((0, 3))

SAME_DISTANCE, SAME_TIME = 3e-8, 1e-9
"""Difference of distances [m] that is due to iterative solutions, and of fractions of a step that is
due to rounding: of faces that differ by less all are rows, as on both sides of a symmetric face."""

Lists = tuple[Index, Index]
"""Places (n + 1,) of the first face of every point, and the faces of all points, ascending."""


#: additional radius of the lists, for equally close faces and rounding [m]
SEARCH_MARGIN = 2.0 * SAME_DISTANCE


@dataclass(frozen=True, eq=False)
class PointFacePairs:
    """Faces of points, one each or all equally close ones."""

    #: (k,) indices of the points with a face, ascending; the closest face of each is the first
    point: Index
    face: Index  #: (k,) triangles
    weight: Array  #: (k, 3) barycentric weights of the nearest or entered point of the face
    #: (k,) distance [m] of the nearest face, or fraction 0-1 of the path at which it is entered
    value: Array
    #: (k,) 0 within the face; 1, 2, 3 on the edge from corner 0, 1, 2; 4, 5, 6 at a corner
    feature: Index

    def take(self, which: Index) -> "PointFacePairs":
        """Selection of rows."""
        return PointFacePairs(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def first(self) -> "PointFacePairs":
        """The first face of every point."""
        return self.take(np.unique(self.point, return_index=True)[1])


class Candidates:
    """Faces that points may meet (a Verlet list), which are searched again only after motions.

    A point that has moved by a and a face that has moved by b are closer by at most a + b. Lists of all
    faces within the radius of a point and a skin are valid as long as neither exceeds half the
    skin. The faces found among them are those found among all, so that the skin affects the run
    time alone.

    `nodes` (n,) is the vertex that every point is, -1 for none; faces that contain it are omitted.
    `skin` is a distance [m]. With `every` all faces within a radius are listed, otherwise those up to
    the closest one. `searches` counts the searches.
    """

    def __init__(
        self, triangles: Index, nodes: Index, skin: float = 0.0, *, every: bool = False
    ) -> None:
        self._triangles, self._nodes, self._used = triangles, nodes, np.unique(triangles)
        self._skin, self._every = skin, every
        self._made_at: tuple[Array, Array, Array, Array] | None = None
        self._lists: Lists = (np.zeros(len(nodes) + 1, np.int64), np.empty(0, np.int64))
        self.searches = 0

    def along(
        self, before: Array, after: Array, x0: Array, x1: Array, radius: Array | float = 0.0
    ) -> Lists:
        """Faces within a radius of points anywhere on their paths.

        Points (n, 3) and vertices of the faces (k, 3) are given at both ends [m]; the radius may be
        infinite.
        """
        every = np.array(np.broadcast_to(radius, len(after)), dtype=np.float64)
        ends = before, after, x0, x1
        if self._made_at is None or not complete(*ends, self._used, every, *self._made_at):
            own = np.sqrt(((before - after) ** 2).sum(axis=1))
            farthest = (
                np.sqrt(((x0 - x1)[self._used] ** 2).sum(axis=1).max()) if x0 is not x1 else 0.0
            )
            moves, reach = own + (farthest + self._skin + SEARCH_MARGIN), np.empty(len(after))
            first = np.empty(len(after) + 1, np.int64)
            grid = grid_of(x1, x1, self._triangles)
            around = every, moves, self._nodes, x1, self._triangles, grid, self._every
            self._lists = first, listed(after, *around, reach, first)
            self._made_at = after.copy(), x1.copy(), moves, reach
            self.searches += 1
        return self._lists


def closest_faces(
    points: Array,
    radius: Array | float,
    x: Array,
    triangles: Index,
    near: Candidates,
    away: Array = NO_NORMALS,
) -> PointFacePairs:
    """Closest faces of every point within a radius: all equally close ones, with their distances.

    The radius may be infinite [m]. Faces with normals that are not opposite to the outward normals
    `away` of the points are omitted.
    """
    points = np.ascontiguousarray(points)
    start, faces = near.along(points, points, x, x, radius)
    point, face, feature = (np.empty(len(faces), dtype=np.int64) for _ in range(3))
    weight, distance = np.empty((len(faces), 3)), np.empty(len(faces))
    reach = np.array(np.broadcast_to(radius, len(points)), dtype=np.float64)
    among = reach, x, triangles, start, faces, away, SAME_DISTANCE
    n = closest(points, *among, point, face, weight, distance, feature)
    return PointFacePairs(point[:n], face[:n], weight[:n], distance[:n], feature[:n])


def nearest_faces(
    points: Array,
    radius: Array | float,
    x: Array,
    triangles: Index,
    *,
    nodes: Index = NO_NODES,
    away: Array = NO_NORMALS,
) -> PointFacePairs:
    """Closest face of every point within a radius, of equally close ones that of the lowest index.

    Arguments as of `closest_faces`; faces that contain the vertices `nodes` (n,) of the points, -1 for
    none, are omitted.
    """
    nodes = nodes if len(nodes) else np.full(len(points), -1)
    near = Candidates(triangles, nodes, every=len(away) > 0)
    return closest_faces(points, radius, x, triangles, near, away).first()


def faces_within(points: Array, x: Array, triangles: Index, distance: float) -> NDArray[np.bool_]:
    """Mask of the points (rows) within a distance [m] of each face (column)."""
    out = np.empty((len(points), len(triangles)), dtype=np.bool_)
    within(np.ascontiguousarray(points), x, triangles, distance, out)
    return out


def crossed_faces(
    before: Array, after: Array, x_before: Array, x_after: Array, triangles: Index, near: Candidates
) -> PointFacePairs:
    """Faces that points enter first through their fronts on straight paths, with the times 0-1.

    Several of a point are entered at the same time. It is a root of the volume of point and triangle, a
    cubic over the step.
    """
    before, after = np.ascontiguousarray(before), np.ascontiguousarray(after)
    start, faces = near.along(before, after, x_before, x_after)
    point, face = (np.empty(len(faces), dtype=np.int64) for _ in range(2))
    weight, when = np.empty((len(faces), 3)), np.empty(len(faces))
    among = triangles, start, faces, SAME_TIME
    n = int(entries(before, after, x_before, x_after, *among, point, face, when, weight))
    return PointFacePairs(point[:n], face[:n], weight[:n], when[:n], np.zeros(n, dtype=np.int64))


Result = TypeVar("Result")


class CachedByPositions(Generic[Result]):
    """Function of positions with a cache of its latest results.

    A step evaluates the same positions several times, alternately at its start and its end; those of a
    shell at rest are always the same. `make` computes the result for one or several arrays; `size`
    results are kept.
    """

    def __init__(self, make: Callable[..., Result], size: int = 2) -> None:
        self._make = make
        self._kept: deque[tuple[tuple[Array, ...], Result]] = deque(maxlen=size)

    def __call__(self, *x: Array) -> Result:
        """Result for positions x, the same object while it is cached."""
        for known, result in self._kept:
            if len(known) == len(x) and all(map(np.array_equal, known, x)):
                return result
        result = self._make(*x)
        self._kept.append((tuple(a.copy() for a in x), result))
        return result


Normals = tuple[Array, Array, Array]
"""Unit normals of faces (m, 3) and vertices (n, 3), and flatness of the surface at vertices
(n,)."""


@dataclass(frozen=True, eq=False)
class ContactFeatures:
    """Features that points meet, grouped by point."""

    point: Index  #: (k,) indices of the points
    face: Index  #: (k,) a triangle of the feature
    place: Index  #: (k,) number of the feature: triangle, edge or vertex
    wall: NDArray[np.bool_]  #: (k,) True for further walls of a groove
    weight: Array  #: (k, 3) barycentric weights of the closest point
    gap: Array  #: (k,) distance along the normal, negative inside [m]
    normal: Array  #: (k, 3) outward unit vectors


class SignedFaces:
    """Faces of a surface: closest faces, entered faces and signed distances.

    The sign follows from the normal of the nearest face, or from the sum of the normals of the nearest
    edge, or from the angle-weighted normals of the nearest vertex (Baerentzen and Aanaes 2005, Signed
    distance computation using the angle weighted pseudonormal). At a free edge of an open surface there
    is no sign. `across` (m, 3) are the faces beyond the edges of each, -1 at a free one.
    """

    def __init__(self, surface: Surface) -> None:
        self.surface, self.triangles = surface, surface.triangles
        sides = sides_of(surface.triangles)
        size = int(surface.triangles.max()) + 1
        key, back = sides[:, 0] * size + sides[:, 1], sides[:, 1] * size + sides[:, 0]
        order = np.argsort(key)
        place = np.minimum(np.searchsorted(key[order], back), len(key) - 1)
        match = order[place]
        paired, own = key[match] == back, np.arange(len(key))
        self.across = np.where(paired, match // 3, -1).reshape(-1, 3)
        self._edge = np.where(paired, np.minimum(own, match), own).reshape(-1, 3)
        self._free = np.zeros(size, dtype=bool)
        self._free[surface.open_edges] = True
        self._recent = CachedByPositions(self._normals_at)
        self._at_rest: Normals | None = None
        if not isinstance(surface, NodeSurface) and surface.motion is None:
            self._at_rest = self._normals_at(surface.vertices)

    def normals(self, x: Array) -> tuple[Array, Array]:
        """Unit normals of the faces (k, 3) and of the vertices x (m, 3), zero for unused ones."""
        face, corner, _ = self._normals(x)
        return face, corner

    def normals_of(self, place: Index, x: Array) -> Array:
        """Unit normals (k, 3) of features: faces, edges and vertices numbered by `distinct`."""
        face, corner, _ = self._normals(x)
        m, out = len(self.triangles), np.empty((len(place), 3))
        within, vertex = place < m, place >= 4 * m
        edge = ~within & ~vertex
        out[within], out[vertex] = face[place[within]], corner[place[vertex] - 4 * m]
        one, side = np.divmod(place[edge] - m, 3)
        other = self.across[one, side]
        mean = face[one] + np.where((other >= 0)[:, None], face[other], 0.0)
        size = np.linalg.norm(mean, axis=1, keepdims=True)
        out[edge] = mean / np.where(size > 0.0, size, 1.0)
        return out

    def _normals(self, x: Array) -> Normals:
        return self._recent(x) if self._at_rest is None else self._at_rest

    def _normals_at(self, x: Array) -> Normals:
        face, corner, flat = np.empty((len(self.triangles), 3)), np.empty_like(x), np.empty(len(x))
        normals(x, self.triangles, face, corner, flat)
        return face, corner, flat

    def places_of(self, pairs: PointFacePairs, x: Array) -> tuple[PointFacePairs, Index]:
        """Unique closest faces, edges and vertices of points, and their indices (k,).

        An edge has the same index for both its faces, and a vertex for all; weights are on the feature.
        """
        # the first of the faces that share a feature, closest or earliest, irrespective of their
        # numbering
        pairs = pairs.take(np.argsort(pairs.value, kind="stable"))
        place, weight = np.empty(len(pairs.point), dtype=np.int64), pairs.weight.copy()
        about = self.across, self._free, self._edge, place
        places(pairs.face, weight, pairs.feature, x, self.triangles, *about)
        key = pairs.point * (4 * len(self.triangles) + len(self._free)) + place
        _, first = np.unique(key, return_index=True)
        return replace(pairs, weight=weight).take(first), place[first]

    def met(
        self,
        points: Array,
        radius: Array,
        may: Array,
        x: Array,
        near: Candidates,
        away: Array,
        against: Array,
        blur: float,
        deepest: float,
    ) -> ContactFeatures:
        """Features that points meet within a radius, from their depths outwards.

        They are the closest face, edge or vertex, or all equally close ones, with the mean normal of
        the faces that meet there. A point in a groove also meets the face adjacent to the closest one at
        a concave edge, if it is above both. A point inside, midway between faces with opposite normals,
        meets only the first.

        Parameters
        ----------
        points, radius, x, near, away
            As of `closest_faces`.
        may : (n,) depth that points may have, by which their radius is larger [m].
        against : outward normals of the points, which are included in the mean normals of edges and
            vertices, so that the forces between two edges are not diagonal.
        blur : distance from an edge or a vertex [m] below which the direction is the mean normal of its
            faces, because that of the distance changes over a length equal to the distance; the gap is
            then measured along it. Within it a further wall is met also by a point that is not above
            its face.
        deepest : gap below which a feature is not met [m].
        """
        by_face, by_corner, flat = self._normals(x)
        start, listed = near.along(points, points, x, x, radius)
        room = 4 * len(listed) + 1
        point, face, place = (np.empty(room, dtype=np.int64) for _ in range(3))
        wall, gap = np.empty(room, dtype=np.bool_), np.empty(room)
        weight, normal = np.empty((room, 3)), np.empty((room, 3))
        results = point, face, place, wall, weight, gap, normal
        about = points, radius, may, x, self.triangles, start, listed, away, SAME_DISTANCE
        signs = self.across, self._free, self._edge, by_face, by_corner, flat
        n = met(*about, *signs, blur, against, deepest, *results)
        return ContactFeatures(
            point[:n], face[:n], place[:n], wall[:n], weight[:n], gap[:n], normal[:n]
        )

    def signed(self, points: Array, pairs: PointFacePairs, x: Array) -> tuple[Array, Array]:
        """Signed distances (k,), negative inside and NaN at a free edge [m], and their gradients (k, 3).

        Points (n, 3) and vertices x (m, 3) are in [m]; `pairs` is of `closest_faces`.
        """
        by_face, by_corner, flat = self._normals(x)
        k = len(pairs.point)
        gap, normal = np.empty(k), np.empty((k, 3))
        about = pairs.point, pairs.face, pairs.weight, pairs.value, pairs.feature, x, self.triangles
        signs = self.across, self._free, by_face, by_corner, flat
        signed(np.ascontiguousarray(points), *about, *signs, gap, normal)
        return gap, normal
