"""Chunks of neighbouring elements in two colours; chunks of one colour have no common node.

An element loop processes the chunks of one colour in parallel, and each adds to nodes and matrix
directly. Two colours require two synchronisations of the threads; a division into blocks would
require seven, which is slow if other programs run. The division depends only on the mesh, so that
the order of every sum is fixed.
"""

from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray

from sim.pattern import Index

ELEMENTS_PER_CHUNK = 96  # at least; the nodes and matrix entries of a chunk fit a cache


def levels(nodes: Index) -> Index:
    """Breadth-first distances of elements from one end of every component.

    Elements with a common node differ by one level at most.
    """
    n = len(nodes)
    owner = np.repeat(np.arange(n), nodes.shape[1])
    pairs = np.ones(nodes.size, dtype=np.int32), (owner, nodes.ravel())
    touches: Any = scipy.sparse.coo_array(pairs).tocsr()
    _, component = scipy.sparse.csgraph.connected_components(touches @ touches.T, directed=False)
    back = touches.T.tocsr()
    _, start = np.unique(component, return_index=True)
    level = np.zeros(n, dtype=np.int64)
    for _ in range(2):  # The second pass starts at the ends found in the first.
        level[:] = -1
        front: NDArray[np.int32] = np.zeros(n, dtype=np.int32)
        front[start] = 1
        step = 0
        while front.any():
            level[front > 0] = step
            reached: NDArray[np.int32] = touches @ (back @ front)
            front = ((reached > 0) & (level < 0)).astype(np.int32)
            step += 1
        order = np.lexsort((-level, component))
        start = order[np.unique(component[order], return_index=True)[1]]
    return level


def _folded(size: Index) -> Index:
    """Order that alternates between large and small, so that equal parts of it have equal cost."""
    order = np.argsort(-size, kind="stable")
    folded = np.empty_like(order)
    half = (len(order) + 1) // 2
    folded[::2], folded[1::2] = order[:half], order[half:][::-1]
    return folded


def coloured_chunks(nodes: Index) -> tuple[Index, Index, Index]:
    """Order of elements by colour and chunk, first elements of chunks and first chunks of colours."""
    level = levels(nodes)
    filled = np.bincount(level)
    chunk_of_level = np.zeros(len(filled), dtype=np.int64)
    chunk = size = 0
    for i, count in enumerate(filled):
        if size >= ELEMENTS_PER_CHUNK:
            chunk, size = chunk + 1, 0
        chunk_of_level[i] = chunk
        size += count
    chunk_of = chunk_of_level[level]
    groups = [np.flatnonzero(chunk_of == i) for i in range(chunk + 1)]
    ordered: list[Index] = []
    first_of_colour = [0]
    for colour in (groups[::2], groups[1::2]):
        if colour:
            ordered += [colour[i] for i in _folded(np.array([len(group) for group in colour]))]
            first_of_colour.append(len(ordered))
    first = np.concatenate([[0], np.cumsum([len(group) for group in ordered])])
    return np.concatenate(ordered), first.astype(np.int64), np.array(first_of_colour)
