"""Search of faces close to vertices or entered by them during a step.

Lists of the faces near points are kept while points and faces have moved little. In each direction of
a pairing, the vertices of one surface are searched against the faces of the other. All searches have
the same result as a comparison of every vertex with every face.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim._kernels.crossing import entries
from sim._kernels.grid import grid_of
from sim._kernels.nearest_faces import closest, complete, listed
from sim._kernels.triangles import within
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
ROUNDING = 2.0 * SAME_DISTANCE


@dataclass(frozen=True, eq=False)
class Found:
    """Faces of points, one each or all equally close ones."""

    #: (k,) indices of the points with a face, ascending; the closest face of each is the first
    point: Index
    face: Index  #: (k,) triangles
    weight: Array  #: (k, 3) barycentric weights of the nearest or entered point of the face
    #: (k,) distance [m] of the nearest face, or fraction 0-1 of the path at which it is entered
    value: Array
    #: (k,) 0 within the face; 1, 2, 3 on the edge from corner 0, 1, 2; 4, 5, 6 at a corner
    feature: Index

    def take(self, which: Index) -> "Found":
        """Selection of rows."""
        return Found(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def first(self) -> "Found":
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
            moves, reach = own + (farthest + self._skin + ROUNDING), np.empty(len(after))
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
) -> Found:
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
    return Found(point[:n], face[:n], weight[:n], distance[:n], feature[:n])


def nearest_faces(
    points: Array,
    radius: Array | float,
    x: Array,
    triangles: Index,
    *,
    nodes: Index = NO_NODES,
    away: Array = NO_NORMALS,
) -> Found:
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


def entered_faces(
    before: Array, after: Array, x_before: Array, x_after: Array, triangles: Index, near: Candidates
) -> Found:
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
    return Found(point[:n], face[:n], weight[:n], when[:n], np.zeros(n, dtype=np.int64))
