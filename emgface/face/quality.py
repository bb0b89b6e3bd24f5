"""Geometry of hexahedra and wedges at rest: Jacobians, volumes, element quality.

Elements are rows of 8 node indices in VTK order; the last two of a wedge are -1.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.elements import HEX8, WEDGE6, ElementType

Floats = NDArray[np.float64]
Indices = NDArray[np.integer]


@dataclass(frozen=True)
class ElementQuality:
    """Measures of every element, each of shape (elements,).

    `volume` is the integral of det J over the quadrature points [m3], `smallest_det` the smallest
    det J over quadrature points and corners [m3 per unit of natural volume], `smallest_det_inside` that
    over quadrature points alone, and `scaled_jacobian`
    the smallest scaled Jacobian [1].
    """

    volume: Floats
    smallest_det: Floats
    smallest_det_inside: Floats
    scaled_jacobian: Floats


def is_wedge(connectivity: Indices) -> NDArray[np.bool_]:
    """Mask of the wedges, shape (elements,)."""
    return np.asarray(connectivity)[:, 6] < 0


def element_centres(position: Floats, connectivity: Indices) -> Floats:
    """Mean of the 8 or 6 nodes of each element, shape (elements, 3) [m]."""
    used = connectivity >= 0
    corners = position[np.where(used, connectivity, 0)] * used[..., None]
    return corners.sum(axis=1) / used.sum(axis=1)[:, None]


def element_quality(position: Floats, connectivity: Indices) -> ElementQuality:
    """Volume, smallest Jacobian determinant and smallest scaled Jacobian of every element.

    The scaled Jacobian is det J over the product of the lengths of its columns, smallest over the
    corners (and the centre of a hexahedron); a cube has 1, and wedges are scaled by 2/sqrt(3) so
    that a prism on an equilateral triangle has 1. `position` (nodes, 3) is in [m].
    """
    connectivity = np.asarray(connectivity)
    n = len(connectivity)
    result = ElementQuality(np.empty(n), np.empty(n), np.empty(n), np.empty(n))
    wedge = is_wedge(connectivity)
    # Natural derivatives are bilinear; their mean over the corners is the value at the centre.
    centre = HEX8.dN_corners.mean(axis=0, keepdims=True)
    _fill(result, ~wedge, position, connectivity, HEX8, np.concatenate([HEX8.dN_corners, centre]))
    _fill(result, wedge, position, connectivity, WEDGE6, WEDGE6.dN_corners, 2.0 / np.sqrt(3.0))
    return result


def _fill(
    result: ElementQuality,
    chosen: NDArray[np.bool_],
    position: Floats,
    connectivity: Indices,
    kind: ElementType,
    at_corners: Floats,
    ideal: float = 1.0,
) -> None:
    """Compute the values of one element type."""
    corners = position[connectivity[chosen, : kind.n_nodes]]
    gauss = np.linalg.det(np.einsum("eni,pnj->epij", corners, kind.dN))
    jacobian = np.einsum("eni,pnj->epij", corners, at_corners)
    det = np.linalg.det(jacobian)
    lengths = np.prod(np.linalg.norm(jacobian, axis=2), axis=2)
    scaled = det / np.where(lengths > 0.0, lengths, np.inf)
    result.volume[chosen] = gauss @ kind.weights
    result.smallest_det[chosen] = np.minimum(gauss.min(axis=1), det.min(axis=1))
    result.smallest_det_inside[chosen] = gauss.min(axis=1)
    result.scaled_jacobian[chosen] = ideal * scaled.min(axis=1)
