"""Constant forces on nodes: weight and dead loads."""

from dataclasses import dataclass

import numpy as np

from sim.checks import real_numbers
from sim.dense import dot
from sim.errors import SceneError
from sim.indices import count_of, kept_until_known, node_indices
from sim.multibody import PointForces
from sim.scene import CompiledTerm, Contribution, Index, Layout, Term
from sim.state import Array, Control


@dataclass(frozen=True)
@real_numbers
class Gravity(Term):
    """Force m g on every node, potential -m g . (q - X).

    Notes
    -----
    Source: Eskes et al. 2017 and the reference face, (0, 0, -9.8) m/s^2 with z superior.
    """

    g: tuple[float, float, float] = (0.0, 0.0, -9.8)  #: acceleration [m/s^2]

    def compile(self, layout: Layout) -> "ConstantForces":
        """Weigh the nodes once."""
        g = np.asarray(self.g, dtype=np.float64)
        if g.shape != (3,) or not np.isfinite(g).all():
            raise SceneError(f"Gravity: g = {self.g!r}, expected three finite numbers [m/s^2]")
        return ConstantForces(layout.node_mass[:, None] * g, layout.mesh.X)


@dataclass(frozen=True, eq=False)
@real_numbers
class NodeLoad(Term):
    """Constant forces on nodes, potential -f . (q - X)."""

    nodes: Index  #: (k,) node indices, or a mask (n_nodes,); the forces of repeated ones are added
    force: Array  #: (k, 3) force on each [N]

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", kept_until_known("NodeLoad", "node", self.nodes))
        object.__setattr__(self, "force", np.asarray(self.force, dtype=np.float64))
        k = count_of(self.nodes)
        if self.force.shape != (k, 3) or not np.isfinite(self.force).all():
            raise SceneError(
                f"NodeLoad: force has shape {self.force.shape} or contains NaN, expected finite ({k}, 3)"
            )

    def compile(self, layout: Layout) -> "ConstantForces":
        """Sum the forces of each node."""
        n = layout.mesh.n_nodes
        total = np.zeros((n, 3))
        np.add.at(total, node_indices("NodeLoad", self.nodes, n, layout.mesh.n_points), self.force)
        return ConstantForces(total, layout.mesh.X)


class ConstantForces(CompiledTerm):
    """Constant nodal forces (n_nodes, 3) [N]; the potential is counted from the rest positions."""

    def __init__(self, load: Array, X: Array) -> None:
        self._load, self._X = load, X

    def add_to(self, forces: PointForces) -> None:
        """Add the loads."""
        forces.load[:] += self._load

    def add(self, q: Array, control: Control, f: Array, K: Array | None = None) -> Contribution:
        """Add the forces to f."""
        f += self._load
        return Contribution(energy=-dot(self._load, q - self._X))
