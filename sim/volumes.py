"""Present volumes of all Gauss points and their derivatives."""

from dataclasses import replace

import numpy as np

from sim._kernels import volume as kernel
from sim.assembly import BlockLayout, NodeSum, block_layouts
from sim.mesh import Block, Mesh
from sim.state import Array


class PointVolumes:
    """Volumes v and derivatives h = dv/dx of all Gauss points, in one rectangle for all blocks.

    Attributes
    ----------
    rest : (n_elements, n_points) rest volumes [m^3], zero where an element has no such point.
    v : (n_elements, n_points) present volumes [m^3], one where an element has no such point.
    h : (n_elements, n_points, 3, 8) derivatives [m^2].
    """

    def __init__(self, mesh: Mesh, *, point_per_node: bool = False) -> None:
        self.blocks = block_layouts(mesh)
        if point_per_node:
            self.blocks = tuple(map(_with_point_per_node, self.blocks, mesh.blocks))
        self.node_sum = NodeSum(mesh)
        points = max((b.volume.shape[1] for b in self.blocks), default=1)
        n = mesh.n_elements
        # one rectangle for all blocks; the points that a block lacks stay zero
        self.rest = np.zeros((n, points))
        for b in self.blocks:
            self.rest[b.rows, : b.volume.shape[1]] = b.volume
        self.v = np.ones((n, points))
        self.h = np.zeros((n, points, 3, 8))
        self.force = np.zeros((n, 3, 8))

    def evaluate(self, q: Array) -> None:
        """Fill v and h at positions q."""
        for b in self.blocks:
            v, h = self._views(b)
            own_v, own_h = np.empty(v.shape), np.empty(h.shape)
            kernel.volumes(q, b.nodes, b.gradient, b.volume, own_v, own_h)
            v[...], h[...] = own_v, own_h

    def _views(self, b: BlockLayout) -> tuple[Array, Array]:
        k = b.volume.shape[1]
        return self.v[b.rows, :k], self.h[b.rows, :k]

    def add_force(self, p: Array, f: Array) -> None:
        """Subtract the sum of p dv/dx, with the pressure p (element, point), from f."""
        kernel.pressure_forces(p, self.h, self.force)
        self.node_sum.add(self.force, -1.0, f)


def _with_point_per_node(layout: BlockLayout, block: Block) -> BlockLayout:
    """Divide the one point of an element among its nodes; other elements have a point per node."""
    k = block.kind.n_nodes
    if layout.volume.shape[1] == k:
        return layout
    return replace(
        layout,
        gradient=np.repeat(layout.gradient, k, axis=1),
        volume=np.repeat(layout.volume / k, k, axis=1),
    )
