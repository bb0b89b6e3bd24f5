"""Volumes of elements and of quadrature points, and their derivatives by the positions."""

import numpy as np

from sim._kernels import volume as kernel
from sim._kernels.lanes import LANES
from sim.assembly import parts_of, places_of
from sim.mesh import Mesh
from sim.pattern import SymmetricPattern
from sim.state import Array


class ElementVolumes:
    """Volumes of all elements, at rest and current (n_elements,), and h = dv/dx (n_elements, 3, 8)."""

    def __init__(self, mesh: Mesh) -> None:
        self.parts = parts_of(mesh)
        self.rest, self.v = mesh.volumes(), np.zeros(mesh.n_elements)
        self.h = np.zeros((mesh.n_elements, 3, LANES))

    def evaluate(self, q: Array) -> None:
        """Fill v and h at positions q."""
        for part in self.parts:
            kernel.element_volumes(q, part, self.v, self.h.reshape(-1, LANES))


class PointVolumes:
    """Current volumes of all quadrature points; a tetrahedron has one quarter per node.

    `rest` and current volumes `v` are (n_elements, 8) [m^3], zero if an element has no such point;
    `rest` is that of the mesh, or of the `stress_free` positions (n_elements, 8, 3) [m].
    """

    def __init__(
        self, mesh: Mesh, pattern: SymmetricPattern, stress_free: Array | None = None
    ) -> None:
        self._parts = parts_of(mesh, stress_free=stress_free, point_per_node=True)
        self._places = [places_of(mesh, part, pattern) for part in self._parts]
        n = mesh.n_elements
        self.rest, self.v = np.zeros((n, LANES)), np.zeros((n, LANES))
        self._n = np.zeros((n, LANES, 9))
        self._kind = np.zeros(n, dtype=np.int64)
        slopes = np.zeros((max(len(self._parts), 1), 3 * LANES, LANES))
        for i, part in enumerate(self._parts):
            self.rest[part.element] = part.volume
            self._kind[part.element] = i
            slopes[i, : len(part.slope)] = part.slope
        self._slope = slopes.reshape(-1, LANES)

    def evaluate(self, q: Array) -> None:
        """Compute v, and the data of `gather`, at positions q."""
        for part in self._parts:
            kernel.point_volumes(q, part, self.v, self._n)

    def gather(self, corners: kernel.NodePoints, nodal_volume: Array, g: Array) -> None:
        """Sum over the points of every node, as `sim._kernels.volume.gather_nodal`."""
        kernel.gather_nodal(self.v, self._n, self._slope, self._kind, corners, nodal_volume, g)

    def add_pressure(self, q: Array, p: Array, f: Array, K: Array | None = None) -> None:
        """With a pressure p (n_elements, 8): f -= p dv/dx and, if given, K += p d2v/dx2."""
        none = np.zeros(0)
        values = none if K is None else K
        for part, places in zip(self._parts, self._places, strict=True):
            kernel.add_pressure(q, part, places, none, p, True, K is not None, f, none, values)
