"""Ordered sums from elements to nodes and matrix entries, and the symmetric product.

Elements write into their own places in parallel; each sum below runs in a fixed order, so results do
not depend on the number of threads.
"""

import numba as nb
import numpy as np

from sim._kernels.laws import FLAGS


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
def add_to_nodes(element_force, start, element, slot, sign, out):
    """out[node, i] += sign * sum of element_force[e, i, a] over the (e, a) at this node."""
    for node in nb.prange(start.size - 1):
        for i in range(3):
            s = 0.0
            for k in range(start[node], start[node + 1]):
                s += element_force[element[k], i, slot[k]]
            out[node, i] += sign * s


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
def add_to_matrix(element_tangent, start, element, pair, transposed, target, out):
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
def symmetric_product(indptr, indices, values, x, out):
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
