"""Mesh: nodes at rest, blocks of elements of one type, and structured grids of hexahedra."""

from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sim.described import Described
from sim.elements import ELEMENT_TYPES, ElementType
from sim.errors import MeshError
from sim.indices import index, index_rows
from sim.pattern import Array, Index


@dataclass(frozen=True)
class Block:
    """Elements of one type."""

    kind: ElementType
    nodes: Index  #: (n_elements, kind.n_nodes) indices into the nodes of the mesh

    def gradients(self, X: Array, *, at_corners: bool = False) -> tuple[Array, Array]:
        """Material gradients dN/dX (n_elements, n_points, n_nodes, 3) [1/m], and det(dX/dxi) [m^3].

        Both are computed at the quadrature points or at the corners.
        """
        dN = self.kind.dN_corners if at_corners else self.kind.dN
        jacobian = np.einsum("eai,paj->epij", X[self.nodes], dN)
        det = np.linalg.det(jacobian)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = np.where(
                (det != 0.0)[..., None, None],
                np.linalg.inv(np.where((det != 0.0)[..., None, None], jacobian, np.eye(3))),
                np.nan,
            )
        return np.einsum("paj,epji->epai", dN, inverse), det


@dataclass(frozen=True, repr=False)
class Mesh(Described):
    """Nodes at rest and element blocks, checked on creation.

    Elements are numbered through the blocks in their order.

    Raises
    ------
    MeshError
        A node index is out of range, a position is not finite, an element is inverted or has no
        volume at a quadrature point, two elements have the same nodes, or a node belongs to no element.
    """

    X: Array  #: (n_nodes, 3) rest positions [m]
    blocks: tuple[Block, ...]
    #: number of nodes at the end that belong to no element, such as points of bodies and ends of
    #: muscles
    n_points: int = 0

    def __post_init__(self) -> None:
        n = len(self.X)
        if self.X.ndim != 2 or self.X.shape[1] != 3 or not np.isfinite(self.X).all():
            raise MeshError(
                f"node positions have shape {self.X.shape} or contain NaN, expected finite (n, 3)"
            )
        used = np.zeros(n, dtype=bool)
        used[n - self.n_points :] = True
        first = 0
        for block in self.blocks:
            width = block.kind.n_nodes
            if block.nodes.dtype.kind not in "iu" or block.nodes.shape[1:] != (width,):
                raise MeshError(
                    f"elements {block.kind.name} have nodes of shape {block.nodes.shape} and type "
                    f"{block.nodes.dtype}, expected whole numbers (m, {width})"
                )
            if block.nodes.size and (block.nodes.min() < 0 or block.nodes.max() >= n):
                bad = int(np.argmax((block.nodes < 0) | (block.nodes >= n)) // block.nodes.shape[1])
                raise MeshError(
                    f"element {first + bad} refers to node {block.nodes[bad].max()}, expected 0..{n - 1}"
                )
            used[block.nodes] = True
            _, det = block.gradients(self.X)
            if block.nodes.size and not (det > 0.0).all():
                bad, point = np.argwhere(~(det > 0.0))[0]
                raise MeshError(
                    f"element {first + bad} ({block.kind.name}) is inverted or flat at rest "
                    f"(det dX/dxi = {det[bad, point]:.3g} m^3 at quadrature point {point}, expected "
                    "> 0): check the node order or repair the element"
                )
            first += len(block.nodes)
        _refuse_repeated(self.blocks)
        if not used.all():
            raise MeshError(
                f"{int((~used).sum())} nodes belong to no element (first: {int(np.argmin(used))}): "
                "remove them, because they would have no mass"
            )

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.X)

    @property
    def n_elements(self) -> int:
        """Number of elements over all blocks."""
        return sum(len(block.nodes) for block in self.blocks)

    def facts(self) -> dict[str, str]:
        """Nodes, elements by type and size of the mesh."""
        if not len(self.X):
            return {"nodes": "0"}
        low, high = self.X.min(axis=0), self.X.max(axis=0)
        size = " x ".join(f"{1e3 * edge:.3g}" for edge in high - low)
        blocks = ", ".join(f"{len(block.nodes)} {block.kind.name}" for block in self.blocks)
        return {"nodes": str(self.n_nodes), "elements": blocks, "size": f"{size} mm"}

    def volumes(self) -> Array:
        """Rest volume of every element [m^3], shape (n_elements,), by quadrature."""
        volumes = [b.gradients(self.X)[1] @ b.kind.weights for b in self.blocks]
        return np.concatenate([*volumes, np.empty(0)])

    def of_blocks(self, first: int, last: int | None) -> "Mesh":
        """Mesh with some of the blocks; the other nodes remain, without elements.

        Raises MeshError for blocks that do not exist, and if there would be none.
        """
        k = len(self.blocks)
        start = index("a part of the mesh", "block", first, k, error=MeshError)
        end = (
            k if last is None else index("a part of the mesh", "block", last, None, error=MeshError)
        )
        if not start < end <= k:
            raise MeshError(
                f"a part of the mesh refers to blocks {start}..{end - 1}, expected at least one of 0.."
                f"{k - 1}"
            )
        mesh = copy(self)  # a checked mesh, whose check would refuse nodes without elements
        object.__setattr__(mesh, "blocks", self.blocks[start:end])
        return mesh

    def with_points(self, points: Array) -> "Mesh":
        """The same mesh with nodes (k, 3) appended that belong to no element."""
        X = np.concatenate([self.X, points])
        return Mesh(
            np.ascontiguousarray(X, dtype=np.float64), self.blocks, self.n_points + len(points)
        )


def _refuse_repeated(blocks: Sequence[Block]) -> None:
    """Raise MeshError if two elements, of one block or of two, have the same nodes in any order."""
    starts = np.cumsum([0, *(len(block.nodes) for block in blocks)])
    for width in {block.kind.n_nodes for block in blocks}:
        parts = [k for k, block in enumerate(blocks) if block.kind.n_nodes == width]
        nodes = np.sort(np.concatenate([blocks[k].nodes for k in parts]), axis=1)
        _, kind, count = np.unique(nodes, axis=0, return_inverse=True, return_counts=True)
        if (count > 1).any():
            number = np.concatenate([starts[k] + np.arange(len(blocks[k].nodes)) for k in parts])
            a, b = number[kind.ravel() == np.argmax(count > 1)][:2]
            shared = nodes[kind.ravel() == np.argmax(count > 1)][0].tolist()
            raise MeshError(
                f"elements {a} and {b} have the same nodes {shared}, expected every element once, "
                "because stiffness and mass would count twice: delete one of them"
            )


def mesh_from_arrays(X: ArrayLike, **connectivity: Iterable[Iterable[int]]) -> Mesh:
    """Mesh from node positions (n_nodes, 3) [m] and one connectivity array per element type.

    ``hex8=...``, ``wedge6=...``, ``tet4=...``: node indices, 0-based, in VTK order. Raises
    `MeshError` for an unknown element type, or as `Mesh`.
    """
    blocks: list[Block] = []
    for name, nodes in connectivity.items():
        if name not in ELEMENT_TYPES:
            raise MeshError(f"unknown element type {name!r}, expected one of {[*ELEMENT_TYPES]}")
        kind = ELEMENT_TYPES[name]
        given = np.asarray(nodes if hasattr(nodes, "__array__") else [*nodes])
        array = index_rows(f"an element {name}", "node", given, None, kind.n_nodes, error=MeshError)
        blocks.append(Block(kind, array))
    return Mesh(np.ascontiguousarray(X, dtype=np.float64), tuple(blocks))


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
