"""From elements to nodes and to the matrix: slots, gradients at rest and the ordered sums.

Terms on element blocks share this layout. Every element has `NODES` slots; a slot that an element type
does not use repeats the first node with zero gradients and takes part in no sum.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim._kernels import scatter
from sim._kernels.solid import NODES, PAIRS
from sim.mesh import Mesh
from sim.pattern import SymmetricPattern
from sim.state import Array

Index = NDArray[np.int64]

_A, _B = np.triu_indices(NODES)  # slots of the stored node pairs, row by row


@dataclass(frozen=True, eq=False)
class BlockLayout:
    """Elements of one type, laid out for the kernels.

    Attributes
    ----------
    rows : slice
        Their places among all elements.
    nodes : (n, NODES) node of every slot.
    gradient : (n, n_points, 3, NODES) material gradients [1/m].
    volume : (n, n_points) rest volume of every quadrature point [m^3].
    """

    rows: slice
    nodes: Index
    gradient: Array
    volume: Array


def slots(mesh: Mesh, elements: Index | None = None) -> tuple[Index, NDArray[np.bool_]]:
    """Node of every slot (n_elements, NODES), and which slots are used; of all elements or of some."""
    nodes = np.empty((mesh.n_elements, NODES), dtype=np.int64)
    used = np.zeros_like(nodes, dtype=bool)
    first = 0
    for block in mesh.blocks:
        n, k = block.nodes.shape
        nodes[first : first + n] = block.nodes[:, :1]
        nodes[first : first + n, :k] = block.nodes
        used[first : first + n, :k] = True
        first += n
    return (nodes, used) if elements is None else (nodes[elements], used[elements])


def block_layouts(mesh: Mesh, elements: Index | None = None) -> tuple[BlockLayout, ...]:
    """Lay out every block of a mesh, or of some of its elements, which must ascend."""
    nodes, _ = slots(mesh, elements)
    layouts: list[BlockLayout] = []
    first = passed = 0
    for whole in mesh.blocks:
        block = whole
        if elements is not None:
            own = elements[(elements >= passed) & (elements < passed + len(whole.nodes))] - passed
            block = replace(whole, nodes=whole.nodes[own])
        passed += len(whole.nodes)
        gradient, det = block.gradients(mesh.X)
        padded = np.zeros((*det.shape, 3, NODES))
        padded[..., : block.kind.n_nodes] = gradient.transpose(0, 1, 3, 2)
        rows = slice(first, first + len(det))
        volume = np.ascontiguousarray(det * block.kind.weights)
        layouts.append(BlockLayout(rows, np.ascontiguousarray(nodes[rows]), padded, volume))
        first += len(det)
    return tuple(layouts)


def element_pair_keys(mesh: Mesh) -> Index:
    """All node pairs within an element, as ``a * n_nodes + b`` with a <= b."""
    nodes, used = slots(mesh)
    a, b = nodes[:, _A], nodes[:, _B]
    keys = np.minimum(a, b) * mesh.n_nodes + np.maximum(a, b)
    return np.unique(keys[used[:, _A] & used[:, _B]])


def grouped(keys: Index, n_groups: int) -> tuple[Index, Index]:
    """Stable order that groups keys 0..n_groups-1, and the start of every group."""
    order = np.argsort(keys, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(keys, minlength=n_groups))])
    return order.astype(np.int64), start.astype(np.int64)


class NodeSum:
    """Sum of contributions (n_elements, 3, NODES) of all or some elements at the nodes, in order."""

    def __init__(self, mesh: Mesh, elements: Index | None = None) -> None:
        nodes, used = slots(mesh, elements)
        element, slot = np.nonzero(used)
        order, self._start = grouped(nodes[element, slot], mesh.n_nodes)
        self._element, self._slot = element[order], slot[order]

    def add(self, element_force: Array, sign: float, f: Array) -> None:
        """Add sign times the sum of the contributions to f (n_nodes, 3)."""
        scatter.add_to_nodes(element_force, self._start, self._element, self._slot, sign, f)


class MatrixSum:
    """Sum of blocks (n_elements, PAIRS, 9) of all or some elements into the values of the pattern."""

    def __init__(
        self, mesh: Mesh, pattern: SymmetricPattern, elements: Index | None = None
    ) -> None:
        nodes, used = slots(mesh, elements)
        a, b = nodes[:, _A], nodes[:, _B]
        element, pair = np.nonzero(used[:, _A] & used[:, _B])
        keys = np.minimum(a, b) * mesh.n_nodes + np.maximum(a, b)
        own, group = np.unique(keys[element, pair], return_inverse=True)
        order, self._start = grouped(group.astype(np.int64), len(own))
        self._element, self._pair = element[order], pair[order]
        self._transposed = (a > b)[self._element, self._pair]
        self._target = np.ascontiguousarray(pattern.target[pattern.pair_index(own)])
        self.shape = (len(nodes), PAIRS, 9)

    def add(self, element_tangent: Array, K: Array) -> None:
        """K += sum of the blocks."""
        scatter.add_to_matrix(
            element_tangent,
            self._start,
            self._element,
            self._pair,
            self._transposed,
            self._target,
            K,
        )


def prestretched(blocks: tuple[BlockLayout, ...], F0: Array) -> tuple[BlockLayout, ...]:
    """Refer blocks to the state free of stress, from which F0 (n_elements, 3, 3) leads to the mesh.

    With F = sum_a x_a g_a' of the mesh the whole deformation is F F0 = sum_a x_a (F0' g_a)', and the
    volume free of stress is dV/det F0: the element loop needs nothing but other gradients and volumes.
    """
    found: list[BlockLayout] = []
    for block in blocks:
        own = F0[block.rows]
        gradient = np.einsum("eji,epja->epia", own, block.gradient)
        volume = block.volume / np.linalg.det(own)[:, None]
        found.append(replace(block, gradient=np.ascontiguousarray(gradient), volume=volume))
    return tuple(found)
