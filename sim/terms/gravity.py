"""Weight of all nodes with mass."""

from dataclasses import dataclass

import numpy as np

from sim.mesh import Mesh
from sim.multibody import PointForces
from sim.scene import Contribution, Index, Layout
from sim.state import Array, Control
from sim.vectors import dot


@dataclass(frozen=True)
class Gravity:
    """Force m g on every node, potential -m g . x.

    Attributes
    ----------
    g : tuple of float
        Acceleration [m/s^2].

    Notes
    -----
    Source: Eskes et al. 2017 and the reference face, (0, 0, -9.8) m/s^2 with z superior.
    """

    g: tuple[float, float, float] = (0.0, 0.0, -9.8)

    def pair_keys(self, mesh: Mesh) -> Index:
        """No stiffness."""
        return np.empty(0, dtype=np.int64)

    def compile(self, layout: Layout) -> "CompiledGravity":
        """Weigh the nodes once."""
        return CompiledGravity(layout.node_mass[:, None] * np.asarray(self.g), layout.mesh.X)


class CompiledGravity:
    """Constant nodal weight (n_nodes, 3) [N]; the potential is counted from the rest positions."""

    def __init__(self, weight: Array, X: Array) -> None:
        self._weight, self._X = weight, X

    def add_to(self, forces: PointForces) -> None:
        """Add the weights."""
        forces.load[:] += self._weight

    def add_force(self, q: Array, control: Control, f: Array) -> Contribution:
        """F += m g."""
        f += self._weight
        return Contribution(energy=-dot(self._weight, q - self._X))

    def add_tangent(self, q: Array, control: Control, f: Array, K: Array) -> Contribution:
        """As `add_force`; the stiffness is zero."""
        return self.add_force(q, control, f)
