"""Muscle elements of fibres: membership by radius, directions by interpolation.

A fibre is a polyline of points (k, 3) [m]. An element belongs to a muscle if its centre (the mean
of its nodes at rest) is nearer than a radius to one of the muscle's segments. Its direction
interpolates the unit vectors of the segments from their midpoints.

Source: the muscle bundles of the reference face used by Eskes et al. 2017 (radius 5 mm), as
computed by ArtiSynth.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, Delaunay

from emgface.errors import FaceError
from emgface.face.surface import (
    boundary_faces,
    nearest_on_triangles,
    triangles,
    winding_number,
)

Floats = NDArray[np.float64]

FLAT_EXTENT = 1e-6
"""Relative extent across a line or plane below which points are regarded as lying in it."""


def segments(fibres: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Start and end of every segment of the fibres, each of shape (n, 3).

    Raises FaceError if a fibre has fewer than two points, or two consecutive points coincide.
    """
    for k, fibre in enumerate(fibres):
        if len(fibre) < 2:
            raise FaceError(f"fibre {k} has {len(fibre)} point(s), expected at least 2")
        length = np.linalg.norm(np.diff(fibre, axis=0), axis=1)
        if not (length > 0).all():
            raise FaceError(
                f"fibre {k} has coinciding points {int(np.argmin(length))} and "
                f"{int(np.argmin(length)) + 1}, expected segments of positive length"
            )
    if not fibres:
        return np.empty((0, 3)), np.empty((0, 3))
    return (
        np.concatenate([fibre[:-1] for fibre in fibres]),
        np.concatenate([fibre[1:] for fibre in fibres]),
    )


def distance_to_fibres(points: Floats, fibres: Sequence[Floats]) -> Floats:
    """Distance of each point to the nearest segment, clamped at its ends, shape (n,) [m]."""
    start, end = segments(fibres)
    if len(start) == 0:
        return np.full(len(points), np.inf)
    nearest = np.full(len(points), np.inf)
    columns = np.ascontiguousarray(points.T)
    for origin, along in zip(start, end - start, strict=True):
        gap = columns - origin[:, None]
        t = sum(gap[i] * along[i] for i in range(3)) / np.dot(along, along)
        gap -= np.clip(t, 0.0, 1.0) * along[:, None]
        np.minimum(nearest, sum(gap[i] ** 2 for i in range(3)), out=nearest)
    return np.sqrt(nearest)


def elements_within(centres: Floats, fibres: Sequence[Floats], radius: float) -> NDArray[np.int64]:
    """Return the elements whose centre is nearer than `radius` [m] to a fibre.

    Raises FaceError unless the radius is positive.
    """
    if not radius > 0:
        raise FaceError(f"the muscle radius is {radius} m, expected a positive length")
    return np.flatnonzero(distance_to_fibres(centres, fibres) < radius)


def fibre_directions(points: Floats, fibres: Sequence[Floats]) -> Floats:
    """Return the unit fibre direction (n, 3) at points (n, 3) [m]; its sign is arbitrary.

    The unit vectors d_i of the segments are placed at the segment midpoints and interpolated
    linearly in the Delaunay tetrahedralisation of the midpoints; for a point outside the hull, the
    nearest point of the hull is used. The sum of w_i d_i is formed in the order of decreasing
    weight, with the sign of each vector chosen along the partial sum. Midpoints in one plane or on
    one line are triangulated there. Raises FaceError if there is no fibre, or a segment has no
    length.
    """
    start, end = segments(fibres)
    if len(start) == 0:
        raise FaceError(
            "no fibre from which directions could be derived: expected at least one segment"
        )
    vectors = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    node, weight = interpolation_weights(points, (start + end) / 2.0)
    return _sum_with_flips(vectors[node], weight)


def symmetric_directions(points: Floats, fibres: Sequence[Floats]) -> Floats:
    """Symmetric `fibre_directions` for fibres that are mirror images in x = 0.

    Groups of four mirrored midpoints lie on circles, where the tetrahedralisation is not unique;
    directions are therefore computed on the side x <= 0 and mirrored to the other.
    """
    mirror = np.where(points[:, :1] > 0.0, [[-1.0, 1.0, 1.0]], [[1.0, 1.0, 1.0]])
    return fibre_directions(points * mirror, fibres) * mirror


def interpolation_weights(points: Floats, sites: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Sites and weights (n, k) of the linear Delaunay interpolation, clamped to the hull.

    There is at least one of the `sites` (m, 3); they may lie in a plane, on a line or at a point,
    and k is their dimension + 1. Weights are not negative, and each row sums to 1.
    """
    centre = sites.mean(axis=0)
    _, extent, axes = np.linalg.svd(sites - centre, full_matrices=False)
    size = float(extent[0]) if len(extent) else 0.0
    dimension = int(np.sum(extent > FLAT_EXTENT * size)) if size > 0 else 0
    # Sites in a plane or on a line are interpolated there, with points projected onto it.
    flat_sites = (sites - centre) @ axes[:dimension].T
    flat_points = (points - centre) @ axes[:dimension].T
    if dimension == 0:
        return np.zeros((len(points), 1), dtype=np.int64), np.ones((len(points), 1))
    if dimension == 1:
        return _on_line(flat_points[:, 0], flat_sites[:, 0])
    return _in_hull(flat_points, flat_sites)


def project_into_mesh(
    points: Floats, position: Floats, connectivity: NDArray[np.integer]
) -> tuple[Floats, NDArray[np.bool_]]:
    """Move points (n, 3) [m] outside the mesh to the nearest point of its surface.

    Returns the points and a mask of those that were outside.
    """
    faces, _ = boundary_faces(connectivity)
    corners = position[triangles(faces, position)]
    outside = winding_number(points, corners) < 0.5
    projected = points.copy()
    for k in np.flatnonzero(outside):
        projected[k] = nearest_on_triangles(points[k], corners)[0]
    return projected, outside


def _on_line(points: Floats, sites: Floats) -> tuple[NDArray[np.int64], Floats]:
    order = np.argsort(sites, kind="stable")
    ordered = sites[order]
    clamped = np.clip(points, ordered[0], ordered[-1])
    right = np.clip(np.searchsorted(ordered, clamped), 1, len(sites) - 1)
    length = ordered[right] - ordered[right - 1]
    t = np.where(length > 0, (clamped - ordered[right - 1]) / np.where(length > 0, length, 1.0), 0)
    return np.stack([order[right - 1], order[right]], axis=1), np.stack([1.0 - t, t], axis=1)


def _in_hull(points: Floats, sites: Floats) -> tuple[NDArray[np.int64], Floats]:
    dimension = sites.shape[1]
    mesh = Delaunay(sites)
    simplex = mesh.find_simplex(points)
    site = np.zeros((len(points), dimension + 1), dtype=np.int64)
    weight = np.zeros((len(points), dimension + 1))
    inside = np.flatnonzero(simplex >= 0)
    affine = mesh.transform[simplex[inside]]
    local = np.einsum("nij,nj->ni", affine[:, :dimension], points[inside] - affine[:, dimension])
    site[inside] = mesh.simplices[simplex[inside]]
    weight[inside] = np.column_stack([local, 1.0 - local.sum(axis=1)])
    hull = ConvexHull(sites).simplices
    facets = sites[hull]
    for k in np.flatnonzero(simplex < 0):
        if dimension == 3:
            _, facet, shares = nearest_on_triangles(points[k], facets)
        else:
            facet, shares = _nearest_on_edges(points[k], facets)
        site[k, :dimension] = hull[facet]
        weight[k, :dimension] = shares
    weight = np.clip(weight, 0.0, None)
    return site, weight / weight.sum(axis=1, keepdims=True)


def _nearest_on_edges(point: Floats, edges: Floats) -> tuple[int, Floats]:
    along = edges[:, 1] - edges[:, 0]
    t = np.einsum("ij,ij->i", point - edges[:, 0], along) / np.einsum("ij,ij->i", along, along)
    t = np.clip(t, 0.0, 1.0)
    distance = np.linalg.norm(edges[:, 0] + t[:, None] * along - point, axis=1)
    nearest = int(np.argmin(distance))
    return nearest, np.array([1.0 - t[nearest], t[nearest]])


def _sum_with_flips(vectors: Floats, weight: Floats) -> Floats:
    order = np.argsort(-weight, axis=1, kind="stable")
    weight = np.take_along_axis(weight, order, axis=1)
    vectors = np.take_along_axis(vectors, order[..., None], axis=1)
    total = weight[:, 0, None] * vectors[:, 0]
    for k in range(1, vectors.shape[1]):
        opposed = np.einsum("ni,ni->n", total, vectors[:, k]) < 0.0
        total += np.where(opposed, -1.0, 1.0)[:, None] * weight[:, k, None] * vectors[:, k]
    return total / np.linalg.norm(total, axis=1)[:, None]
