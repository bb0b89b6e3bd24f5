"""Element types: shape functions and quadrature in natural coordinates.

Node order is that of VTK: hexahedron 0-3 counter-clockwise in the bottom face seen from the inside,
4-7 above them; wedge bottom triangle 0-2 at t = -1, top triangle 3-5 at t = +1. Quadrature:
hexahedron 2 x 2 x 2 Gauss, point k in the octant of node k; wedge three-point triangle rule times
two Gauss points, point k next to node k; tetrahedron (node 3 above the counter-clockwise triangle
0-2) its centroid, one quarter of which belongs to each node.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from sim.pattern import Array

GAUSS: Final = 1.0 / np.sqrt(3.0)


@dataclass(frozen=True)
class ElementType:
    """A reference element."""

    name: str
    n_nodes: int
    corners: Array  #: (n_nodes, 3) natural coordinates of the nodes
    #: (n_points, 3), (n_points,) quadrature
    points: Array
    weights: Array
    N: Array  #: (n_points, n_nodes) shape functions at the points
    dN: Array  #: (n_points, n_nodes, 3) their natural derivatives at the points
    dN_corners: Array  #: (n_nodes, n_nodes, 3) the same at the nodes, for checks of distortion
    #: shape functions (n, n_nodes) and natural derivatives (n, n_nodes, 3) at any points (n, 3)
    shape: Callable[[Array], tuple[Array, Array]]


Shape = Callable[[Array], tuple[Array, Array]]


def _element(name: str, corners: Array, points: Array, weights: Array, shape: Shape) -> ElementType:
    N, dN = shape(points)
    return ElementType(
        name, len(corners), corners, points, weights, N, dN, shape(corners)[1], shape
    )


def _hex_shape(corners: Array, points: Array) -> tuple[Array, Array]:
    factor = 1.0 + points[:, None, :] * corners[None, :, :]
    N = factor.prod(axis=2) / 8.0
    dN = np.empty((*N.shape, 3))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        dN[:, :, i] = corners[None, :, i] * factor[:, :, j] * factor[:, :, k] / 8.0
    return N, dN


def _wedge_shape(points: Array) -> tuple[Array, Array]:
    r, s, t = points.T
    triangle = np.stack([1.0 - r - s, r, s], axis=1)
    slope = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    N = np.concatenate([triangle * (1.0 - t)[:, None], triangle * (1.0 + t)[:, None]], axis=1) / 2.0
    dN = np.empty((len(points), 6, 3))
    for half, sign in ((slice(0, 3), -1.0), (slice(3, 6), 1.0)):
        dN[:, half, :2] = slope[None] * ((1.0 + sign * t) / 2.0)[:, None, None]
        dN[:, half, 2] = sign * triangle / 2.0
    return N, dN


def _hex8() -> ElementType:
    corners = np.array(
        [
            [-1, -1, -1],
            [1, -1, -1],
            [1, 1, -1],
            [-1, 1, -1],
            [-1, -1, 1],
            [1, -1, 1],
            [1, 1, 1],
            [-1, 1, 1],
        ],
        dtype=np.float64,
    )
    points = corners * GAUSS
    return _element("hex8", corners, points, np.ones(8), partial(_hex_shape, corners))


def _wedge6() -> ElementType:
    triangle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    inner = np.array([[1 / 6, 1 / 6], [2 / 3, 1 / 6], [1 / 6, 2 / 3]])
    corners = np.array([[*rs, t] for t in (-1.0, 1.0) for rs in triangle])
    points = np.array([[*rs, t] for t in (-GAUSS, GAUSS) for rs in inner])
    return _element("wedge6", corners, points, np.full(6, 1 / 6), _wedge_shape)


def _tet_shape(points: Array) -> tuple[Array, Array]:
    N = np.concatenate([1.0 - points.sum(axis=1, keepdims=True), points], axis=1)
    slope = np.concatenate([np.full((1, 3), -1.0), np.eye(3)])
    return N, np.repeat(slope[None], len(points), axis=0)


def _tet4() -> ElementType:
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    return _element("tet4", corners, np.full((1, 3), 0.25), np.full(1, 1 / 6), _tet_shape)


HEX8: Final = _hex8()
WEDGE6: Final = _wedge6()
TET4: Final = _tet4()
ELEMENT_TYPES: Final = {kind.name: kind for kind in (HEX8, WEDGE6, TET4)}
"""All element types, which the tests include."""
