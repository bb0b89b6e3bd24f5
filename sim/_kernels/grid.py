"""Boxes of faces in the cells of a grid, for searches in neighbouring cells."""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

from typing import NamedTuple

import numpy as np

from sim._kernels.element import Indices, Reals
from sim._kernels.options import inner, kernel

BOX_ROUNDING = 1e-12  #: relative enlargement of boxes, to account for rounding
PER_EDGE = 4.0  #: approximate largest number of cells of a box along an axis
CELLS = 8  #: approximate largest number of cells per face


class Grid(NamedTuple):
    """Boxes and their cells."""

    #: (m, 3) corners of the boxes [m]
    low: Reals
    high: Reals
    reached: Indices  #: (m, 3) first cell of each box
    corner: Reals  #: (3,) origin of the first cell [m]
    edge: float  #: of a cell [m]
    shape: Indices  #: (3,) numbers of cells
    #: boxes of cell k are face[start[k] : start[k + 1]]
    start: Indices
    face: Indices


@inner
def cell(value, corner, edge, n):
    """Cell of a coordinate, clamped to the grid; the first cell for NaN."""
    k = (value - corner) / edge
    if not k >= 1.0:
        return 0
    return n - 1 if k >= n else int(k)


@kernel
def grid_of(x0: Reals, x1: Reals, triangles: Indices) -> Grid:
    """Grid over the boxes of the paths of triangles, m > 0, from positions x0 to x1."""
    m = len(triangles)
    low, high = np.full((m, 3), np.inf), np.full((m, 3), -np.inf)
    corner, top = np.full(3, np.inf), np.full(3, -np.inf)
    largest = 0.0
    for f in range(m):
        for k in range(3):
            a = triangles[f, k]
            for j in range(3):
                low[f, j] = min(low[f, j], min(x0[a, j], x1[a, j]))
                high[f, j] = max(high[f, j], max(x0[a, j], x1[a, j]))
        for j in range(3):
            corner[j], top[j] = min(corner[j], low[f, j]), max(top[j], high[f, j])
            largest = max(largest, max(-low[f, j], high[f, j]))
    slack = BOX_ROUNDING * largest
    mean = widest = 0.0
    for f in range(m):
        side = 0.0
        for j in range(3):
            low[f, j], high[f, j] = low[f, j] - slack, high[f, j] + slack
            side = max(side, high[f, j] - low[f, j])
        mean, widest = mean + side / m, max(widest, side)
    edge, shape = max(mean, widest / PER_EDGE), np.ones(3, np.int64)
    extent = (top[0] - corner[0]) + (top[1] - corner[1]) + (top[2] - corner[2])
    # One cell for a single point or positions that are not finite.
    if edge > 0.0 and edge < np.inf and extent >= 0.0 and extent < np.inf:
        while True:
            cells = 1.0
            for j in range(3):
                cells *= np.floor((top[j] - corner[j]) / edge) + 1.0
            if not cells > CELLS * m:
                break
            edge *= 1.25
        for j in range(3):
            shape[j] = max(int((top[j] - corner[j]) / edge) + 1, 1)
    else:
        edge = 1.0
    reached, last = np.empty((m, 3), np.int64), np.empty((m, 3), np.int64)
    start = np.zeros(shape[0] * shape[1] * shape[2] + 1, np.int64)
    face = np.empty(0, np.int64)
    for fill in (False, True):
        if fill:
            for k in range(len(start) - 1):
                start[k + 1] += start[k]
            face = np.empty(start[-1], np.int64)
        for f in range(m):
            for j in range(3):
                reached[f, j] = cell(low[f, j], corner[j], edge, shape[j])
                last[f, j] = cell(high[f, j], corner[j], edge, shape[j])
            for a in range(reached[f, 0], last[f, 0] + 1):
                for b in range(reached[f, 1], last[f, 1] + 1):
                    for c in range(reached[f, 2], last[f, 2] + 1):
                        k = (a * shape[1] + b) * shape[2] + c
                        if fill:
                            start[k] -= 1
                            face[start[k]] = f
                        else:
                            start[k] += 1
    return Grid(low, high, reached, corner, edge, shape, start, face)


@inner
def boxes_near(grid, low, high, first, last, boxes):
    """Number of boxes that intersect the box from low to high (3,); their indices in `boxes`.

    first, last: (3,) scratch arrays of cells.
    """
    n = 0
    for j in range(3):
        if high[j] < grid.corner[j] or low[j] > grid.corner[j] + grid.shape[j] * grid.edge:
            return 0
        first[j] = cell(low[j], grid.corner[j], grid.edge, grid.shape[j])
        last[j] = cell(high[j], grid.corner[j], grid.edge, grid.shape[j])
    for a in range(first[0], last[0] + 1):
        for b in range(first[1], last[1] + 1):
            for c in range(first[2], last[2] + 1):
                k = (a * grid.shape[1] + b) * grid.shape[2] + c
                for e in range(grid.start[k], grid.start[k + 1]):
                    f = grid.face[e]
                    # Each box is counted in the first cell that it has in common with the search.
                    if (
                        a == max(first[0], grid.reached[f, 0])
                        and b == max(first[1], grid.reached[f, 1])
                        and c == max(first[2], grid.reached[f, 2])
                        and not apart(low, high, grid.low[f], grid.high[f])
                    ):
                        boxes[n] = f
                        n += 1
    return n


@inner
def apart(low, high, box_low, box_high):
    """Test if two boxes are disjoint."""
    for j in range(3):
        if high[j] < box_low[j] or low[j] > box_high[j]:
            return True
    return False
