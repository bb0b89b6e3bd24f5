"""Line muscles: tension along polylines between nodes or points inside elements."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array

from sim._kernels.lines import PARAMETERS, LineTable, tensions
from sim.checks import real_numbers
from sim.errors import SceneError
from sim.laws.line import ConstantForce, LineLaw
from sim.laws.rate import ForceVelocity
from sim.mesh import Mesh
from sim.multibody import PointForces
from sim.pattern import distinct
from sim.scene import CompiledTerm, Contribution, Index, Layout, Term
from sim.state import Array, Control
from sim.terms.strands import LineFibre, Strands, product_of


@dataclass(frozen=True, eq=False)
@real_numbers
class LineMuscles(Term):
    """Line muscles, E = sum over fibres of share w(L, activation) + stiffness/2 (L - L_rest)^2.

    L is the length of the polyline and w the energy of the law. The forces of an embedded point are
    distributed to the nodes of its element by the shape functions.

    Raises
    ------
    MeshError
        On compiling, a point lies in no element.

    Notes
    -----
    At constant tension the only stiffness is that of a taut string, F/L perpendicular to the line.
    Source: the cable elements of the published reference face.
    """

    names: tuple[str, ...]
    fibres: Sequence[LineFibre]
    #: LineLaw, or one per name
    law: LineLaw | Sequence[LineLaw] = field(default_factory=ConstantForce)
    #: of a passive spring along every fibre [N/m], which also resists shortening
    stiffness: float = 0.0
    damping: float = 0.0  #: of a damper along every fibre, force per rate of lengthening [N s/m]
    #: factor on the active tension at the rate of stretch dL/dt/L_rest
    relation: ForceVelocity | Sequence[ForceVelocity] | None = None
    #: tolerance for embedded points outside the mesh, as `sim.embedding.embed`
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        named = {fibre.muscle for fibre in self.fibres}
        if named - set(range(len(self.names))):
            raise SceneError(
                f"a line fibre refers to muscle {max(named)}, expected 0..{len(self.names) - 1}"
            )
        for k, name in enumerate(self.names):
            if k not in named:
                raise SceneError(f"line muscle {name} has no fibre")
        for what, given in (("line laws", self.law), ("relations", self.relation)):
            if isinstance(given, Sequence) and len(given) != len(self.names):
                raise SceneError(f"{len(given)} {what} for {len(self.names)} muscles")
        for name, unit in (("stiffness", "N/m"), ("damping", "N s/m")):
            value = getattr(self, name)
            if not 0.0 <= value < np.inf:
                raise SceneError(f"LineMuscles: {name} = {value!r} {unit}, expected >= 0")

    def laws(self) -> tuple[LineLaw, ...]:
        """One law per name."""
        if isinstance(self.law, Sequence):
            return tuple(self.law)
        return (self.law,) * len(self.names)

    def relations(self) -> tuple[ForceVelocity, ...]:
        """One relation per name; none without."""
        if self.relation is None or isinstance(self.relation, Sequence):
            return tuple(self.relation or ())
        return (self.relation,) * len(self.names)

    def muscle_names(self) -> tuple[str, ...]:
        """Names of the muscles."""
        return self.names

    def pair_keys(self, mesh: Mesh) -> Index:
        """Node pairs of each segment, and of all segments of a fibre whose tension has a slope."""
        return distinct(self.strands(mesh).products()[0])

    def strands(self, mesh: Mesh) -> Strands:
        """Segments of all fibres."""
        laws, always = self.laws(), self.stiffness + self.damping > 0.0 or self.relation is not None
        coupled = [laws[fibre.muscle].has_slope or always for fibre in self.fibres]
        return Strands(self.fibres, self.names, np.array(coupled, bool), mesh, self.tolerance)

    def compile(self, layout: Layout) -> "CompiledLineMuscles":
        """Lay out segments and the map from them to the matrix."""
        if self.relation is not None:
            return RateLineMuscles(self, layout)
        return (DampedLineMuscles if self.damping else CompiledLineMuscles)(self, layout)


class CompiledLineMuscles(CompiledTerm):
    """Compiled line muscles.

    One constant sparse product, the only cost of the embedding, adds the stiffness of all segment
    pairs to the matrix.
    """

    def __init__(self, term: LineMuscles, layout: Layout) -> None:
        strands = term.strands(layout.mesh)
        self._D, self._Dt = strands.D, strands.D.T.tocsr()
        self._fibre, self._n_fibres = strands.fibre, len(term.fibres)
        self._first, self._second = strands.first, strands.second
        self._damping = term.damping
        self.table = _table(term, layout, self._lengths(layout.mesh.X)[2])
        self._paths = [fibre.points for fibre in term.fibres]

        keys, pair, value, turned = strands.products()
        block, i = np.divmod(np.arange(9 * len(keys)), 9)
        source = np.where(turned[block], 3 * (i % 3) + i // 3, i) + 9 * pair[block]
        target = layout.pattern.target[layout.pattern.pair_index(keys)].ravel().astype(np.int64)
        stored = target >= 0
        self._entries, row = np.unique(target[stored], return_inverse=True)
        self._spread = csr_array(
            (value[block][stored], (row, source[stored])),
            shape=(len(self._entries), 9 * len(self._first)),
        )

    def _lengths(self, q: Array) -> tuple[Array, Array, Array]:
        """Segment lengths and directions, and the length of every fibre."""
        d = product_of(self._D, q)
        length = np.sqrt((d * d).sum(axis=1))
        total = np.bincount(self._fibre, length, self._n_fibres)
        return length, d / length[:, None], total.astype(np.float64)

    def _tension(self, total: Array, control: Control) -> tuple[float, Array, Array]:
        """Energy of all fibres, and tension and slope of each."""
        tension, slope = np.empty(self._n_fibres), np.empty(self._n_fibres)
        energy = tensions(self.table, total, control.activation, tension, slope)
        return energy, tension, slope

    def add_to(self, forces: PointForces) -> None:
        """Add the fibres, whose points are not embedded in a mesh."""
        forces.lines.append((self.table, self._paths))

    def add(self, q: Array, control: Control, f: Array, K: Array | None = None) -> Contribution:
        """Subtract dE/dq from f, and add d2E/dq2 to K."""
        length, direction, total = self._lengths(q)
        energy, tension, slope = self._tension(total, control)
        f -= product_of(self._Dt, tension[self._fibre][:, None] * direction)
        if K is None:
            return Contribution(energy)
        s, t = self._first, self._second
        blocks = np.einsum(
            "p,pi,pj->pij", slope[self._fibre[s]], direction[s], direction[t], optimize=False
        )
        own = np.arange(len(length))  # The first pairs are those of every segment with itself.
        across = (tension[self._fibre] / length)[:, None, None]
        blocks[own] += across * (np.eye(3) - direction[:, :, None] * direction[:, None, :])
        K[self._entries] += product_of(self._spread, blocks.ravel())
        return Contribution(energy)


class DampedLineMuscles(CompiledLineMuscles):
    """Line muscles with dampers, f = -d (dL/dq)' dL/dt along every fibre."""

    def add_damping(self, q: Array, control: Control, D: Array) -> None:
        """D += d (dL/dq)' dL/dq."""
        _, direction, _ = self._lengths(q)
        s, t = self._first, self._second
        blocks = self._damping * direction[s][:, :, None] * direction[t][:, None, :]
        D[self._entries] += product_of(self._spread, blocks.ravel())


class RateLineMuscles(DampedLineMuscles):
    """Line muscles with a force-velocity relation, f = -(dL/dq)' F_act (f_v(dL/dt/L_rest) - 1)."""

    def __init__(self, term: LineMuscles, layout: Layout) -> None:
        super().__init__(term, layout)
        own = [term.relations()[fibre.muscle] for fibre in term.fibres]
        self._relations = [
            (relation, np.array([k for k, other in enumerate(own) if other == relation]))
            for relation in dict.fromkeys(own)
        ]

    def add_rate_force(self, q: Array, v: Array, control: Control, f: Array, D: Array) -> None:
        """F += forces at velocities v (n_nodes, 3), and D += -df/dv."""
        _, direction, total = self._lengths(q)
        lengthening = (direction * product_of(self._D, v)).sum(axis=1)
        rate = np.bincount(self._fibre, lengthening, self._n_fibres) / self.table.rest
        passive = Control(np.zeros_like(control.activation), control.t)
        active = self._tension(total, control)[1] - self._tension(total, passive)[1]
        factor, slope = np.ones_like(rate), np.zeros_like(rate)
        for relation, fibres in self._relations:
            factor[fibres], slope[fibres] = relation.evaluate(rate[fibres])
        f -= product_of(self._Dt, (active * (factor - 1.0))[self._fibre][:, None] * direction)
        s, t = self._first, self._second
        along = (active * slope / self.table.rest)[self._fibre[s], None, None]
        blocks = along * direction[s][:, :, None] * direction[t][:, None, :]
        D[self._entries] += product_of(self._spread, blocks.ravel())


def _table(term: LineMuscles, layout: Layout, rest: Array) -> LineTable:
    """Laws of all fibres by their length at rest."""
    laws = [term.laws()[fibre.muscle] for fibre in term.fibres]
    parameters = np.zeros((len(laws), PARAMETERS))
    for k, law in enumerate(laws):
        own = law.parameters()
        parameters[k, : len(own)] = own
    names = [term.names[fibre.muscle] for fibre in term.fibres]
    number = [layout.muscles.index(n) if n in layout.muscles else -1 for n in names]
    relation = np.zeros((len(laws), 3))
    for k, fibre in enumerate(term.fibres if term.relation is not None else ()):
        own = term.relations()[fibre.muscle]
        relation[k] = own.v_max, own.curvature, own.lengthening
    return LineTable(
        np.array(number, dtype=np.int64),
        np.array([fibre.share for fibre in term.fibres], dtype=np.float64),
        rest,
        np.array([law.code for law in laws], dtype=np.int64),
        parameters,
        np.full(len(laws), term.stiffness),
        np.full(len(laws), term.damping),
        relation,
    )
