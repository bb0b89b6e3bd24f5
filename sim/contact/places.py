"""Assembly of contact stiffness, also for pairs outside the pattern."""

import numpy as np

from sim.contact.curvature import NormalStiffness
from sim.contact.ipc import Hessian
from sim.pattern import SymmetricPattern
from sim.scene import Index
from sim.state import Array


class VertexPlaces:
    """Assembler of stiffness over vertices into the values of a pattern.

    A coupling of two nodes that the pattern does not contain is replaced by an upper bound on the
    diagonal blocks, which slows down the iteration without affecting its result. `free` (3 n_nodes,) is
    True for free unknowns.
    """

    def __init__(self, pattern: SymmetricPattern) -> None:
        self._pattern = pattern
        self._diagonal = np.full(3 * pattern.n_nodes, -1)
        self._diagonal[pattern.free] = pattern.diagonal
        self.free = self._diagonal >= 0

    def add_normal(self, node: Index, stiffness: NormalStiffness, K: Array) -> None:
        """Add the stiffness of normal forces; vertex i is node[i], or fixed if that is -1."""
        at = node[stiffness.vertex]
        pair = np.broadcast_to(at[:, :, None], (len(at), 4, 4)), at[:, None, :]
        counts = (stiffness.share != 0.0) & (at >= 0)
        needed = counts[:, :, None] & counts[:, None, :]
        placed = (~needed | self._known(*pair)).all(axis=(1, 2))
        unknown = 3 * at[:, :, None] + np.arange(3)
        unknown[at < 0] = -1
        shape = (len(at), 4, 3, 4, 3)
        row = np.broadcast_to(unknown[:, :, :, None, None], shape)[placed]
        column = np.broadcast_to(unknown[:, None, None, :, :], shape)[placed]
        self._add(row.ravel(), column.ravel(), stiffness.blocks()[placed].ravel(), K)
        if not placed.all():
            shape = (len(at), 4, 3, 3)
            row = np.broadcast_to(unknown[:, :, :, None], shape)[~placed]
            column = np.broadcast_to(unknown[:, :, None, :], shape)[~placed]
            self._add(row.ravel(), column.ravel(), stiffness.own_blocks()[~placed].ravel(), K)

    def add(self, node: Index, H: Hessian, K: Array) -> None:
        """Add a positive semi-definite matrix; vertex i is node[i], or fixed if that is -1."""
        row, column = (3 * node[part // 3] + part % 3 for part in (H.row, H.column))
        fixed = (node[H.row // 3] < 0) | (node[H.column // 3] < 0)
        known = fixed | self._known(row // 3, column // 3)
        kept = known & ~fixed
        self._add(row[kept], column[kept], H.value[kept], K)
        # [[|e|, -e], [-e, |e|]] is positive semi-definite; adding it removes e.
        own, size = row[~known], np.abs(H.value[~known])
        place = self._diagonal[own]
        np.add.at(K, place[place >= 0], size[place >= 0])

    def _known(self, a: Index, b: Index) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Test if the pattern couples nodes a and b."""
        keys = np.minimum(a, b) * self._pattern.n_nodes + np.maximum(a, b)
        pairs = self._pattern.pairs
        return pairs[np.minimum(np.searchsorted(pairs, keys), len(pairs) - 1)] == keys

    def _add(self, row: Index, column: Index, value: Array, K: Array) -> None:
        """Add entries between unknowns that the pattern couples; -1 for none."""
        upper = (row >= 0) & (column >= row)
        row, column, value = row[upper], column[upper], value[upper]
        keys = row // 3 * self._pattern.n_nodes + column // 3
        target = self._pattern.target[self._pattern.pair_index(keys), 3 * (row % 3) + column % 3]
        stored = target >= 0
        np.add.at(K, target[stored], value[stored])
