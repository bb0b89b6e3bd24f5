"""Relaxed skin tension lines of a face, from its muscles, and the prestretch along them."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.check import sheet_nodes
from emgface.face.parts import OUTER
from emgface.face.surface import faces_among
from sim import stretch_field

Floats = NDArray[np.float64]

REACH = 0.01  #: distance over which muscles are averaged [m]


def skin_axes(face: xr.Dataset) -> tuple[NDArray[np.int64], Floats]:
    """Axes of the skin: along the tension line, across it in the skin, and outwards.

    Relaxed skin tension lines are perpendicular to the pull of the muscles beneath (Borges 1984).
    The pull at a point is the largest principal direction, within the skin, of the fibre segments
    around it, each weighted by its length times exp(-(distance/REACH)^2 / 2).
    Returns the elements (n,) of the outer layer with a face on the skin, ascending, and their
    orthonormal axes (n, 3, 3) in the rows [1]; the sign of a tension line is arbitrary. Raises
    FaceError if the face has no skin or no fibres.
    """
    position, connectivity = face["position"].values, face["connectivity"].values
    faces, element = faces_among(connectivity, sheet_nodes(face, OUTER))
    mine = face["layer"].values[element] == OUTER
    faces, element = faces[mine], element[mine]
    segments, middle = _segments(face)
    if not len(faces) or not len(segments):
        raise FaceError(
            f"the face has {len(faces)} faces of skin and {len(segments)} fibre segments, expected both"
        )
    corners = position[faces]
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    flat = np.linalg.norm(normal, axis=1) == 0.0  # triangles repeat their last node
    normal[flat] = np.cross(
        corners[flat, 1] - corners[flat, 0], corners[flat, 2] - corners[flat, 0]
    )
    # an element with several faces on the skin has their mean normal, weighted by area
    own, row = np.unique(element, return_inverse=True)
    outward, centre, count = np.zeros((len(own), 3)), np.zeros((len(own), 3)), np.bincount(row)
    np.add.at(outward, row, normal)
    np.add.at(centre, row, corners.mean(axis=1))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    centre /= count[:, None]

    length = np.linalg.norm(segments, axis=1)
    unit = segments / length[:, None]
    away = np.linalg.norm(centre[:, None] - middle[None], axis=2)
    # relative to the nearest segment, which dominates at large distances
    weight = length * np.exp(-0.5 * (away**2 - away.min(axis=1, keepdims=True) ** 2) / REACH**2)
    pull = np.einsum("es,si,sj->eij", weight, unit, unit)
    tangent = np.eye(3) - outward[:, :, None] * outward[:, None, :]
    pull = tangent @ pull @ tangent
    across = np.linalg.eigh(pull)[1][:, :, 2]
    across -= (across * outward).sum(axis=1, keepdims=True) * outward
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(across, outward)
    return own.astype(np.int64), np.stack([along, across, outward], axis=1)


def _segments(face: xr.Dataset) -> tuple[Floats, Floats]:
    """Vectors and middles (n, 3) of all fibre segments [m]."""
    points, owner = face["fibre_position"].values, face["fibre_of_point"].values
    same = owner[1:] == owner[:-1]
    vector, middle = np.diff(points, axis=0), 0.5 * (points[1:] + points[:-1])
    same &= np.linalg.norm(vector, axis=1) > 0.0
    return vector[same], middle[same]


def skin_prestretch(face: xr.Dataset, stretches: Floats) -> Floats:
    """F0 (elements, 3, 3): the stretches along the axes of the skin, the identity elsewhere.

    `stretches` (3,) are those along the tension line, across it and through the skin [1].
    """
    F0 = np.tile(np.eye(3), (face.sizes["element"], 1, 1))
    element, axes = skin_axes(face)
    F0[element] = stretch_field(axes, stretches)
    return F0
