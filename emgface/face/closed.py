"""Test for closed surfaces of triangles, as required by contact."""

import numpy as np
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.surface import Floats, Indices


def open_edges(triangles: Indices) -> NDArray[np.int64]:
    """Edges (n, 2) that do not belong to exactly two triangles with opposite orientation.

    Triangles (m, 3) are counter-clockwise seen from outside; the smaller node of an edge is first.
    """
    run = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    sense = np.where(run[:, 0] < run[:, 1], 1, -1)
    edges, place = np.unique(np.sort(run, axis=1), axis=0, return_inverse=True)
    times = np.bincount(place.reshape(-1))
    turns = np.bincount(place.reshape(-1), weights=sense)
    return edges[(times != 2) | (turns != 0)].astype(np.int64)


def check_closed(points: Floats, triangles: Indices, what: str) -> None:
    """Require a closed surface of outward triangles with positive area, called `what` in messages.

    Raises FaceError if a triangle has no area or occurs twice, an edge does not belong to two
    triangles, or the triangles are oriented inwards.
    """
    corners = points[triangles]
    area = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    flat = np.flatnonzero(~(area > 1e-9 * area.max(initial=0.0)))
    if not len(triangles) or len(flat):
        defect = f"triangle {flat[0]} has no area" if len(flat) else "no triangles"
        raise FaceError(
            f"the surface of {what} does not enclose a volume: {defect}, expected triangles with an area"
        )
    if len(np.unique(np.sort(triangles, axis=1), axis=0)) < len(triangles):
        raise FaceError(f"the surface of {what} contains a triangle twice, expected each once")
    if len(edges := open_edges(triangles)):
        raise FaceError(
            f"the surface of {what} is not closed: {len(edges)} edges do not belong to "
            f"exactly two triangles, the first between points {edges[0, 0]} and "
            f"{edges[0, 1]}; expected a closed surface: generate or import the face again"
        )
    if not volume(points, triangles) > 0.0:
        raise FaceError(
            f"the surface of {what} is oriented inwards, expected outward triangles: reverse them"
        )


def volume(points: Floats, triangles: Indices) -> float:
    """Volume within closed, outward triangles by the divergence theorem [m^3]."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)
