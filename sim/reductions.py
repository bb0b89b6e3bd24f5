"""Reductions: kinematic conditions v = R w that remove unknowns."""

from dataclasses import dataclass

import numpy as np

from sim.errors import SceneError
from sim.mesh import Mesh
from sim.scene import Index


@dataclass(frozen=True, eq=False)
class Fixed:
    """Nodes that keep their position, in all or some directions.

    Attributes
    ----------
    nodes : (k,) array of int
        Node indices.
    axes : tuple of int
        Directions held, 0 = x, 1 = y, 2 = z.

    Raises
    ------
    SceneError
        A node index is out of range (on compiling).
    """

    nodes: Index
    axes: tuple[int, ...] = (0, 1, 2)

    def held(self, mesh: Mesh) -> Index:
        """Indices of the fixed unknowns among 3 n_nodes."""
        nodes = np.asarray(self.nodes, dtype=np.int64)
        if nodes.size and (nodes.min() < 0 or nodes.max() >= mesh.n_nodes):
            raise SceneError(
                f"Fixed refers to node {int(nodes.max())}, expected 0..{mesh.n_nodes - 1}"
            )
        return (3 * nodes[:, None] + np.asarray(self.axes, dtype=np.int64)).ravel()
