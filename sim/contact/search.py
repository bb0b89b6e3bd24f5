"""Search of faces close to vertices or entered by them during a step.

In each direction of a pairing, the vertices of one surface are searched against the faces of the
other. All searches have the same result as a comparison of every vertex with every face.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim._kernels.crossing import as_early, entries
from sim._kernels.grid import Grid, grid_of
from sim._kernels.nearest_faces import as_near, nearest
from sim._kernels.triangles import within
from sim.scene import Index
from sim.state import Array

NO_NODES = np.empty(0, dtype=np.int64)
NO_NORMALS = np.empty((0, 3))

SAME_DISTANCE, SAME_TIME = 1e-9, 1e-9
"""Difference of distances [m] and of fractions of a step that is due to rounding."""

TOGETHER = 16
"""Average number of equally close faces per point."""


@dataclass(frozen=True, eq=False)
class Found:
    """Faces of points, one each or all equally close ones.

    Attributes
    ----------
    point : (k,) indices of the points with a face; ascending if there is one face for each.
    face : (k,) triangles.
    weight : (k, 3) barycentric weights of the nearest or entered point of the face.
    value : (k,) distance [m] of the nearest face, or fraction 0-1 of the path at which it is entered.
    feature : (k,) 0 within the face; 1, 2, 3 on the edge from corner 0, 1, 2; 4, 5, 6 at a corner.
    """

    point: Index
    face: Index
    weight: Array
    value: Array
    feature: Index

    def take(self, which: Index) -> "Found":
        """Selection of rows."""
        return Found(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def joined(self, other: "Found") -> "Found":
        """Concatenation of these and other rows."""
        names = self.__dataclass_fields__
        return Found(*(np.concatenate([getattr(self, n), getattr(other, n)]) for n in names))


def nearest_faces(
    points: Array,
    radius: Array | float,
    x: Array,
    triangles: Index,
    *,
    nodes: Index = NO_NODES,
    away: Array = NO_NORMALS,
    grid: Grid | None = None,
) -> Found:
    """Closest face of every point within a radius, with its distance.

    Parameters
    ----------
    points : (n, 3) [m]
    radius : (n,) or float
        Largest distance [m]; may be infinite.
    x : (m, 3) positions of the vertices of the triangles [m].
    triangles : (k, 3) int
    nodes : (n,) int, optional
        Index of every point among `x`, -1 for none; faces that contain it are omitted.
    away : (n, 3), optional
        Outward normals of the points; faces with normals not opposite to them are omitted.
    grid : Grid, optional
        Of the triangles at x, if available.
    """
    n = len(points)
    face, weight = np.empty(n, dtype=np.int64), np.zeros((n, 3))
    squared, feature = np.empty(n), np.zeros(n, dtype=np.int64)
    nearest(
        np.ascontiguousarray(points),
        np.array(np.broadcast_to(radius, n), dtype=np.float64),
        nodes if len(nodes) else np.full(n, -1, dtype=np.int64),
        x,
        triangles,
        grid or grid_of(x, x, triangles),
        away,
        face,
        weight,
        squared,
        feature,
    )
    hit = np.flatnonzero(face >= 0)
    return Found(hit, face[hit], weight[hit], np.sqrt(squared[hit]), feature[hit])


def faces_within(points: Array, x: Array, triangles: Index, distance: float) -> NDArray[np.bool_]:
    """Mask of the points (rows) within a distance [m] of each face (column)."""
    out = np.empty((len(points), len(triangles)), dtype=np.bool_)
    within(np.ascontiguousarray(points), x, triangles, distance, out)
    return out


def entered_faces(
    before: Array,
    after: Array,
    x_before: Array,
    x_after: Array,
    triangles: Index,
    *,
    nodes: Index = NO_NODES,
    grid: Grid | None = None,
) -> Found:
    """First face that every point enters through its front on a straight path, with the time 0-1.

    The time is a root of the volume of point and triangle, a cubic over the step.

    Parameters
    ----------
    before, after : (n, 3) points at both ends of the step [m].
    x_before, x_after : (m, 3) positions of the vertices of the triangles [m].
    triangles : (k, 3) int
    nodes : (n,) int, optional
        As in `nearest_faces`.
    grid : Grid, optional
        Of the triangles from x_before to x_after, if available.
    """
    n = len(before)
    face, when, weight = np.empty(n, dtype=np.int64), np.empty(n), np.zeros((n, 3))
    entries(
        np.ascontiguousarray(before),
        np.ascontiguousarray(after),
        nodes if len(nodes) else np.full(n, -1, dtype=np.int64),
        x_before,
        x_after,
        triangles,
        grid or grid_of(x_before, x_after, triangles),
        face,
        when,
        weight,
    )
    hit = np.flatnonzero(face >= 0)
    none = np.zeros(len(hit), dtype=np.int64)
    return Found(hit, face[hit], weight[hit], when[hit], none)


def with_as_near(
    found: Found,
    points: Array,
    x: Array,
    triangles: Index,
    nodes: Index,
    away: Array,
    grid: Grid,
) -> Found:
    """Closest faces, followed by all equally close ones, within rounding.

    Arguments as of `nearest_faces`, whose result is extended.
    """
    room = TOGETHER * len(found.point)
    which, face, feature = (np.empty(room, dtype=np.int64) for _ in range(3))
    weight, distance = np.empty((room, 3)), np.empty(room)
    n = as_near(
        np.ascontiguousarray(points),
        nodes if len(nodes) else np.full(len(points), -1, dtype=np.int64),
        x,
        triangles,
        grid,
        away,
        SAME_DISTANCE,
        found.point,
        found.face,
        found.value,
        which,
        face,
        weight,
        distance,
        feature,
    )
    return found.joined(
        Found(found.point[which[:n]], face[:n], weight[:n], distance[:n], feature[:n])
    )


def with_as_early(
    found: Found,
    before: Array,
    after: Array,
    x_before: Array,
    x_after: Array,
    triangles: Index,
    nodes: Index,
    grid: Grid,
) -> Found:
    """Faces that points enter first, followed by those entered simultaneously.

    Arguments as of `entered_faces`, whose result is extended.
    """
    room = TOGETHER * len(found.point)
    which, face = (np.empty(room, dtype=np.int64) for _ in range(2))
    weight, when = np.empty((room, 3)), np.empty(room)
    n = as_early(
        np.ascontiguousarray(before),
        np.ascontiguousarray(after),
        nodes if len(nodes) else np.full(len(before), -1, dtype=np.int64),
        x_before,
        x_after,
        triangles,
        grid,
        SAME_TIME,
        found.point,
        found.face,
        found.value,
        which,
        face,
        weight,
        when,
    )
    none = np.zeros(n, dtype=np.int64)
    return found.joined(Found(found.point[which[:n]], face[:n], weight[:n], when[:n], none))
