"""Surfaces with fewer vertices, to be drawn."""

import numpy as np
from numpy.typing import NDArray

from emgface.anatomy.jaw.model import Floats

CELL = 2.5e-3
"""Edge of the cells whose vertices are merged [m]."""


def thinned(X: Floats, triangles: NDArray[np.integer]) -> tuple[Floats, NDArray[np.int64]]:
    """Merge the vertices (n, 3) [m] of every cell of a grid into their mean.

    Source: Rossignac and Borrel 1993, Multi-resolution 3D approximations for rendering complex scenes.
    """
    _, own = np.unique(np.floor(X / CELL).astype(np.int64), axis=0, return_inverse=True)
    own = own.ravel()
    count = np.bincount(own)
    merged = np.column_stack([np.bincount(own, X[:, i]) / count for i in range(3)])
    corners = own[triangles]
    a, b, c = corners.T
    kept = corners[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(kept, axis=1), axis=0, return_index=True)
    return merged.astype(np.float64), kept[np.sort(first)].astype(np.int64)
