"""Chunks of neighbouring elements, and colours of chunks without a common node.

An element loop runs the chunks of one colour in parallel, and each adds to nodes and matrix directly.
The division depends on the mesh alone, hence the order of every sum does, too.
"""

import numpy as np
import scipy.sparse

from sim.scene import Index
from sim.state import Array

ELEMENTS_PER_CHUNK = (
    96  # what a chunk adds to fits a cache; there are chunks enough for the threads
)


def bisected(points: Array, size: int) -> list[Index]:
    """Divide points (n, 3) at the median of their longest extent until no group exceeds the size."""
    groups = [np.arange(len(points))]
    while len(groups[0]) > size:
        halves: list[Index] = []
        for group in groups:
            own = points[group]
            along = own[:, np.argmax(np.ptp(own, axis=0))]
            order = group[np.argsort(along, kind="stable")]
            middle = (len(order) + 1) // 2  # the first group stays the largest
            halves += [np.sort(order[:middle]), np.sort(order[middle:])]
        groups = halves
    return groups


def colours(groups: list[Index], nodes: Index) -> Index:
    """Smallest colour of every group, in their order, that no earlier group with a common node has."""
    owner = np.repeat(np.arange(len(groups)), [nodes[group].size for group in groups])
    node = np.concatenate([nodes[group].ravel() for group in groups])
    touches = scipy.sparse.coo_array((np.ones(len(node)), (owner, node))).tocsr()
    neighbours = (touches @ touches.T).tocsr()
    found = np.full(len(groups), -1, dtype=np.int64)
    for i in range(len(groups)):
        near = neighbours.indices[neighbours.indptr[i] : neighbours.indptr[i + 1]]
        taken = found[near]
        found[i] = np.setdiff1d(np.arange(len(near) + 1), taken)[0]
    return found


def coloured_chunks(centre: Array, nodes: Index) -> tuple[Index, Index, Index]:
    """Order of elements by colour and chunk, first element of every chunk, first chunk of every colour.

    Parameters
    ----------
    centre : (n, 3) a point of every element.
    nodes : (n, k) their nodes.
    """
    groups = bisected(centre, ELEMENTS_PER_CHUNK)
    colour = colours(groups, nodes)
    by_colour: list[Index] = [groups[i] for i in np.argsort(colour, kind="stable")]
    chunk = np.concatenate([[0], np.cumsum([len(group) for group in by_colour])])
    start = np.concatenate([[0], np.cumsum(np.bincount(colour))])
    return np.concatenate(by_colour), chunk.astype(np.int64), start.astype(np.int64)
