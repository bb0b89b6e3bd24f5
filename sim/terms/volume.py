"""Soft incompressibility: a pressure from the volume of a whole element or of a nodal region.

Both replace the pointwise bulk law of a solid (give that kappa = 0) and use the quadratic potential.
They cure volumetric locking because fewer volumes are constrained than there are Gauss points.
"""

from dataclasses import dataclass

import numpy as np

from sim._kernels import volume as kernel
from sim._kernels.lanes import LANES
from sim.assembly import element_pair_keys, grouped, parts_of, places_of, slots
from sim.errors import SceneError
from sim.mesh import Mesh
from sim.scene import Contribution, Index, Layout
from sim.state import Array, Control
from sim.vectors import dot
from sim.volumes import PointVolumes

NEARBY = 0.2
"""Share of the bulk modulus by which the volume of elements preconditions that of nodes best.

Measured on a face with kappa/mu = 5: 0.1 and 1 need a third more iterations.
"""


@dataclass(frozen=True, eq=False)
class ElementVolume:
    """One pressure per element, E = sum_e kappa_e/2 V_e (v_e/V_e - 1)^2.

    Attributes
    ----------
    kappa : float or (n_elements,) array
        Bulk modulus [Pa]; zero where another law answers for the volume.

    Raises
    ------
    SceneError
        kappa is negative, or nowhere positive, or (on compiling) does not fit the mesh.
    """

    kappa: float | Array = 25e3

    def __post_init__(self) -> None:
        """Check the range."""
        _require_positive(self.kappa)

    def pair_keys(self, mesh: Mesh) -> Index:
        """All pairs of nodes within an element."""
        return element_pair_keys(mesh)

    def compile(self, layout: Layout) -> "CompiledElementVolume":
        """Lay out volumes and sums."""
        return CompiledElementVolume(self.kappa, layout)


@dataclass(frozen=True, eq=False)
class NodalVolume:
    """One pressure per node, E = sum_n kappa_n/2 V_n (v_n/V_n - 1)^2.

    v_n is the volume of the Gauss points that belong to node n: of each element at the node, the point
    in its corner; a tetrahedron gives each of its nodes a quarter (Bonet and Burton 1998). Source: the
    soft nodal incompressibility that Eskes et al. 2017 used, as recorded from the published simulator.

    Attributes
    ----------
    kappa : float or (n_elements,) array
        Bulk modulus [Pa]; kappa_n is its mean over the region of the node, weighted by volume.
    at_fixed : bool
        Whether fully fixed nodes have a pressure, too; in the published simulator they have none.

    Raises
    ------
    SceneError
        kappa is negative, or nowhere positive, or (on compiling) does not fit the mesh.

    Notes
    -----
    Couples all nodes that share a neighbour: the factor is about three times that of other bulk laws.
    """

    kappa: float | Array = 25e3
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

    def nearby(self) -> ElementVolume:
        """Volume of elements, softened, since it resists more of the motions than that of nodes."""
        return ElementVolume(NEARBY * np.asarray(self.kappa, dtype=np.float64)[()])


def _require_positive(kappa: float | Array) -> None:
    values = np.atleast_1d(kappa)
    if not ((values >= 0.0) & (values < np.inf)).all() or not (values > 0.0).any():
        raise SceneError(
            f"soft incompressibility: kappa = {kappa!r}, expected a number > 0, or one >= 0 per element"
        )


def _by_element(kappa: float | Array, mesh: Mesh) -> Array:
    """Bulk modulus of every element (n_elements,), checked."""
    if np.ndim(kappa) and np.shape(kappa) != (mesh.n_elements,):
        raise SceneError(
            f"soft incompressibility: kappa has shape {np.shape(kappa)}, expected one number or "
            f"({mesh.n_elements},)"
        )
    return np.broadcast_to(np.asarray(kappa, dtype=np.float64), (mesh.n_elements,))


class CompiledElementVolume:
    """Element volumes laid out for a scene; the buffers carry nothing between calls."""

    def __init__(self, kappa: float | Array, layout: Layout) -> None:
        self._kappa = np.ascontiguousarray(_by_element(kappa, layout.mesh))
        self._parts = parts_of(layout.mesh)
        self._places = [places_of(layout.mesh, part, layout.pattern) for part in self._parts]
        self._energy = np.zeros(layout.mesh.n_elements)
        self._no_values, self._no_pressure = np.zeros(0), np.zeros((0, LANES))

    def _add(self, q: Array, f: Array, K: Array | None) -> Contribution:
        values = self._no_values if K is None else K
        for part, places in zip(self._parts, self._places, strict=True):
            kernel.add_pressure(
                q,
                part,
                places,
                self._kappa,
                self._no_pressure,
                True,
                K is not None,
                f,
                self._energy,
                values,
            )
        return Contribution(float(self._energy.sum()))

    def add_force(self, q: Array, control: Control, f: Array) -> Contribution:
        """Subtract dE/dq from f."""
        return self._add(q, f, None)

    def add_tangent(self, q: Array, control: Control, f: Array, K: Array) -> Contribution:
        """As `add_force`, and K += d2E/dq2."""
        return self._add(q, f, K)


class CompiledNodalVolume:
    """Nodal volumes laid out for a scene; the buffers carry nothing between calls."""

    def __init__(self, term: NodalVolume, layout: Layout) -> None:
        mesh, pattern = layout.mesh, layout.pattern
        self._volumes = PointVolumes(mesh, pattern)
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

        share = self._volumes.rest[element, point]
        self._rest: Array = np.bincount(owner, share, mesh.n_nodes).astype(np.float64)
        kappa = _by_element(term.kappa, mesh)
        self._kappa: Array = np.full(mesh.n_nodes, kappa[0])
        if np.ptp(kappa) > 0.0:
            own = kappa[element] * share
            self._kappa = np.bincount(owner, own, mesh.n_nodes).astype(np.float64) / self._rest
        self._nodal = np.empty(mesh.n_nodes)
        self._g = np.empty((len(star), 3))
        moves = np.zeros(mesh.n_nodes, dtype=bool)
        moves[pattern.free // 3] = True
        self._counts = np.ones(mesh.n_nodes) if term.at_fixed else moves.astype(np.float64)

    def _pressure(self, q: Array) -> tuple[Array, float]:
        self._volumes.evaluate(q)
        self._volumes.gather(
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
        return pressure, 0.5 * dot(self._kappa * self._rest, strain**2)

    def add_force(self, q: Array, control: Control, f: Array) -> Contribution:
        """Subtract dE/dq from f."""
        pressure, energy = self._pressure(q)
        self._volumes.add_pressure(q, pressure, f)
        return Contribution(energy)

    def add_tangent(self, q: Array, control: Control, f: Array, K: Array) -> Contribution:
        """As `add_force`, and K += d2E/dq2, which couples second neighbours."""
        pressure, energy = self._pressure(q)
        self._volumes.add_pressure(q, pressure, f, K)
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
