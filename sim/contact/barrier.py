"""Barrier contact (incremental potential contact), which prevents any penetration."""

import math
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from sim.contact.clearance import cleared
from sim.contact.curvature import NormalStiffness
from sim.contact.ipc import Barrier, CollisionPair, Sliding
from sim.contact.surfaces import NodeSurface, Pairing
from sim.errors import NotConverged, SceneError
from sim.mesh import Mesh
from sim.pattern import distinct
from sim.scene import Contribution, Index, Layout
from sim.state import Array, Control, State

CREEP = 0.01  #: fraction of the distance by which sticking contacts may slip until equilibrium


@dataclass(frozen=True, eq=False)
class BarrierContact:
    """Contact by a smooth barrier, E = sum over features of area * stiffness * distance * b(d/distance).

    b(y) = -(y^2 - 1)^2 ln y^2 for y < 1 and 0 otherwise, of the gap d between vertices and
    triangles and between edges. It is unbounded as the gap closes, and continuous collision
    detection limits every displacement of the iteration, so that surfaces never pass through each
    other.

    Raises
    ------
    SceneError
        A number is out of range; on compiling, the package ipctk is missing.
    ContactFailure
        On compiling: a surface is unusable, two surfaces of the mesh touch or cross at rest, or a
        shell overlaps the tissue too far.

    Notes
    -----
    If tissue is initially inside a rigid shell or closer than `distance`, the shell is offset at
    compile time (`sim.contact.clearance`), so that there are no forces at rest and no jumps. Two
    surfaces of the mesh must be separated initially.

    Friction is lagged: over a step it acts with the normal forces and in the tangent planes at the
    start of the step. Only iterative integrators support barriers, and friction requires L-stable
    ones: with the trapezoidal rule tissue bounces on a barrier at every step, and in a test a
    sliding block was decelerated by half of its friction.

    Source: Li et al. 2020, Incremental potential contact, ACM Trans. Graph. 39(4), 49; weights by
    area: Li et al. 2023, Convergent incremental potential contact, arXiv:2307.15908. Computed with
    the IPC Toolkit (ipctk).
    """

    pairings: tuple[Pairing, ...]  #: surfaces that may touch; others are not searched
    friction: float = 0.0  #: Coulomb coefficient [1]
    #: gap below which the barrier acts [m]. Bodies at rest on each other keep a smaller gap
    distance: float = 1e-4
    #: scale of the pressure [Pa]. The pressure is 0.2 times this scale at a gap of 0.9 distance, 4
    #: times at half the distance, ``2 distance/d`` times at small gaps d, and up to three times as large
    #: if the triangles of both surfaces are equally small. Young's modulus of the softer body is a
    #: suitable value; smaller values cause small gaps under load, larger ones slow convergence
    stiffness: float = 2e4
    #: largest distance at rest of triangles of two surfaces of the mesh whose coupling is stored in the
    #: matrix [m]. Larger values enlarge the matrix; contact beyond slows down the iteration without
    #: affecting the result
    reach: float = 5e-3
    #: sliding speed at which friction is fully mobilised [m/s]; sticking contacts creep more slowly
    stick_speed: float = 1e-4

    def __post_init__(self) -> None:
        for name in ("distance", "stiffness", "reach", "stick_speed"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise SceneError(
                    f"BarrierContact: {name} = {getattr(self, name)!r}, expected a number > 0"
                )
        if not 0.0 <= self.friction < math.inf:
            raise SceneError(
                f"BarrierContact: friction = {self.friction!r}, expected a coefficient >= 0"
            )
        if not self.pairings:
            raise SceneError("BarrierContact has no pairings, expected at least one")

    def pair_keys(self, mesh: Mesh) -> Index:
        """Node pairs within reach of each other on two surfaces of the mesh."""
        keys = [np.empty(0, dtype=np.int64)]
        for pairing in self.pairings:
            pairing.check(mesh)
            soft = [s for s in pairing.surfaces if isinstance(s, NodeSurface)]
            if len(soft) == 2 or pairing.itself:
                keys.append(_within(mesh, soft[0], soft[-1], self.reach))
        return np.concatenate(keys)

    def compile(self, layout: Layout) -> "CompiledBarrier":
        """Offset penetrated shells and compile the pairings."""
        return CompiledBarrier(self, layout)


class CompiledBarrier:
    """Compiled barriers; stored search results do not affect the results.

    A coupling of two nodes that the pattern does not contain is replaced by an upper bound on the
    diagonal blocks, which slows down the iteration without affecting its result.
    """

    def __init__(self, part: BarrierContact, layout: Layout) -> None:
        barrier = Barrier(part.distance, part.stiffness, part.friction, part.stick_speed)
        self._part, self._pattern = part, layout.pattern
        self._diagonal = np.full(3 * layout.pattern.n_nodes, -1)
        self._diagonal[layout.pattern.free] = layout.pattern.diagonal
        self.pairs = tuple(cleared(p, layout.mesh.X, barrier) for p in part.pairings)
        self._sliding: tuple[Sliding, ...] | None = None

    def starting(self, state: State, h: float) -> "CompiledBarrier":
        """Barriers over a step of length h [s] from a state, with friction of its contacts."""
        for pair in self.pairs:
            pair.forget()
        if self._part.friction == 0.0 or h == 0.0:
            return self
        slip = self._part.stick_speed * h if h < math.inf else CREEP * self._part.distance
        step = copy(self)
        step._sliding = tuple(
            pair.sliding(pair.vertices(state.q, state.t), slip) for pair in self.pairs
        )
        return step

    def add(self, q: Array, control: Control, f: Array, K: Array | None = None) -> Contribution:
        """Add the repulsive forces of surfaces closer than the distance.

        The stiffness is semi-definite, without rotation of the normals.
        """
        energy = 0.0
        for i, pair in enumerate(self.pairs):
            x = pair.vertices(q, control.t)
            for potential in self._of(i):
                more, gradient = potential.energy(x)
                energy += more
                f[pair.node[: pair.n_soft]] -= gradient[: pair.n_soft]
            if K is None:
                continue
            self._add_normal(pair.node, pair.stiffness(x), K)
            if self._sliding is not None:
                self._add_sliding(pair.node, self._sliding[i].hessian(x), K)
        return Contribution(energy)

    def _of(self, i: int) -> tuple[CollisionPair | Sliding, ...]:
        return (self.pairs[i],) if self._sliding is None else (self.pairs[i], self._sliding[i])

    def largest_step(self, q0: Array, q1: Array, control: Control) -> float:
        """Largest fraction in (0, 1] of the displacement from q0 to q1 without intersection."""
        return min(self._share(pair, q0, q1, control.t, control.t) for pair in self.pairs)

    def carried(self, q: Array, t: float, control: Control) -> Array:
        """Positions q, feasible at time t [s], advected by the shells to the time of the control.

        Free nodes near a shell move with it if it would pass through them.

        Raises NotConverged if the motion of the shell or of the advected nodes is obstructed.
        """
        blocked = [p for p in self.pairs if p.moves and self._share(p, q, q, t, control.t) < 1.0]
        moved = q.copy() if blocked else q
        for pair in blocked:
            pair.carry(moved, self._diagonal >= 0, t, control.t)
        if blocked and min(self._share(p, q, moved, t, control.t) for p in self.pairs) < 1.0:
            name = blocked[0].pairing.name
            raise NotConverged(
                (), control.t, f"in pairing {name!r} a shell moves through the tissue"
            )
        return moved

    def measure(self, state: State, control: Control) -> tuple[Array, Array, Array]:
        """Number of active pairs, smallest gap [m] and normal force [N], per pairing."""
        count, gap, force = (np.zeros(len(self.pairs)) for _ in range(3))
        for i, pair in enumerate(self.pairs):
            pair.forget()  # The measurement depends only on the state.
            x = pair.vertices(state.q, state.t)
            count[i], gap[i] = len(pair.collisions(x)), pair.smallest_distance(x)
            first = next(s for s in pair.pairing.surfaces if isinstance(s, NodeSurface))
            side = np.isin(pair.node, first.nodes)
            force[i] = np.linalg.norm(pair.energy(x)[1][side], axis=1).sum()
        return count, np.where(gap < np.inf, gap, np.nan), force

    @staticmethod
    def _share(pair: CollisionPair, q0: Array, q1: Array, t0: float, t1: float) -> float:
        return pair.largest_step(pair.vertices(q0, t0), pair.vertices(q1, t1))

    def _add_normal(self, node: Index, stiffness: NormalStiffness, K: Array) -> None:
        """Add the stiffness of normal forces; vertex i is node[i], or fixed if that is -1."""
        at = node[stiffness.vertex]
        pair = np.broadcast_to(at[:, :, None], (len(at), 4, 4)), at[:, None, :]
        counts = (stiffness.share != 0.0) & (at >= 0)
        needed = counts[:, :, None] & counts[:, None, :]
        placed = (~needed | self._known(*pair)).all(axis=(1, 2))
        unknown = 3 * at[:, :, None] + np.arange(3)
        unknown[at < 0] = -1
        shape = (len(at), 4, 3, 4, 3)
        row = np.broadcast_to(unknown[:, :, :, None, None], shape)[placed]
        column = np.broadcast_to(unknown[:, None, None, :, :], shape)[placed]
        self._add(row.ravel(), column.ravel(), stiffness.blocks()[placed].ravel(), K)
        if not placed.all():
            shape = (len(at), 4, 3, 3)
            row = np.broadcast_to(unknown[:, :, :, None], shape)[~placed]
            column = np.broadcast_to(unknown[:, :, None, :], shape)[~placed]
            self._add(row.ravel(), column.ravel(), stiffness.own_blocks()[~placed].ravel(), K)

    def _add_sliding(self, node: Index, H: coo_array, K: Array) -> None:
        """Add a positive semi-definite matrix; vertex i is node[i], or fixed if that is -1."""
        row, column = (3 * node[part // 3] + part % 3 for part in (H.row, H.col))
        fixed = (node[H.row // 3] < 0) | (node[H.col // 3] < 0)
        known = fixed | self._known(row // 3, column // 3)
        kept = known & ~fixed
        self._add(row[kept], column[kept], H.data[kept], K)
        # [[|e|, -e], [-e, |e|]] is positive semi-definite; adding it removes e.
        own, size = row[~known], np.abs(H.data[~known])
        place = self._diagonal[own]
        np.add.at(K, place[place >= 0], size[place >= 0])

    def _known(self, a: Index, b: Index) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Test if the pattern couples nodes a and b."""
        keys = np.minimum(a, b) * self._pattern.n_nodes + np.maximum(a, b)
        pairs = self._pattern.pairs
        return pairs[np.minimum(np.searchsorted(pairs, keys), len(pairs) - 1)] == keys

    def _add(self, row: Index, column: Index, value: Array, K: Array) -> None:
        """Add entries between unknowns that the pattern couples; -1 for none."""
        upper = (row >= 0) & (column >= row)
        row, column, value = row[upper], column[upper], value[upper]
        keys = row // 3 * self._pattern.n_nodes + column // 3
        target = self._pattern.target[self._pattern.pair_index(keys), 3 * (row % 3) + column % 3]
        stored = target >= 0
        np.add.at(K, target[stored], value[stored])


def _within(mesh: Mesh, a: NodeSurface, b: NodeSurface, reach: float) -> Index:
    """Keys ``i * n + j``, i <= j, of nodes whose triangles may be within reach of each other."""
    X = mesh.X
    widest = [_widest(X, surface) for surface in (a, b)]
    near = cKDTree(X[a.nodes]).sparse_distance_matrix(
        cKDTree(X[b.nodes]), reach + widest[0].max() + widest[1].max(), output_type="ndarray"
    )
    i, j, apart = (np.asarray(near[name]) for name in ("i", "j", "v"))
    within = apart <= reach + widest[0][i] + widest[1][j]
    i, j = a.nodes[i[within]], b.nodes[j[within]]
    return distinct(np.minimum(i, j) * mesh.n_nodes + np.maximum(i, j))


def _widest(X: Array, surface: NodeSurface) -> Array:
    """Longest edge at every node of a surface [m]."""
    start, end = surface.edges.T
    length = np.linalg.norm(X[start] - X[end], axis=1)
    widest = np.zeros(len(X))
    for nodes in (start, end):
        np.maximum.at(widest, nodes, length)
    return widest[surface.nodes]
