"""Data of the element loops: slots, natural derivatives, positions in the matrix.

All terms on elements use this layout. Every element has `NODES` slots; unused slots repeat the
first node with zero derivatives and are omitted from the matrix.
"""

import numpy as np
from numpy.typing import NDArray

from sim._kernels.element import NODES, Part
from sim._kernels.lanes import LANES
from sim._kernels.scatter import PAIRS, Places
from sim.chunks import coloured_chunks
from sim.errors import SceneError
from sim.mesh import Block, Mesh
from sim.pattern import Index, SymmetricPattern, distinct
from sim.state import Array

_A, _B = np.triu_indices(NODES)  # slots of the stored node pairs, row by row


def slots(mesh: Mesh) -> tuple[Index, NDArray[np.bool_]]:
    """Node of every slot (n_elements, NODES), and mask of the slots in use."""
    nodes = np.empty((mesh.n_elements, NODES), dtype=np.int64)
    used = np.zeros_like(nodes, dtype=bool)
    first = 0
    for block in mesh.blocks:
        n, k = block.nodes.shape
        nodes[first : first + n] = block.nodes[:, :1]
        nodes[first : first + n, :k] = block.nodes
        used[first : first + n, :k] = True
        first += n
    return nodes, used


def element_pair_keys(mesh: Mesh) -> Index:
    """All node pairs within an element, as ``a * n_nodes + b`` with a <= b."""
    nodes, used = slots(mesh)
    a, b = nodes[:, _A], nodes[:, _B]
    keys = np.minimum(a, b) * mesh.n_nodes + np.maximum(a, b)
    return distinct(keys[used[:, _A] & used[:, _B]])


def grouped(keys: Index, n_groups: int) -> tuple[Index, Index]:
    """Stable order that groups keys 0..n_groups-1, and the start of every group."""
    order = np.argsort(keys, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(keys, minlength=n_groups))])
    return order.astype(np.int64), start.astype(np.int64)


def require_stress_free(stress_free: Array, mesh: Mesh) -> None:
    """Refuse stress-free positions of another shape, or at which an element is not valid."""
    if stress_free.shape != (mesh.n_elements, NODES, 3):
        raise SceneError(
            f"stress_free has the shape {stress_free.shape}, expected ({mesh.n_elements}, {NODES}, 3), "
            "the nodes of every element of the mesh"
        )
    first = 0
    for block in mesh.blocks:
        corners = stress_free[first : first + len(block.nodes), : block.kind.n_nodes]
        with np.errstate(invalid="ignore"):
            good = np.linalg.det(np.einsum("eai,paj->epij", corners, block.kind.dN)) > 0.0
        if not good.all():  # also if a position is not finite
            raise SceneError(
                f"element {first + int(np.argmin(good.all(axis=1)))} is inverted or flat at its "
                "stress-free positions, expected a positive volume: check the positions"
            )
        first += len(block.nodes)


def parts_of(
    mesh: Mesh,
    chosen: NDArray[np.bool_] | None = None,
    *,
    prestretch: Array | None = None,
    stress_free: Array | None = None,
    point_per_node: bool = False,
) -> tuple[Part, ...]:
    """Lay out the chosen elements (n_elements,) of every block, by default all.

    With a prestretch F0 (n_elements, 3, 3) from the stress-free state to the mesh and F = (dx/dxi) A of
    the mesh, the total deformation is F F0 = (dx/dxi) (A F0), and the stress-free volume is dV/det F0.
    With `stress_free` (n_elements, NODES, 3), A and dV are those of the nodes at these positions.
    With `point_per_node` the single point of an element is divided among its nodes; other elements have
    a point per node.
    """
    if stress_free is not None:
        require_stress_free(stress_free, mesh)
    parts: list[Part] = []
    first = 0
    for block in mesh.blocks:
        own = np.arange(len(block.nodes))
        if chosen is not None:
            own = np.flatnonzero(chosen[first : first + len(own)])
        if len(own):
            F0 = None if prestretch is None else prestretch[own + first]
            corners = None if stress_free is None else stress_free[own + first]
            parts.append(_part(block, own, first, (mesh.X, corners, F0), point_per_node))
        first += len(block.nodes)
    return tuple(parts)


def _part(
    block: Block,
    own: Index,
    first: int,
    rest: tuple[Array, Array | None, Array | None],
    point_per_node: bool,
) -> Part:
    """Lay out elements; `rest` is the mesh, or the stress-free corners in its place, and F0."""
    X, corners, F0 = rest
    order, chunk, colour = coloured_chunks(block.nodes[own])
    own = own[order]
    dN, weights = block.kind.dN, block.kind.weights
    if point_per_node and len(weights) == 1:
        k = block.kind.n_nodes
        dN, weights = np.repeat(dN, k, axis=0), np.repeat(weights / k, k)
    n, points, k = len(own), len(weights), block.kind.n_nodes
    slope = np.zeros((3 * points, NODES))
    slope[:, :k] = dN.transpose(0, 2, 1).reshape(3 * points, k)
    lane = np.append(np.arange(points), np.zeros(LANES - points, dtype=np.int64))
    slope_at = np.zeros((3, NODES, LANES))
    slope_at[:, :k] = dN.transpose(2, 1, 0)[:, :, lane]
    corners = X[block.nodes[own]] if corners is None else corners[order, :k]
    jacobian: Array = np.einsum("eai,paj->epij", corners, dN)
    det = np.linalg.det(jacobian)
    inverse: Array = np.linalg.inv(jacobian).astype(np.float64)
    if F0 is not None:
        inverse = inverse @ F0[order][:, None]
        det = det / np.linalg.det(F0[order])[:, None]
    volume = np.zeros((n, LANES))
    volume[:, :points] = det * weights
    nodes = np.repeat(block.nodes[own, :1], NODES, axis=1)
    nodes[:, :k] = block.nodes[own]
    return Part(
        element=own + first,
        nodes=nodes,
        slope=slope,
        slope_at=slope_at.reshape(3 * NODES, LANES),
        inverse=np.ascontiguousarray(inverse.transpose(0, 2, 3, 1)[..., lane]).reshape(-1, LANES),
        volume=volume,
        chunk=chunk,
        colour=colour,
    )


def places_of(mesh: Mesh, part: Part, pattern: SymmetricPattern) -> Places:
    """Find the positions of the blocks of a part in the values of the matrix."""
    used = slots(mesh)[1][part.element]
    order = np.argsort(np.where(used, part.nodes, mesh.n_nodes), axis=1, kind="stable")
    ascending = np.take_along_axis(part.nodes, order, axis=1)
    used = np.take_along_axis(used, order, axis=1)
    pair = used[:, _A] & used[:, _B]
    keys = np.where(pair, ascending[:, _A] * mesh.n_nodes + ascending[:, _B], 0)
    target = np.full((len(keys), PAIRS, 9), -1, dtype=np.int32)
    target[pair] = pattern.target[pattern.pair_index(keys[pair])]
    free = np.zeros(3 * mesh.n_nodes, dtype=bool)
    free[pattern.free] = True
    count = free.reshape(-1, 3).sum(axis=1)
    special = ((count > 0) & (count < 3))[part.nodes].any(axis=1)
    special |= (pair & (_A != _B) & (ascending[:, _A] == ascending[:, _B])).any(axis=1)
    row = np.where(special, np.cumsum(special) - 1, -1).astype(np.int32)
    # The entries (i, i) of a fully stored pair exist also if the two nodes are the same.
    start = np.where(target[..., ::4] < 0, -1, target[..., ::4] - np.arange(3, dtype=np.int32))
    return Places(order.astype(np.int8), np.ascontiguousarray(start), row, target[special])
