"""Hard incompressibility: constant volume of every element, with one multiplier (minus its pressure)."""

from dataclasses import dataclass, replace

import numpy as np

from sim._kernels import volume as kernel
from sim._kernels.lanes import LANES
from sim.assembly import element_pair_keys, places_of, slots
from sim.checks import real_numbers
from sim.mesh import Mesh
from sim.scene import Index, Layout
from sim.state import Array
from sim.volumes import ElementVolumes


@dataclass(frozen=True)
@real_numbers
class HardElementVolume:
    """c_e = v_e - V_e = 0 for every element, or those of some blocks of the mesh.

    Replaces the bulk law of a solid, whose kappa must be 0. The multiplier is minus the pressure of
    the element [Pa].

    Notes
    -----
    Source: hard element incompressibility of the published demonstration (Stavness et al., coupled
    face model). Constant-pressure hexahedra do not satisfy the inf-sup condition: the displacements
    are free of locking, but the pressures may alternate between elements. Elements whose nodes are
    all fixed or on bodies have no constraint. With bodies, joints or attachments only linearly implicit
    steps support it.
    """

    #: blocks of the mesh that have it, from the first to the one before the last; all by default
    first: int = 0
    last: int | None = None

    def pair_keys(self, mesh: Mesh) -> Index:
        """All pairs of nodes within an element."""
        return element_pair_keys(mesh.of_blocks(self.first, self.last))

    def compile(self, layout: Layout) -> "CompiledElementVolumes":
        """Lay out volumes and rows."""
        mesh = layout.mesh.of_blocks(self.first, self.last)
        return CompiledElementVolumes(replace(layout, mesh=mesh))


class CompiledElementVolumes:
    """Compiled element volumes; the buffers contain no state between calls."""

    def __init__(self, layout: Layout) -> None:
        mesh = layout.mesh
        self._volumes = ElementVolumes(mesh)
        self._places = [places_of(mesh, p, layout.pattern) for p in self._volumes.parts]
        self._no_force = np.zeros((0, 3))
        nodes, used = slots(mesh)
        self._entry = np.repeat(used[:, None, :], 3, axis=1)  # element, axis, slot
        unknown = 3 * nodes[:, None, :] + np.arange(3)[:, None]
        self.unknown: Index = unknown[self._entry]
        counts = self._entry.sum(axis=(1, 2))
        self.start: Index = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)

    def evaluate(self, q: Array) -> tuple[Array, Array]:
        """Changes of volume (n_elements,) [m^3] and their derivatives [m^2]."""
        self._volumes.evaluate(q)
        return self._volumes.v - self._volumes.rest, self._volumes.h[self._entry]

    def add_curvature(self, q: Array, multiplier: Array, K: Array) -> None:
        """K += sum_e multiplier_e d2v_e/dx2."""
        pressure, none = np.repeat(multiplier[:, None], LANES, axis=1), np.zeros(0)
        for part, places in zip(self._volumes.parts, self._places, strict=True):
            kernel.add_pressure(
                q, part, places, none, pressure, False, True, self._no_force, none, K
            )
