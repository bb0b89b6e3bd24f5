"""Derivatives of the distance vectors of the pairs of a barrier."""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import numpy as np
from numpy.typing import NDArray

from sim._kernels.options import kernel
from sim._kernels.triangles import between, edge_edge, point_triangle

VERTICES, EDGE_VERTEX, EDGES, FACE_VERTEX = 0, 1, 2, 3


@kernel
def shares(
    kind: NDArray[np.int64],
    vertex: NDArray[np.int64],
    x: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Derivative of the vector between the nearest points of every pair by its vertices.

    vertex (n, 4): two vertices; a vertex and an edge; two edges; a vertex and a face. An entry of
    out (n, 4) is zero exactly if the distance does not depend on the vertex.
    """
    weight, share = np.empty(3), np.empty(2)
    for k in range(len(kind)):
        v, c = vertex[k], out[k]
        c[:] = 0.0
        if kind[k] == VERTICES:
            c[0], c[1] = 1.0, -1.0
        elif kind[k] == EDGE_VERTEX:
            s = between(x[v[0]], x[v[1]], x[v[2]])
            c[0], c[1], c[2] = 1.0, s - 1.0, -s
        elif kind[k] == EDGES:
            edge_edge(x[v[0]], x[v[1]], x[v[2]], x[v[3]], share)
            c[0], c[1], c[2], c[3] = 1.0 - share[0], share[0], share[1] - 1.0, -share[1]
        else:
            point_triangle(x[v[0]], x[v[1]], x[v[2]], x[v[3]], weight)
            c[0], c[1], c[2], c[3] = 1.0, -weight[0], -weight[1], -weight[2]
