"""Soft incompressibility: a pressure from the volume of a whole element or of a nodal region.

Both replace the pointwise bulk law of a solid (give that kappa = 0) and use the quadratic potential.
They cure volumetric locking because fewer volumes are constrained than there are Gauss points.
"""

from dataclasses import dataclass

import numpy as np

from sim._kernels import volume as kernel
from sim.assembly import (
    MatrixSum,
    element_pair_keys,
    grouped,
    slots,
)
from sim.errors import SceneError
from sim.mesh import Mesh
from sim.scene import Contribution, Index, Layout
from sim.state import Array, Control
from sim.vectors import dot
from sim.volumes import PointVolumes


@dataclass(frozen=True)
class ElementVolume:
    """One pressure per element, E = sum_e kappa/2 V_e (v_e/V_e - 1)^2.

    Attributes
    ----------
    kappa : float
        Bulk modulus [Pa].

    Raises
    ------
    SceneError
        kappa is not positive.
    """

    kappa: float = 25e3

    def __post_init__(self) -> None:
        """Check the range."""
        _require_positive(self.kappa)

    def pair_keys(self, mesh: Mesh) -> Index:
        """All pairs of nodes within an element."""
        return element_pair_keys(mesh)

    def compile(self, layout: Layout) -> "CompiledElementVolume":
        """Lay out volumes and sums."""
        return CompiledElementVolume(self.kappa, layout)


@dataclass(frozen=True)
class NodalVolume:
    """One pressure per node, E = sum_n kappa/2 V_n (v_n/V_n - 1)^2.

    v_n is the volume of the Gauss points that belong to node n: of each element at the node, the point
    in its corner; a tetrahedron gives each of its nodes a quarter (Bonet and Burton 1998). Source: the
    soft nodal incompressibility that Eskes et al. 2017 used, as recorded from the published simulator.

    Attributes
    ----------
    kappa : float
        Bulk modulus [Pa].
    at_fixed : bool
        Whether fully fixed nodes have a pressure, too; in the published simulator they have none.

    Raises
    ------
    SceneError
        kappa is not positive.

    Notes
    -----
    Couples all nodes that share a neighbour: the factor is about three times that of other bulk laws.
    """

    kappa: float = 25e3
    at_fixed: bool = False

    def __post_init__(self) -> None:
        """Check the range."""
        _require_positive(self.kappa)

    def pair_keys(self, mesh: Mesh) -> Index:
        """All pairs of nodes within the elements around a node."""
        star_start, star = _stars(mesh)
        _, a, b = _star_pairs(star_start, star)
        return np.unique(star[a] * mesh.n_nodes + star[b])

    def compile(self, layout: Layout) -> "CompiledNodalVolume":
        """Lay out volumes, stars and sums."""
        return CompiledNodalVolume(self, layout)


def _require_positive(kappa: float) -> None:
    if not 0.0 < kappa < np.inf:
        raise SceneError(f"soft incompressibility: kappa = {kappa!r}, expected a number > 0")


class CompiledElementVolume:
    """Element volumes laid out for a scene; the buffers carry nothing between calls."""

    def __init__(self, kappa: float, layout: Layout) -> None:
        self._kappa, self._volumes = kappa, PointVolumes(layout.mesh)
        self._matrix_sum = MatrixSum(layout.mesh, layout.pattern)
        self._rest = self._volumes.rest.sum(axis=1)
        self._is_point = self._volumes.rest > 0.0
        self._blocks = np.zeros(self._matrix_sum.shape)

    def _pressure(self, q: Array) -> tuple[Array, float]:
        self._volumes.evaluate(q)
        strain = (self._volumes.v * self._is_point).sum(axis=1) / self._rest - 1.0
        pressure = np.ascontiguousarray((self._kappa * strain)[:, None] * self._is_point)
        return pressure, 0.5 * self._kappa * dot(self._rest, strain**2)

    def add_force(self, q: Array, control: Control, f: Array) -> Contribution:
        """Subtract dE/dq from f."""
        pressure, energy = self._pressure(q)
        self._volumes.add_force(pressure, f)
        return Contribution(energy)

    def add_tangent(self, q: Array, control: Control, f: Array, K: Array) -> Contribution:
        """As `add_force`, and K += d2E/dq2."""
        pressure, energy = self._pressure(q)
        self._volumes.add_force(pressure, f)
        stiffness = self._kappa / self._rest
        kernel.pressure_stiffness(
            pressure, self._volumes.v, self._volumes.h, stiffness, self._blocks
        )
        self._matrix_sum.add(self._blocks, K)
        return Contribution(energy)


class CompiledNodalVolume:
    """Nodal volumes laid out for a scene; the buffers carry nothing between calls."""

    def __init__(self, term: NodalVolume, layout: Layout) -> None:
        mesh, pattern = layout.mesh, layout.pattern
        self._kappa, self._volumes = term.kappa, PointVolumes(mesh, point_per_node=True)
        self._matrix_sum = MatrixSum(mesh, pattern)
        self._blocks = np.zeros(self._matrix_sum.shape)

        nodes, used = slots(mesh)
        element, point = np.nonzero(self._volumes.rest > 0.0)
        owner = nodes[element, point]  # quadrature point k lies in the corner of node k
        order, self._start = grouped(owner, mesh.n_nodes)
        self._element, self._point = element[order], point[order]
        self._owner = np.zeros(self._volumes.rest.shape, dtype=np.int64)
        self._owner[element, point] = owner
        self._is_point = self._volumes.rest > 0.0

        self._star_start, star = _stars(mesh)
        key = np.repeat(np.arange(mesh.n_nodes), np.diff(self._star_start)) * mesh.n_nodes + star
        wanted = owner[order][:, None] * mesh.n_nodes + nodes[self._element]
        self._place = np.searchsorted(key, wanted)
        self._place[~used[self._element]] = -1

        centre, a, b = _star_pairs(self._star_start, star)
        pair, group = np.unique(star[a] * mesh.n_nodes + star[b], return_inverse=True)
        order, self._pair_start = grouped(group.astype(np.int64), len(pair))
        self._pair_node = centre[order].astype(np.int32)
        self._first, self._second = a[order].astype(np.int32), b[order].astype(np.int32)
        self._target = np.ascontiguousarray(pattern.target[pattern.pair_index(pair)])

        self._rest: Array = np.bincount(
            owner, self._volumes.rest[element, point], mesh.n_nodes
        ).astype(np.float64)
        self._nodal = np.empty(mesh.n_nodes)
        self._g = np.empty((len(star), 3))
        moves = np.zeros(mesh.n_nodes, dtype=bool)
        moves[pattern.free // 3] = True
        self._counts = np.ones(mesh.n_nodes) if term.at_fixed else moves.astype(np.float64)

    def _pressure(self, q: Array) -> tuple[Array, float]:
        self._volumes.evaluate(q)
        kernel.gather_nodal(
            self._volumes.v,
            self._volumes.h,
            self._start,
            self._element,
            self._point,
            self._place,
            self._star_start,
            self._nodal,
            self._g,
        )
        strain = self._counts * (self._nodal / self._rest - 1.0)
        pressure = np.ascontiguousarray((self._kappa * strain)[self._owner] * self._is_point)
        return pressure, 0.5 * self._kappa * dot(self._rest, strain**2)

    def add_force(self, q: Array, control: Control, f: Array) -> Contribution:
        """Subtract dE/dq from f."""
        pressure, energy = self._pressure(q)
        self._volumes.add_force(pressure, f)
        return Contribution(energy)

    def add_tangent(self, q: Array, control: Control, f: Array, K: Array) -> Contribution:
        """As `add_force`, and K += d2E/dq2, which couples second neighbours."""
        pressure, energy = self._pressure(q)
        self._volumes.add_force(pressure, f)
        none = np.zeros(len(pressure))
        kernel.pressure_stiffness(pressure, self._volumes.v, self._volumes.h, none, self._blocks)
        self._matrix_sum.add(self._blocks, K)
        kernel.add_products(
            self._counts * self._kappa / self._rest,
            self._g,
            self._pair_start,
            self._pair_node,
            self._first,
            self._second,
            self._target,
            K,
        )
        return Contribution(energy)


def _stars(mesh: Mesh) -> tuple[Index, Index]:
    """Nodes of the elements around every node, ascending: star of n in star[start[n]:start[n + 1]]."""
    nodes, used = slots(mesh)
    keys = [np.empty(0, dtype=np.int64)]
    for a in range(nodes.shape[1]):
        both = used[:, a, None] & used
        keys.append((nodes[:, a, None] * mesh.n_nodes + nodes)[both])
    centre, star = np.divmod(np.unique(np.concatenate(keys)), mesh.n_nodes)
    start = np.concatenate([[0], np.cumsum(np.bincount(centre, minlength=mesh.n_nodes))])
    return start.astype(np.int64), star


def _star_pairs(start: Index, star: Index) -> tuple[Index, Index, Index]:
    """Centre and two star entries a <= b of every pair within every star."""
    size = np.diff(start)
    entry = np.arange(len(star))
    centre = np.repeat(np.arange(len(size)), size)
    partners = start[centre + 1] - entry  # a star is ascending, so its later entries are b >= a
    a = np.repeat(entry, partners)
    first: Index = np.cumsum(partners) - partners
    offset = np.arange(len(a)) - np.repeat(first, partners)
    return centre[a], a, a + offset
