"""Unilateral penalty supports behind nodes."""

from dataclasses import dataclass

import numpy as np

from sim.checks import real_numbers, require
from sim.errors import SceneError
from sim.indices import count_of, kept_until_known, node_indices
from sim.scene import CompiledTerm, Contribution, Index, Layout, Term
from sim.state import Array, Control

TOUCHED = 1e-9
"""Depth above which a wall contributes to the stiffness [m].

At rest a node is on its wall up to rounding, which must not affect the stiffness of the face.
"""


@dataclass(frozen=True, eq=False)
@real_numbers
class Support(Term):
    """Penalty walls, E = sum_n stiffness/2 min(0, gap + normal_n . (x_n - X_n))^2.

    The wall of node n is at a distance `gap` behind its rest position and is plane, frictionless
    and at rest; it represents a bone on which tissue slides.
    """

    nodes: Index  #: (k,) node indices, or a mask (n_nodes,)
    normal: Array  #: (k, 3) unit vectors away from the wall
    stiffness: float = 1000.0  #: of each wall [N/m]
    gap: float = 0.0  #: distance at rest [m]

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", kept_until_known("a support", "node", self.nodes))
        object.__setattr__(self, "normal", np.asarray(self.normal, dtype=np.float64))
        k = count_of(self.nodes)
        if self.normal.shape != (k, 3):
            raise SceneError(
                f"the sizes of the support arrays differ: {k} nodes, normals {self.normal.shape}, "
                f"expected ({k}, 3)"
            )
        if not np.allclose(np.linalg.norm(self.normal, axis=1), 1.0, rtol=0, atol=1e-9):
            raise SceneError("a normal of a support has no unit length: normalise it")
        require(self, "stiffness", self.stiffness, least=0.0)
        require(self, "gap", self.gap, least=0.0)

    def compile(self, layout: Layout) -> "CompiledSupport":
        """Compile the positions in the matrix."""
        return CompiledSupport(self, layout)


class CompiledSupport(CompiledTerm):
    """Compiled walls."""

    def __init__(self, term: Support, layout: Layout) -> None:
        n = layout.mesh.n_nodes
        nodes = node_indices("a support", term.nodes, n, layout.mesh.n_points)
        self._nodes, self._normal = nodes, term.normal
        self._stiffness, self._gap = term.stiffness, term.gap
        self._X = layout.mesh.X[nodes]
        self._target = layout.pattern.target[layout.pattern.pair_index(nodes * (n + 1))]
        self._block = term.stiffness * np.einsum("ni,nj->nij", term.normal, term.normal)

    def _depth(self, q: Array) -> Array:
        """Penetration of each node behind its wall, <= 0 [m]."""
        away = ((q[self._nodes] - self._X) * self._normal).sum(axis=1)
        return np.minimum(self._gap + away, 0.0)

    def add(self, q: Array, control: Control, f: Array, K: Array | None = None) -> Contribution:
        """Add the forces on nodes behind their wall, and the stiffness of active walls."""
        depth = self._depth(q)
        np.add.at(f, self._nodes, -self._stiffness * depth[:, None] * self._normal)
        if K is not None:
            touched = depth < -TOUCHED
            target = self._target[touched]
            stored = target >= 0
            np.add.at(K, target[stored], self._block[touched].reshape(-1, 9)[stored])
        return Contribution(0.5 * self._stiffness * float((depth * depth).sum()))
