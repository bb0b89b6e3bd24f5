"""Fraction of each element within a distance from muscle fibres.

With membership by the centre of an element, a muscle gains or loses whole rows of elements as the
mesh is refined. The sum of fraction times volume, in contrast, equals that of the tube at any
resolution.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.bundles import distance_to_fibres
from sim.elements import HEX8

Floats = NDArray[np.float64]

SAMPLING_DISTANCE: Final = 1e-3  #: desired distance between the sampling points in an element [m]
_MOST: Final = 10  #: largest number of sampling points along an edge


def shares_within(
    position: Floats,
    connectivity: NDArray[np.integer],
    fibres: Sequence[Floats],
    radius: float,
    *,
    spacing: float = SAMPLING_DISTANCE,
) -> Floats:
    """Fraction (elements,) of the volume of each hexahedron within a radius [m] of a fibre.

    The element is divided into cells of about `spacing` [m], equal in natural coordinates and
    weighted by det J at their centres. A cell of edge c with its centre at the distance d has the
    fraction clip(1/2 + (radius - d) / c, 0, 1), which is exact for a plane boundary parallel to a
    face. Raises FaceError unless radius and spacing are positive, or as
    `emgface.face.bundles.segments`.
    """
    if not radius > 0:
        raise FaceError(f"the muscle radius is {radius} m, expected a positive length")
    if not spacing > 0:
        raise FaceError(f"the spacing of the samples is {spacing} m, expected a positive length")
    share = np.zeros(len(connectivity))
    corners = position[np.asarray(connectivity)]
    centre = corners.mean(axis=1)
    reach = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
    near = np.flatnonzero(distance_to_fibres(centre, fibres) < radius + reach)
    if len(near) == 0:
        return share
    corners = corners[near]
    points, n_cells = _cells(corners, spacing)
    factor = 1.0 + points[:, None, :] * HEX8.corners[None, :, :]
    shape = factor.prod(axis=2) / 8.0
    slope = np.stack(
        [
            HEX8.corners[None, :, i] * factor[..., (i + 1) % 3] * factor[..., (i + 2) % 3] / 8.0
            for i in range(3)
        ],
        axis=2,
    )
    at = np.einsum("pn,eni->epi", shape, corners)
    a, b, c = np.einsum("eni,pnj->ijep", corners, slope)
    determinant = (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    volume = determinant * 8.0 / n_cells
    edge = np.cbrt(np.abs(volume))
    distance = distance_to_fibres(at.reshape(-1, 3), fibres).reshape(volume.shape)
    inside = np.clip(0.5 + (radius - distance) / edge, 0.0, 1.0)
    share[near] = (inside * volume).sum(axis=1) / volume.sum(axis=1)
    return share


def _cells(corners: Floats, spacing: float) -> tuple[Floats, int]:
    """Natural coordinates (cells, 3) of the centres of equal cells, and their number."""
    # Mean length of the four edges along each natural direction; maximum over the elements.
    pairs = (((0, 1), (3, 2), (4, 5), (7, 6)), ((0, 3), (1, 2), (4, 7), (5, 6)))
    pairs = (*pairs, ((0, 4), (1, 5), (2, 6), (3, 7)))
    along: list[Floats] = []
    for edges in pairs:
        length = np.mean(
            [np.linalg.norm(corners[:, b] - corners[:, a], axis=1) for a, b in edges], axis=0
        )
        n = int(np.clip(np.ceil(length.max() / spacing), 2, _MOST))
        along.append((2.0 * np.arange(n) + 1.0) / n - 1.0)
    points = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, 3)
    return points, len(points)
