"""Ordered sums from elements to nodes and matrix entries, and the symmetric product.

Elements write into their own places in parallel; each sum below runs in a fixed order, so results do
not depend on the number of threads.
"""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import numba as nb
import numpy as np
from numpy.typing import NDArray

from sim._kernels.laws import FLAGS

Reals = NDArray[np.float64]
Indices = NDArray[np.int64]


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
def add_to_nodes(
    element_force: Reals, start: Indices, element: Indices, slot: Indices, sign: float, out: Reals
) -> None:
    """out[node, i] += sign * sum of element_force[e, i, a] over the (e, a) at this node."""
    for node in nb.prange(start.size - 1):
        for i in range(3):
            s = 0.0
            for k in range(start[node], start[node + 1]):
                s += element_force[element[k], i, slot[k]]
            out[node, i] += sign * s


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
def add_to_matrix(
    element_tangent: Reals,
    start: Indices,
    element: Indices,
    pair: Indices,
    transposed: NDArray[np.bool_],
    target: NDArray[np.int32],
    out: Reals,
) -> None:
    """Sum the 3 x 3 blocks of every node pair into the values of the sparse matrix.

    Block p is the sum over k in start[p]..start[p + 1] of element_tangent[element[k], pair[k]], each
    transposed where the element lists the two nodes in the other order; entry (i, j) of the block
    goes to out[target[p, 3 i + j]], or nowhere where the target is negative.
    """
    for p in nb.prange(start.size - 1):
        s = np.zeros(9)
        for k in range(start[p], start[p + 1]):
            e, n = element[k], pair[k]
            if transposed[k]:
                for i in range(3):
                    for j in range(3):
                        s[3 * i + j] += element_tangent[e, n, 3 * j + i]
            else:
                for i in range(9):
                    s[i] += element_tangent[e, n, i]
        for i in range(9):
            where = target[p, i]
            if where >= 0:
                out[where] += s[i]


@nb.njit(cache=True, error_model="numpy", fastmath=FLAGS)
def symmetric_product(
    indptr: NDArray[np.int32], indices: NDArray[np.int32], values: Reals, x: Reals, out: Reals
) -> None:
    """Out = A x for a symmetric A of which the rows hold the upper triangle, diagonal first."""
    out[:] = 0.0
    for i in range(indptr.size - 1):
        first = indptr[i]
        s = values[first] * x[i]
        xi = x[i]
        for k in range(first + 1, indptr[i + 1]):
            j = indices[k]
            s += values[k] * x[j]
            out[j] += values[k] * xi
        out[i] += s
