"""Reduced solid and its damping as parts of a scene whose points carry the coordinates."""

from dataclasses import dataclass

import numpy as np

from sim._kernels.lanes import LANES
from sim._kernels.reduced import ROWS, Linear, PointTable, Scratch, evaluate
from sim.mesh import Mesh
from sim.scene import Contribution, Index, Layout, Stiffness
from sim.state import Array, Control


@dataclass(frozen=True, eq=False)
class ReducedSolid:
    """Solid with few coordinates: three for every point of the scene, of unit mass."""

    names: tuple[str, ...]  #: muscles, the order of the table
    table: PointTable  #: with n columns of G, of which the first r move
    load: Array  #: (n,) constant generalised force [N kg^-1/2]
    #: (n, n) damping [1/s], and stiffness at rest [1/s^2]
    damping: Array
    stiffness: Array

    def pair_keys(self, mesh: Mesh) -> Index:
        """All pairs of points."""
        a, b = np.triu_indices(mesh.n_nodes)
        return (a * mesh.n_nodes + b).astype(np.int64)

    def node_mass(self, mesh: Mesh) -> Array:
        """Unit mass, since the modes are orthonormal in the mass."""
        return np.ones(mesh.n_nodes)

    def muscle_names(self) -> tuple[str, ...]:
        """Names of the muscles."""
        return self.names

    def compile(self, layout: Layout) -> "CompiledReducedSolid":
        """Allocate the scratch memory."""
        return CompiledReducedSolid(self, 3 * layout.mesh.n_nodes)


def _rows_of_lanes(n: int) -> int:
    return -(-n // LANES)


class CompiledReducedSolid:
    """Compiled reduced solid; the buffers contain no state between calls."""

    def __init__(self, solid: ReducedSolid, r: int) -> None:
        self.solid, self.r = solid, r
        n = len(solid.load)
        own, every = _rows_of_lanes(r), _rows_of_lanes(n)
        shapes = (ROWS, 9), (own, LANES), (every, LANES), (r * own, LANES), (r, r), (n,)
        self.scratch = Scratch(*(np.zeros(shape) for shape in shapes))
        self.linear = Linear(solid.load, solid.damping, solid.stiffness)
        self._upper = np.triu_indices(r)
        self._relaxed: tuple[float, Array] = (0.0, np.zeros((0, 0)))

    def relaxed(self, h: float) -> Array:
        """Inverse of 1 + h D + h^2 K of the coordinates that do not move, for a step h [s]."""
        if self._relaxed[0] != h:
            r, s = self.r, self.solid
            A = h * s.damping[r:, r:] + h * h * s.stiffness[r:, r:]
            inverse: Array = np.linalg.inv(np.eye(len(A)) + A).astype(np.float64)
            self._relaxed = h, inverse
        return self._relaxed[1]

    def add(self, q: Array, control: Control, f: Array, K: Array | None = None) -> Contribution:
        """F += force at coordinates q (n_points, 3), and K += stiffness."""
        y, table, scratch = q.reshape(-1), self.solid.table, self.scratch
        scratch.x.reshape(-1)[: self.r] = y
        scratch.f.reshape(-1)[: len(self.solid.load)] = self.solid.load
        if K is not None:
            scratch.K[:] = 0.0
        energy, J, at = evaluate(table, control.activation, K is not None, scratch, self.r)
        f += scratch.f.reshape(-1)[: self.r].reshape(-1, 3)
        if K is not None:
            np.add(K, scratch.K.reshape(self.r, -1)[:, : self.r].T[self._upper], out=K)
        element = int(table.place[at]) // 8 if at >= 0 else -1
        return Contribution(energy - float(self.solid.load[: self.r] @ y), J, element)

    def smallest_J(self, q: Array) -> tuple[float, int]:
        """Smallest det F of the chosen points, and its element."""
        table = self.solid.table
        G = table.G.reshape(len(table.volume), 9, -1)[..., : self.r]
        F = (table.F0 + G @ q.reshape(-1)).reshape(-1, 3, 3)
        J = np.linalg.det(F)
        at = int(np.argmin(J))
        return float(J[at]), int(table.place[at]) // 8


@dataclass(frozen=True, eq=False)
class ReducedDamping:
    """Constant damping matrix over the coordinates (r, r) [1/s]."""

    matrix: Array

    def compile(self, layout: Layout, stiffness: Stiffness) -> "CompiledReducedDamping":
        """Values on the pattern."""
        upper = np.triu_indices(len(self.matrix))
        return CompiledReducedDamping(self.matrix[upper], layout.mesh.X)


@dataclass(frozen=True, eq=False)
class CompiledReducedDamping:
    """Compiled constant damping."""

    values: Array
    rest: Array
    beta: float = 0.0

    def __call__(self, q: Array, control: Control, K: Array | None = None) -> Array:
        """Return the values."""
        return self.values
