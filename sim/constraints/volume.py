"""Hard incompressibility: every element keeps its volume, by one multiplier (minus its pressure)."""

from dataclasses import dataclass

import numpy as np

from sim._kernels import volume as kernel
from sim.assembly import MatrixSum, element_pair_keys, slots
from sim.mesh import Mesh
from sim.scene import Index, Layout
from sim.state import Array
from sim.volumes import PointVolumes


@dataclass(frozen=True)
class HardElementVolume:
    """c_e = v_e - V_e = 0 for every element.

    Replaces the bulk law of a solid (give that kappa = 0). The multiplier is minus the pressure of the
    element [Pa].

    Notes
    -----
    Source: hard element incompressibility of the published demonstration (Stavness et al., coupled
    face model). Constant-pressure hexahedra do not satisfy the inf-sup condition: the displacements are
    free of locking, the pressures may alternate from element to element. Elements whose nodes are all
    fixed have no condition.
    """

    def pair_keys(self, mesh: Mesh) -> Index:
        """All pairs of nodes within an element."""
        return element_pair_keys(mesh)

    def compile(self, layout: Layout) -> "CompiledElementVolumes":
        """Lay out volumes and rows."""
        return CompiledElementVolumes(layout)


class CompiledElementVolumes:
    """Element volumes laid out for a scene; the buffers carry nothing between calls."""

    def __init__(self, layout: Layout) -> None:
        mesh = layout.mesh
        self._volumes = PointVolumes(mesh)
        self._rest = self._volumes.rest.sum(axis=1)
        self._is_point = self._volumes.rest > 0.0
        self._matrix_sum = MatrixSum(mesh, layout.pattern)
        self._blocks: Array | None = None
        nodes, used = slots(mesh)
        self._entry = np.repeat(used[:, None, :], 3, axis=1)  # element, axis, slot
        unknown = 3 * nodes[:, None, :] + np.arange(3)[:, None]
        self.unknown: Index = unknown[self._entry]
        counts = self._entry.sum(axis=(1, 2))
        self.start: Index = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)

    def evaluate(self, q: Array) -> tuple[Array, Array]:
        """Changes of volume (n_elements,) [m^3] and their derivatives [m^2]."""
        self._volumes.evaluate(q)
        c = (self._volumes.v * self._is_point).sum(axis=1) - self._rest
        return c, self._volumes.h.sum(axis=1)[self._entry]

    def add_curvature(self, q: Array, multiplier: Array, K: Array) -> None:
        """K += sum_e multiplier_e d2v_e/dx2."""
        if self._blocks is None:
            self._blocks = np.zeros(self._matrix_sum.shape)
        weight = np.ascontiguousarray(multiplier[:, None] * self._is_point)
        none = np.zeros(len(multiplier))
        kernel.pressure_stiffness(weight, self._volumes.v, self._volumes.h, none, self._blocks)
        self._matrix_sum.add(self._blocks, K)
