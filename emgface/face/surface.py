"""Boundary surface of a mesh of hexahedra and wedges, and closest points on triangles."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.quality import is_wedge
from sim.indices import index_rows, whole_numbers

Floats = NDArray[np.float64]
Indices = NDArray[np.integer]

# Faces seen from outside counter-clockwise; a triangle repeats its last node.
_HEX_FACES: Final = np.array(
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
)
_WEDGE_FACES: Final = np.array(
    [[0, 2, 1, 1], [3, 4, 5, 5], [0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5]]
)
_HEX_EDGES: Final = np.array(
    [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]]
)
_WEDGE_EDGES: Final = np.array(
    [[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]]
)


def element_edges(connectivity: Indices) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Edges (n, 2) of all elements, with the smaller node first, and the element of each."""
    return _parts(connectivity, _HEX_EDGES, _WEDGE_EDGES, ordered=True)


def element_faces(connectivity: Indices) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Faces (n, 4) of all elements, outward, and the element of each.

    `connectivity` (elements, 8) is in VTK order, with -1 in the last two columns of a wedge. A
    triangle repeats its last node.
    """
    return _parts(connectivity, _HEX_FACES, _WEDGE_FACES)


def boundary_faces(connectivity: Indices) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Faces that belong to one element only, and that element (`element_faces`)."""
    faces, element = element_faces(connectivity)
    # The repeated node of a triangle differs between its two elements; unique nodes identify it.
    key = np.sort(np.where(faces[:, [3]] == faces[:, [2]], [[1, 1, 1, 0]], 1) * (faces + 1), axis=1)
    _, inverse, counts = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    once = counts[inverse.reshape(-1)] == 1
    return faces[once], element[once]


def faces_among(
    connectivity: Indices, nodes: Indices
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Boundary faces whose nodes all belong to a set, and their elements."""
    faces, element = boundary_faces(connectivity)
    inside = np.isin(faces, nodes).all(axis=1)
    return faces[inside], element[inside]


def boundary_edges(faces: Indices) -> NDArray[np.int64]:
    """Edges (n, 2) of one face only, the smaller node first; of faces (k, 4)."""
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    edges = np.sort(edges[edges[:, 0] != edges[:, 1]], axis=1)
    unique_edges, counts = np.unique(edges, axis=0, return_counts=True)
    return unique_edges[counts == 1].astype(np.int64)


def triangles(faces: Indices, position: Floats) -> NDArray[np.int64]:
    """Split quadrilaterals along their shorter diagonal; triangles are unchanged, shape (n, 3).

    The shorter diagonal, unlike a fixed corner, treats mirrored faces in the same way.
    """
    faces = index_rows("faces", "node", faces, len(position), 4, error=FaceError)
    three = faces[:, 2] == faces[:, 3]
    quad = faces[~three]
    corners = position[quad]
    first = np.linalg.norm(corners[:, 0] - corners[:, 2], axis=1)
    second = np.linalg.norm(corners[:, 1] - corners[:, 3], axis=1)
    along, across = quad[first < second], quad[first >= second]
    return np.concatenate(
        [
            faces[three][:, :3],
            along[:, [0, 1, 2]],
            along[:, [0, 2, 3]],
            across[:, [0, 1, 3]],
            across[:, [1, 2, 3]],
        ]
    )


def face_areas(position: Floats, faces: Indices) -> Floats:
    """Half the cross product of the diagonals of each face, shape (n,) [m2].

    It is exact for flat faces; for a warped one it is the length of its vector area.
    """
    corners = position[faces]
    across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    return np.linalg.norm(across, axis=1) / 2.0


def winding_number(points: Floats, corners: Floats) -> Floats:
    """Winding number (n,) of closed, outward triangles around points: 1 inside, 0 outside.

    Sum of the signed solid angles over 4 pi, each by the formula of Van Oosterom and Strackee
    (1983). `corners` has the shape (triangles, 3, 3).
    """
    result = np.empty(len(points))
    for k, point in enumerate(points):
        a, b, c = (corners[:, i] - point for i in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        top = np.einsum("ij,ij->i", a, np.cross(b, c))
        bottom = (
            la * lb * lc
            + np.einsum("ij,ij->i", a, b) * lc
            + np.einsum("ij,ij->i", b, c) * la
            + np.einsum("ij,ij->i", c, a) * lb
        )
        result[k] = np.sum(2.0 * np.arctan2(top, bottom)) / (4.0 * np.pi)
    return result


def nearest_on_triangles(point: Floats, corners: Floats) -> tuple[Floats, int, Floats]:
    """Point nearest to `point` (3,) on a set of triangles (m, 3, 3).

    Returns the point (3,), its triangle, and its barycentric coordinates (3,) in that triangle.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac, ap = b - a, c - a, point - a
    d11, d12, d22 = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
    p1, p2 = _dot(ap, ab), _dot(ap, ac)
    area2 = d11 * d22 - d12 * d12
    safe = np.where(area2 > 0, area2, 1.0)
    v = (d22 * p1 - d12 * p2) / safe
    w = (d11 * p2 - d12 * p1) / safe
    weights = np.stack([1.0 - v - w, v, w], axis=1)
    # Foot of the perpendicular if inside, otherwise the nearest point of the three edges.
    candidates = [weights]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        edge = corners[:, j] - corners[:, i]
        length2 = _dot(edge, edge)
        t = _dot(point - corners[:, i], edge) / np.where(length2 > 0, length2, 1.0)
        t = np.clip(t, 0.0, 1.0)
        row = np.zeros_like(weights)
        row[:, i], row[:, j] = 1.0 - t, t
        candidates.append(row)
    stacked = np.stack(candidates)
    feet = np.einsum("kti,tid->ktd", stacked, corners)
    distance = np.linalg.norm(feet - point, axis=2)
    outside = (area2 <= 0) | (weights < 0).any(axis=1)
    distance[0, outside] = np.inf
    kind, triangle = np.unravel_index(int(np.argmin(distance)), distance.shape)
    return feet[kind, triangle], int(triangle), stacked[kind, triangle]


def _dot(a: Floats, b: Floats) -> Floats:
    return np.einsum("ij,ij->i", a, b)


def _parts(
    connectivity: Indices,
    of_hexahedron: NDArray[np.int64],
    of_wedge: NDArray[np.int64],
    *,
    ordered: bool = False,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    connectivity = whole_numbers("connectivity", "node", connectivity, error=FaceError)
    wedge = is_wedge(connectivity)
    parts, owners = [], []
    for chosen, pattern in ((~wedge, of_hexahedron), (wedge, of_wedge)):
        index = np.flatnonzero(chosen)
        parts.append(connectivity[index][:, pattern].reshape(-1, pattern.shape[1]))
        owners.append(np.repeat(index, len(pattern)))
    nodes = np.concatenate(parts)
    return (np.sort(nodes, axis=1) if ordered else nodes), np.concatenate(owners)
