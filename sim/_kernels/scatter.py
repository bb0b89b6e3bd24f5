"""Assembly of element sums into nodal forces and matrix values.

A `Part` of the elements is divided into chunks of neighbours in colours: chunks of one colour have
no common node. The colours are processed one after the other, the chunks of one in parallel, and
each adds to the nodes and the matrix directly, so that the order of every sum does not depend on
the number of threads.
"""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# numba compiles these functions; those called from Python carry types

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim._kernels.element import NODES
from sim._kernels.lanes import fetch
from sim._kernels.options import inner

PAIRS = 36  # (a, b) with a <= b, row by row


class Places(NamedTuple):
    """Positions of the element blocks of a part in the values of the matrix."""

    order: NDArray[np.int8]  #: (n, 8) slots by ascending node, unused ones last
    #: (n, 36, 3) for the pairs of slots in this order, the position at which row i of the block would
    #: begin with an entry in each column; negative if the pair is not stored
    start: NDArray[np.int32]
    #: (n,) row of target for elements with a node that is free in some directions only, or with a node
    #: in two slots; else -1
    special: NDArray[np.int32]
    #: (m, 36, 9) position of every entry of their blocks, negative if it is not stored
    target: NDArray[np.int32]


@inner
def subtract_from_nodes(w, row, nodes, e, f):
    """f[node, i] -= w[row + i, slot] of all slots; unused ones contain zero."""
    for a in range(NODES):
        for i in range(3):
            f[nodes[e, a], i] -= w[row + i, a]


@inner
def add_to_matrix(w, K, nodes, places, e, values):
    """Add the six blocks in rows K to the upper triangle of the matrix."""
    if places.special[e] >= 0:
        _add_some(w, K, nodes, places.order, e, places.target, places.special[e], values)
        return
    order, start = places.order, places.start
    p = 0
    for i in range(NODES):
        a = order[e, i]
        s, t, u = start[e, p, 0], start[e, p, 1], start[e, p, 2]
        if s >= 0:
            values[s] += w[K + a, a]
            values[s + 1] += w[K + 8 + a, a]
            values[s + 2] += w[K + 16 + a, a]
            values[t + 1] += w[K + 24 + a, a]
            values[t + 2] += w[K + 32 + a, a]
            values[u + 2] += w[K + 40 + a, a]
        p += 1
        for j in range(i + 1, NODES):
            b = order[e, j]
            s, t, u = start[e, p, 0], start[e, p, 1], start[e, p, 2]
            if s >= 0:
                values[s] += w[K + a, b]
                values[s + 1] += w[K + 8 + a, b]
                values[s + 2] += w[K + 16 + a, b]
                values[t] += w[K + 8 + b, a]
                values[t + 1] += w[K + 24 + a, b]
                values[t + 2] += w[K + 32 + a, b]
                values[u] += w[K + 16 + b, a]
                values[u + 1] += w[K + 32 + b, a]
                values[u + 2] += w[K + 40 + a, b]
            p += 1


@inner
def fetch_matrix(places, e, values):
    """Prefetch the cache lines that `add_to_matrix` will modify."""
    for p in range(PAIRS):
        if places.start[e, p, 0] >= 0:
            for i in range(3):
                fetch(values, places.start[e, p, i])


@inner
def _add_some(w, K, nodes, order, e, target, row, values):
    """Add the stored entries of the blocks."""
    p = 0
    for n in range(NODES):
        for m in range(n, NODES):
            a, b = order[e, n], order[e, m]
            twice = n < m and nodes[e, a] == nodes[e, b]  # The pair also represents (b, a).
            block = K
            for i in range(3):
                for j in range(i, 3):
                    above, below = target[row, p, 3 * i + j], target[row, p, 3 * j + i]
                    if above >= 0:
                        values[above] += w[block + a, b]
                    if above >= 0 and twice:
                        values[above] += w[block + b, a]
                    if i < j and below >= 0:
                        values[below] += w[block + b, a]
                    block += NODES
            p += 1
