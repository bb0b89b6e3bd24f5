"""Distances of points, triangles and edges."""

import numpy as np

from sim._kernels import triangles as kernel
from sim.state import Array


def point_triangle(p: Array, triangle: Array) -> tuple[float, Array]:
    """Distance of a point from a triangle.

    Parameters
    ----------
    p : (3,) point [m].
    triangle : (3, 3) corners, one per row [m].

    Returns
    -------
    distance : float [m]; its derivative is (p - c)/distance by p, and minus that times the weights by
        the corners, with c the nearest point.
    weight : (3,) barycentric weights of the nearest point.
    """
    weight = np.zeros(3)
    squared, _ = kernel.point_triangle(p, triangle[0], triangle[1], triangle[2], weight)
    return float(np.sqrt(squared)), weight


def edge_edge(first: Array, second: Array) -> tuple[float, Array]:
    """Distance of two segments.

    Parameters
    ----------
    first, second : (2, 3) ends, one per row [m].

    Returns
    -------
    distance : float [m]
    share : (2,) how far along each segment the nearest points lie, 0-1.
    """
    share = np.zeros(2)
    squared = kernel.edge_edge(first[0], first[1], second[0], second[1], share)
    return float(np.sqrt(squared)), share
