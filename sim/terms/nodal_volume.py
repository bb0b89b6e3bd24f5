"""Soft incompressibility: a pressure from the volume of the region of a node.

It replaces the pointwise bulk law of a solid, whose kappa must be 0, and uses the quadratic
potential. It prevents volumetric locking because fewer volumes are constrained than there are Gauss
points.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sim._kernels import volume as kernel
from sim.assembly import element_pair_keys, grouped, slots
from sim.checks import real_numbers
from sim.dense import dot
from sim.linear.contract import LowRankTerm
from sim.mesh import Mesh
from sim.pattern import distinct
from sim.scene import CompiledTerm, Contribution, Index, Layout, Term
from sim.state import Array, Control
from sim.terms.volume import CompiledElementVolume, kappa_by_element, require_positive
from sim.volumes import PointVolumes

STAND_IN = 0.2
"""Optimal fraction of the bulk modulus in the element-volume preconditioner.

Element volumes constrain more motions than nodal volumes. On a face with kappa/mu = 5, fractions of
0.1 and 1 require a third more iterations.
"""


@dataclass(frozen=True, eq=False)
@real_numbers
class NodalVolume(Term):
    """One pressure per node, E = sum_n kappa_n/2 V_n (v_n/V_n - 1)^2.

    v_n is the volume of the Gauss points that belong to node n: of each element at the node, the
    point in its corner; a quarter of a tetrahedron belongs to each of its nodes (Bonet and Burton
    1998). Source: the soft nodal incompressibility used by Eskes et al. 2017, as recorded from the
    published simulator.

    Notes
    -----
    All nodes with a common neighbour are coupled, so that the factor is about three times that of
    other bulk laws.
    """

    #: bulk modulus [Pa], also (n_elements,); kappa_n is its mean over the region of the node,
    #: weighted by volume
    kappa: float | Array = 25e3
    at_fixed: bool = False  #: fully fixed nodes have a pressure, unlike in the published simulator
    #: (n_elements, NODES, 3) as that of the `Solid`, whose volumes are then V_n [m]
    stress_free: Array | None = None

    def __post_init__(self) -> None:
        require_positive(self.kappa)

    def pair_keys(self, mesh: Mesh) -> Index:
        """All pairs of nodes within the elements around a node."""
        star_start, star = _stars(mesh)
        _, a, b = _star_pairs(star_start, star)
        return distinct(star[a] * mesh.n_nodes + star[b])

    def compile(self, layout: Layout) -> "CompiledNodalVolume":
        """Lay out volumes, stars and sums."""
        return CompiledNodalVolume(self, layout)

    def sparse(self) -> "SparseNodalVolume":
        """Same term, with the coupling of second neighbours as a matrix-free product."""
        return SparseNodalVolume(self)


@dataclass(frozen=True, eq=False)
class SparseNodalVolume(Term):
    """Pressures of a `NodalVolume` with their stiffness in two parts.

    The part p d2v/dx2 couples the nodes within elements and is assembled; the part
    sum_n kappa_n/V_n g_n g_n' with g_n = dv_n/dx, which couples second neighbours, is a product.
    """

    term: NodalVolume

    def pair_keys(self, mesh: Mesh) -> Index:
        """All pairs of nodes within an element."""
        return element_pair_keys(mesh)

    def compile(self, layout: Layout) -> "CompiledSparseNodalVolume":
        """Lay out volumes, stars and sums."""
        return CompiledSparseNodalVolume(self.term, layout)


class _NodalPressures(CompiledTerm):
    """Nodal volumes and their forces; the buffers contain no state between calls."""

    def __init__(self, term: NodalVolume, layout: Layout) -> None:
        mesh, pattern = layout.mesh, layout.pattern
        self._volumes = PointVolumes(mesh, pattern, term.stress_free)
        nodes, used = slots(mesh)
        self._is_point = self._volumes.rest > 0.0
        element, point = np.nonzero(self._is_point)
        owner = nodes[element, point]  # Quadrature point k is that in the corner of node k.
        order, start = grouped(owner, mesh.n_nodes)
        self._owner = np.zeros(self._volumes.rest.shape, dtype=np.int64)
        self._owner[element, point] = owner

        self._star_start, self._star = _stars(mesh)
        centre = np.repeat(np.arange(mesh.n_nodes), np.diff(self._star_start))
        own = element[order]
        wanted = owner[order][:, None] * mesh.n_nodes + nodes[own]
        place = np.searchsorted(centre * mesh.n_nodes + self._star, wanted)
        place[~used[own]] = -1
        self._of_nodes = kernel.NodePoints(start, own, point[order], place, self._star_start)

        share = self._volumes.rest[element, point]
        self._rest: Array = np.bincount(owner, share, mesh.n_nodes).astype(np.float64)
        tissue = self._rest > 0.0  # Points of bodies have no volume.
        self._rest[~tissue] = 1.0
        kappa = kappa_by_element(term.kappa, mesh)
        self._kappa: Array = np.full(mesh.n_nodes, kappa[0])
        if np.ptp(kappa) > 0.0:
            own = kappa[element] * share
            self._kappa = np.bincount(owner, own, mesh.n_nodes).astype(np.float64) / self._rest
        moves = np.zeros(mesh.n_nodes, dtype=bool)
        moves[pattern.free // 3] = True
        self._counts = (tissue if term.at_fixed else tissue & moves).astype(np.float64)
        self._stiffness = self._counts * self._kappa / self._rest
        self._nodal = np.empty(mesh.n_nodes)
        self._g = np.empty((len(self._star), 3))

    def _pressure(self, nodal: Array) -> tuple[Array, float]:
        strain = self._counts * (nodal / self._rest - 1.0)
        pressure = np.ascontiguousarray((self._kappa * strain)[self._owner] * self._is_point)
        return pressure, 0.5 * dot(self._kappa * self._rest, strain**2)

    def add(self, q: Array, control: Control, f: Array, K: Array | None = None) -> Contribution:
        """Subtract dE/dq from f; the stiffness is p d2v/dx2, which couples nodes within elements."""
        if K is None:
            self._volumes.evaluate(q)
            nodal = np.bincount(self._owner.ravel(), self._volumes.v.ravel(), len(self._rest))
            nodal = nodal.astype(np.float64, copy=False)
        else:
            self._evaluate(q)
            nodal = self._nodal
        pressure, energy = self._pressure(nodal)
        self._volumes.add_pressure(q, pressure, f, K)
        return Contribution(energy)

    def _evaluate(self, q: Array) -> None:
        """Fill volumes and derivatives, of points and of nodes."""
        self._volumes.evaluate(q)
        self._volumes.gather(self._of_nodes, self._nodal, self._g)


class CompiledNodalVolume(_NodalPressures):
    """Compiled nodal volumes with a fully assembled stiffness."""

    def __init__(self, term: NodalVolume, layout: Layout) -> None:
        super().__init__(term, layout)
        mesh, pattern, star = layout.mesh, layout.pattern, self._star
        centre, a, b = _star_pairs(self._star_start, star)
        keys = star[a] * mesh.n_nodes + star[b]
        pair = distinct(keys)
        group = np.searchsorted(pair, keys)
        order, self._pair_start = grouped(group.astype(np.int64), len(pair))
        self._pair_node = centre[order].astype(np.int32)
        self._first, self._second = a[order].astype(np.int32), b[order].astype(np.int32)
        self._target = np.ascontiguousarray(pattern.target[pattern.pair_index(pair)])

    def add(self, q: Array, control: Control, f: Array, K: Array | None = None) -> Contribution:
        """As before, with the stiffness of the products, which couples second neighbours."""
        evaluation = super().add(q, control, f, K)
        if K is not None:
            places = self._pair_start, self._pair_node, self._first, self._second, self._target
            kernel.add_products(self._stiffness, self._g, *places, K)
        return evaluation


class CompiledSparseNodalVolume(_NodalPressures):
    """Compiled nodal volumes with the stiffness in two parts."""

    def __init__(self, term: NodalVolume, layout: Layout) -> None:
        super().__init__(term, layout)
        n_nodes, pattern = layout.mesh.n_nodes, layout.pattern
        number = np.full(3 * n_nodes, -1, dtype=np.int64)
        number[pattern.free] = np.arange(pattern.n)
        column = number[(3 * self._star[:, None] + np.arange(3)).ravel()]
        centre = np.repeat(np.arange(n_nodes), 3 * np.diff(self._star_start))
        self._active = np.flatnonzero(self._stiffness > 0.0)
        self._entries = np.flatnonzero((column >= 0) & (self._stiffness[centre] > 0.0))
        row = np.searchsorted(self._active, centre[self._entries])
        size = np.bincount(row, minlength=len(self._active))
        self._indptr = np.concatenate([[0], np.cumsum(size)]).astype(np.int32)
        self._columns = column[self._entries].astype(np.int32)
        self._shape = (len(self._active), pattern.n)
        kappa = STAND_IN * kappa_by_element(term.kappa, layout.mesh)
        self._preconditioner = CompiledElementVolume(kappa, layout, term.stress_free)
        self._no_control = Control(np.zeros(len(layout.muscles)))
        self._at: Array | None = None
        self._product: LowRankTerm | None = None

    def _evaluate(self, q: Array) -> None:
        # Tangent and products of one configuration are requested successively.
        if self._at is None or not np.array_equal(self._at, q):
            super()._evaluate(q)
            self._at, self._product = q.copy(), None

    def product(self, q: Array) -> LowRankTerm:
        """Matrix-free part of d2E/dq2 at q."""
        self._evaluate(q)
        if self._product is None:
            values = self._g.reshape(-1)[self._entries]
            G = csr_array((values, self._columns, self._indptr), shape=self._shape)
            self._product = LowRankTerm(G, self._stiffness[self._active])
        return self._product

    def add_preconditioner_values(self, q: Array, K: Array) -> None:
        """K += the stiffness of softened element volumes, which approximates that of the product."""
        self._preconditioner.add(q, self._no_control, np.zeros_like(q), K)


def _stars(mesh: Mesh) -> tuple[Index, Index]:
    """Nodes of the elements around every node, ascending: star of n in star[start[n]:start[n + 1]]."""
    nodes, used = slots(mesh)
    keys = [np.empty(0, dtype=np.int64)]
    for a in range(nodes.shape[1]):
        both = used[:, a, None] & used
        keys.append((nodes[:, a, None] * mesh.n_nodes + nodes)[both])
    centre, star = np.divmod(distinct(np.concatenate(keys)), mesh.n_nodes)
    start = np.concatenate([[0], np.cumsum(np.bincount(centre, minlength=mesh.n_nodes))])
    return start.astype(np.int64), star


def _star_pairs(start: Index, star: Index) -> tuple[Index, Index, Index]:
    """Centre and two star entries a <= b of every pair within every star."""
    size = np.diff(start)
    entry = np.arange(len(star))
    centre = np.repeat(np.arange(len(size)), size)
    partners = start[centre + 1] - entry  # Stars are sorted, so that later entries are b >= a.
    a = np.repeat(entry, partners)
    first: Index = np.cumsum(partners) - partners
    offset = np.arange(len(a)) - np.repeat(first, partners)
    return centre[a], a, a + offset
