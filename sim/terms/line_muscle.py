"""Line muscles: tension along polylines between nodes or points inside elements."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from sim._kernels.lines import PARAMETERS, LineTable, tensions
from sim.embedding import embed
from sim.errors import SceneError
from sim.laws.line import ConstantForce, LineLaw
from sim.mesh import Mesh
from sim.multibody import PointForces
from sim.pattern import distinct
from sim.scene import Contribution, Index, Layout
from sim.state import Array, Control


@dataclass(frozen=True, eq=False)
class LineFibre:
    """A polyline with one tension along its whole length, as over frictionless via points.

    Attributes
    ----------
    muscle : int
        Index into the names of its `LineMuscles`.
    points : (k,) of int, nodes (the fibre is then parallel to edges); or (k, 3), rest positions [m] in
        the elements; at least two.
    share : float
        Factor on the tension of the law [1], if several fibres divide the force of a muscle.
    """

    muscle: int
    points: NDArray[Any]
    share: float = 1.0

    def __post_init__(self) -> None:
        """Check points and share."""
        nodes = self.points.ndim == 1 and np.issubdtype(self.points.dtype, np.integer)
        if not (nodes or (self.points.ndim == 2 and self.points.shape[1] == 3)):
            raise SceneError(
                f"line fibre has points of shape {self.points.shape} and type {self.points.dtype}, "
                "expected node indices (k,) or positions (k, 3)"
            )
        if len(self.points) < 2:
            raise SceneError(f"line fibre has {len(self.points)} point, expected at least two")
        if not 0.0 <= self.share < np.inf:
            raise SceneError(f"line fibre: share = {self.share!r}, expected a number >= 0")


@dataclass(frozen=True, eq=False)
class LineMuscles:
    """Line muscles, E = sum over fibres of share w(L, activation) + stiffness/2 (L - L_rest)^2.

    L is the length of the polyline and w the energy of the law. The forces of an embedded point are
    distributed to the nodes of its element by the shape functions.

    Attributes
    ----------
    names : tuple of str
    fibres : sequence of LineFibre
    law : LineLaw, or one per name.
    stiffness : float
        Of a passive spring along every fibre [N/m], which also resists shortening.
    damping : float
        Of a damper along every fibre, force per rate of lengthening [N s/m].
    tolerance : float
        Tolerance for embedded points outside the mesh, as `sim.embedding.embed`.

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
    law: LineLaw | Sequence[LineLaw] = field(default_factory=ConstantForce)
    stiffness: float = 0.0
    damping: float = 0.0
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        """Check muscles, fibres and laws."""
        found = {fibre.muscle for fibre in self.fibres}
        for k, name in enumerate(self.names):
            if k not in found:
                raise SceneError(f"line muscle {name} has no fibre")
        if found - set(range(len(self.names))):
            raise SceneError(
                f"a line fibre refers to muscle {max(found)}, expected 0..{len(self.names) - 1}"
            )
        if isinstance(self.law, Sequence) and len(self.law) != len(self.names):
            raise SceneError(f"{len(self.law)} line laws for {len(self.names)} muscles")
        for name, unit in (("stiffness", "N/m"), ("damping", "N s/m")):
            value = getattr(self, name)
            if not 0.0 <= value < np.inf:
                raise SceneError(f"LineMuscles: {name} = {value!r} {unit}, expected >= 0")

    def laws(self) -> tuple[LineLaw, ...]:
        """One law per name."""
        if isinstance(self.law, Sequence):
            return tuple(self.law)
        return (self.law,) * len(self.names)

    def muscle_names(self) -> tuple[str, ...]:
        """Names of the muscles."""
        return self.names

    def pair_keys(self, mesh: Mesh) -> Index:
        """Node pairs of each segment, and of all segments of a fibre whose tension has a slope."""
        strands = _Strands(self, mesh)
        return distinct(strands.products()[0])

    def compile(self, layout: Layout) -> "CompiledLineMuscles":
        """Lay out segments and the map from them to the matrix."""
        return (DampedLineMuscles if self.damping else CompiledLineMuscles)(self, layout)


class _Strands:
    """Segments d = D q of all fibres, and the pairs of segments coupled by the energy."""

    def __init__(self, term: LineMuscles, mesh: Mesh) -> None:
        self.n_nodes = mesh.n_nodes
        rows, columns, values = list[Index](), list[Index](), list[Array]()
        fibre_of, n = list[int](), 0
        for k, fibre in enumerate(term.fibres):
            nodes, weights = _placed(fibre, mesh, term.tolerance)
            count = len(nodes) - 1
            for shift, sign in ((0, -1.0), (1, 1.0)):
                here = slice(shift, shift + count)
                rows.append(np.repeat(np.arange(n, n + count), nodes.shape[1]))
                columns.append(nodes[here].ravel())
                values.append(sign * weights[here].ravel())
            fibre_of += [k] * count
            n += count
        place = np.concatenate(rows), np.concatenate(columns)
        self.D = csr_array((np.concatenate(values), place), shape=(n, mesh.n_nodes))
        self.D.sum_duplicates()
        self.D.eliminate_zeros()
        self.fibre = np.array(fibre_of, dtype=np.int64)
        length = np.linalg.norm(_product(self.D, mesh.X), axis=1)
        if not (length > 0.0).all():
            bad = int(self.fibre[np.argmin(length > 0.0)])
            raise SceneError(
                f"line fibre {bad} of muscle {term.names[term.fibres[bad].muscle]} has two "
                "successive points at the same position, expected segments of positive "
                "length"
            )
        laws = term.laws()
        coupled = np.array(
            [laws[f.muscle].has_slope or term.stiffness + term.damping > 0.0 for f in term.fibres],
            dtype=bool,
        )
        own = np.arange(n)
        later = [
            (s, np.flatnonzero(self.fibre[s + 1 :] == self.fibre[s]) + s + 1)
            for s in own[coupled[self.fibre]]
        ]
        self.first = np.concatenate([own, *(np.full(len(t), s) for s, t in later)])
        self.second = np.concatenate([own, *(t for _, t in later)])

    def products(self) -> tuple[Index, Index, Array, NDArray[np.bool_]]:
        """Node-pair key, segment pair, coefficient and transposition of every product D_sa D_tb.

        Block (a, b), a <= b, of the stiffness is the sum of coefficient times block (s, t),
        transposed if the segments are in reverse order.
        """
        keys, pair, value, turned = list[Index](), list[Index](), list[Array](), list[bool]()
        sizes = list[int]()
        start, columns, data = self.D.indptr, self.D.indices, self.D.data
        for k, (s, t) in enumerate(zip(self.first, self.second, strict=True)):
            for one, other in ((s, t),) if s == t else ((s, t), (t, s)):
                a = columns[start[one] : start[one + 1]].astype(np.int64)
                b = columns[start[other] : start[other + 1]].astype(np.int64)
                product = np.outer(
                    data[start[one] : start[one + 1]], data[start[other] : start[other + 1]]
                )
                keep = a[:, None] <= b[None, :]
                found = (a[:, None] * self.n_nodes + b[None, :])[keep]
                keys.append(found)
                value.append(product[keep])
                pair.append(np.full(len(found), k))
                turned.append(one != s)
                sizes.append(len(found))
        return (
            np.concatenate(keys),
            np.concatenate(pair),
            np.concatenate(value),
            np.repeat(np.array(turned, dtype=bool), sizes),
        )


class CompiledLineMuscles:
    """Compiled line muscles.

    One constant sparse product, the only cost of the embedding, adds the stiffness of all segment
    pairs to the matrix.
    """

    def __init__(self, term: LineMuscles, layout: Layout) -> None:
        strands = _Strands(term, layout.mesh)
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
        d = _product(self._D, q)
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

    def add_force(self, q: Array, control: Control, f: Array) -> Contribution:
        """Subtract dE/dq from f."""
        _, direction, total = self._lengths(q)
        energy, tension, _ = self._tension(total, control)
        f -= _product(self._Dt, tension[self._fibre][:, None] * direction)
        return Contribution(energy)

    def add_tangent(self, q: Array, control: Control, f: Array, K: Array) -> Contribution:
        """As `add_force`, and K += d2E/dq2."""
        length, direction, total = self._lengths(q)
        energy, tension, slope = self._tension(total, control)
        f -= _product(self._Dt, tension[self._fibre][:, None] * direction)
        s, t = self._first, self._second
        blocks = np.einsum(
            "p,pi,pj->pij", slope[self._fibre[s]], direction[s], direction[t], optimize=False
        )
        own = np.arange(len(length))  # The first pairs are those of every segment with itself.
        across = (tension[self._fibre] / length)[:, None, None]
        blocks[own] += across * (np.eye(3) - direction[:, :, None] * direction[:, None, :])
        K[self._entries] += _product(self._spread, blocks.ravel())
        return Contribution(energy)


class DampedLineMuscles(CompiledLineMuscles):
    """Line muscles with dampers, f = -d (dL/dq)' dL/dt along every fibre."""

    def add_damping(self, q: Array, control: Control, D: Array) -> None:
        """D += d (dL/dq)' dL/dq."""
        _, direction, _ = self._lengths(q)
        s, t = self._first, self._second
        blocks = self._damping * direction[s][:, :, None] * direction[t][:, None, :]
        D[self._entries] += _product(self._spread, blocks.ravel())


def _placed(fibre: LineFibre, mesh: Mesh, tolerance: float) -> tuple[Index, Array]:
    """Nodes (k, m) and weights (k, m) of every point of a fibre."""
    if fibre.points.ndim == 2:
        found = embed(mesh, fibre.points, tolerance=tolerance)
        return found.nodes, found.weights
    nodes = fibre.points.astype(np.int64)
    if nodes.min() < 0 or nodes.max() >= mesh.n_nodes:
        raise SceneError(
            f"a line fibre refers to node {nodes.max()}, expected 0..{mesh.n_nodes - 1}"
        )
    return nodes[:, None], np.ones((len(nodes), 1))


def _table(term: LineMuscles, layout: Layout, rest: Array) -> LineTable:
    """Laws of all fibres by their length at rest."""
    laws = [term.laws()[fibre.muscle] for fibre in term.fibres]
    parameters = np.zeros((len(laws), PARAMETERS))
    for k, law in enumerate(laws):
        own = law.parameters()
        parameters[k, : len(own)] = own
    names = [term.names[fibre.muscle] for fibre in term.fibres]
    number = [layout.muscles.index(n) if n in layout.muscles else -1 for n in names]
    return LineTable(
        np.array(number, dtype=np.int64),
        np.array([fibre.share for fibre in term.fibres], dtype=np.float64),
        rest,
        np.array([law.code for law in laws], dtype=np.int64),
        parameters,
        np.full(len(laws), term.stiffness),
        np.full(len(laws), term.damping),
    )


def _product(matrix: csr_array, x: Array) -> Array:
    return np.asarray(matrix @ x, dtype=np.float64)
