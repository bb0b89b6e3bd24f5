"""Distances of points, triangles and edges."""

import numpy as np

from sim._kernels import triangles as kernel
from sim.state import Array


def point_triangle(p: Array, triangle: Array) -> tuple[float, Array]:
    """Distance [m] of a point p (3,) from a triangle (3, 3), and weights of the nearest point c.

    The derivative of the distance is (p - c)/distance by p, and minus that times the weights by the
    corners.
    """
    weight = np.zeros(3)
    squared, _ = kernel.point_triangle(p, triangle[0], triangle[1], triangle[2], weight)
    return float(np.sqrt(squared)), weight


def edge_edge(first: Array, second: Array) -> tuple[float, Array]:
    """Distance [m] of two segments (2, 3), and the fractions of the segments at the nearest points."""
    share = np.zeros(2)
    squared = kernel.edge_edge(first[0], first[1], second[0], second[1], share)
    return float(np.sqrt(squared)), share
