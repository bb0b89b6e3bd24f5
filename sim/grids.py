"""Structured grids of hexahedra, for test bodies, benchmarks and first scenes."""

import numpy as np

from sim.elements import ELEMENT_TYPES
from sim.mesh import Array, Index, Mesh, mesh_from_arrays


def grid_cells(n: tuple[int, int, int]) -> Index:
    """Hexahedra (n_cells, 8) in VTK order of a structured grid with n (3,) cells along each axis.

    Nodes and cells are numbered with the last axis fastest.
    """
    nx, ny, nz = n
    index = np.arange((nx + 1) * (ny + 1) * (nz + 1)).reshape(nx + 1, ny + 1, nz + 1)
    offsets = (ELEMENT_TYPES["hex8"].corners > 0.0).astype(np.int64)
    corners = [index[a : nx + a, b : ny + b, c : nz + c].ravel() for a, b, c in offsets]
    return np.stack(corners, axis=1)


def grid_mesh(X: Array) -> Mesh:
    """Mesh of hexahedra between structured nodes X (n_x + 1, n_y + 1, n_z + 1, 3) [m], right-handed."""
    nx, ny, nz = X.shape[:3]
    return mesh_from_arrays(X.reshape(-1, 3), hex8=grid_cells((nx - 1, ny - 1, nz - 1)))
