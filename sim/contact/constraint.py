"""Contact by constraints, as published: vertices of one surface against the faces of the other."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim.contact.rows import Rows
from sim.contact.search import (
    NO_NORMALS,
    Found,
    SignedFaces,
    entered_faces,
    faces_within,
    nearest_faces,
)
from sim.contact.surfaces import NodeSurface, Pairing, RigidShell, Surface
from sim.errors import SceneError
from sim.mesh import Mesh
from sim.pattern import SymmetricPattern
from sim.scene import Contribution, Index, Layout
from sim.state import Array, Control, State

MEMORY = "contact"
SELF_DEPTH = (
    0.2  # of the approach: what may lie behind a face of its own surface and still touch it
)
BLUR = 0.2  # of the approach: how far edges are rounded in the directions of rows
ALLOWED, FORCE, PUSH, FRICTION = 0, 1, slice(2, 5), slice(5, 8)
COLUMNS = 8  # of the memory: depth allowed [m], normal force, its vector, friction [N]


@dataclass(frozen=True, eq=False)
class ConstraintContact:
    """Vertices that may not pass the faces opposite, held by multipliers.

    Every vertex of a surface of the mesh near the other surface of its pairing gets a row: the gap to
    its nearest face, along the direction from that face, stays >= 0; in a groove it gets one for each
    wall. Between two surfaces of the mesh
    both take the part of the vertices. Rows that would pull let go. What still has come to lie inside
    is moved out by a correction of the positions that leaves the velocities alone.

    Attributes
    ----------
    pairings : tuple of Pairing
    friction : float or tuple of float
        Coulomb's coefficient, of all pairings or of each.
    reach : float
        Largest distance at rest of a vertex and a face of the mesh that may ever touch [m]; all such
        pairs have a place in the matrix, so that it is analysed once.
    approach : float
        Rows are made for vertices nearer than this to a face [m]. A vertex that meets a face from
        farther away within one step is found by the way it takes, and its step is solved again.

    Raises
    ------
    SceneError
        A number is out of range, or there is no pairing.
    ContactFailure
        On compiling: a surface is unusable; in a step: a vertex and a face touch that lie
        farther apart at rest than `reach`.

    Notes
    -----
    Overlap at the start: a vertex that begins inside a closed surface may stay as deep as it is and
    come out, and may never go back in; it does not jump. Behind an open surface, which has a front and
    no inside, vertices farther away than `approach` are left alone, also those that pass around its
    free edge. A surface never touches itself through its own thickness: faces that do not oppose a
    vertex, and those it belongs to, are left out. Nodes that both surfaces of a pairing share belong to
    neither's vertices.

    Source: contact of the published model (Stavness et al., 11.3.3: vertices against opposing faces,
    direction of the nearest face, released when they would separate). The rows here are unilateral.
    """

    pairings: tuple[Pairing, ...]
    friction: float | tuple[float, ...] = 0.0
    reach: float = 0.01
    approach: float = 5e-4

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not self.pairings:
            raise SceneError("a contact has no pairings, expected at least one")
        if len(self.frictions) != len(self.pairings):
            raise SceneError(
                f"friction has {len(self.frictions)} values for {len(self.pairings)} pairings, expected "
                "one number or one per pairing"
            )
        for name, value in (
            *(("friction", value) for value in self.frictions),
            ("reach", self.reach),
        ):
            if not 0.0 <= value < np.inf:
                raise SceneError(f"ConstraintContact: {name} = {value!r}, expected a number >= 0")
        if not 0.0 < self.approach < np.inf:
            raise SceneError(
                f"ConstraintContact: approach = {self.approach!r}, expected a number > 0"
            )

    @property
    def frictions(self) -> tuple[float, ...]:
        """Coefficient of every pairing."""
        if isinstance(self.friction, tuple):
            return self.friction
        return (float(self.friction),) * len(self.pairings)

    def pair_keys(self, mesh: Mesh) -> Index:
        """Pairs of nodes of two surfaces of the mesh within reach, and those of their triangles."""
        keys = [np.empty(0, dtype=np.int64)]
        for pairing in self.pairings:
            pairing.check(mesh)
            a, b = (pairing.surfaces * 2)[:2]
            if not (isinstance(a, NodeSurface) and isinstance(b, NodeSurface)):
                continue
            for one, other in ((a, b),) if pairing.itself else ((a, b), (b, a)):
                near = faces_within(mesh.X[one.nodes], mesh.X, other.triangles, self.reach)
                vertex, face = np.nonzero(near)
                vertex = np.repeat(one.nodes[vertex], 3)
                corner = other.triangles[face].ravel()
                keys.append(np.minimum(vertex, corner) * mesh.n_nodes + np.maximum(vertex, corner))
                keys.append(other.edges[:, 0] * mesh.n_nodes + other.edges[:, 1])
        return np.unique(np.concatenate(keys))

    def compile(self, layout: Layout) -> "CompiledContact":
        """Lay out the directions of all pairings."""
        return CompiledContact(self, layout)


@dataclass(frozen=True, eq=False)
class _Direction:
    """Vertices of one surface against the faces of another."""

    pairing: int
    friction: float
    vertices: Index
    slots: Index
    own: SignedFaces
    faces: Surface
    signs: SignedFaces
    itself: bool


class CompiledContact:
    """Contact laid out for a scene; it exerts no force as a term, integrators hold its rows."""

    def __init__(self, contact: ConstraintContact, layout: Layout) -> None:
        self.pattern: SymmetricPattern = layout.pattern
        self.names: tuple[str, ...] = tuple(pairing.name for pairing in contact.pairings)
        self.reach, self._approach = contact.reach, contact.approach
        self._n_nodes = layout.mesh.n_nodes
        free = np.zeros(3 * layout.mesh.n_nodes, dtype=bool)
        free[layout.pattern.free] = True
        self._free = free.reshape(-1, 3)
        self._directions: list[_Direction] = []
        first = 0
        for i, pairing in enumerate(contact.pairings):
            pairs = (pairing.surfaces * 2)[:2]
            for a, b in (pairs,) if pairing.itself else (pairs, pairs[::-1]):
                if isinstance(a, RigidShell):
                    continue
                vertices = np.setdiff1d(a.nodes, pairing.shared)
                slots = first + np.arange(len(vertices))
                first += len(vertices)
                self._directions.append(
                    _Direction(
                        i,
                        contact.frictions[i],
                        vertices,
                        slots,
                        SignedFaces(a),
                        b,
                        SignedFaces(b),
                        pairing.itself,
                    )
                )
        self._n_slots = first
        none = np.empty(0, dtype=np.int64)
        self.pairing_of_slot: Index = np.concatenate(
            [none] + [np.full(len(d.slots), d.pairing) for d in self._directions]
        )
        self.vertex_of_slot: Index = np.concatenate([none] + [d.vertices for d in self._directions])

    def add_force(self, q: Array, control: Control, f: Array) -> Contribution:
        """Nothing: multipliers hold the surfaces apart."""
        return Contribution(0.0)

    def add_tangent(self, q: Array, control: Control, f: Array, K: Array) -> Contribution:
        """Nothing, as `add_force`."""
        return Contribution(0.0)

    def measure(self, state: State, control: Control) -> tuple[Array, Array, Array]:
        """Places that push, smallest gap beyond what was allowed [m], normal force [N], per pairing."""
        memory, n = self.remembered(state.memory, state.q, state.t), len(self.names)
        count, gap, force = np.zeros(n), np.full(n, np.inf), np.zeros(n)
        np.add.at(force, self.pairing_of_slot, memory[:, FORCE])
        np.add.at(count, self.pairing_of_slot, memory[:, FORCE] > 0.0)
        near = self.find(state.q, state.q, state.t, state.t, memory[:, ALLOWED].copy())
        np.minimum.at(gap, near.pairing, near.gap)
        return count, np.where(gap < np.inf, gap, np.nan), force

    def remembered(self, memory: Mapping[str, Array], q: Array, t: float) -> Array:
        """Memory of a state, (n_slots, COLUMNS).

        Parameters
        ----------
        memory : of the state.
        q, t : its positions [m] and time [s]; where it has no memory, what lies inside now may stay.
        """
        if MEMORY in memory:
            return memory[MEMORY]
        new = np.zeros((self._n_slots, COLUMNS))
        for d in self._directions:
            if d.itself:
                continue
            x = _positions(d.faces, q, t)
            # an open surface has no inside, a closed one has all depths
            radius = np.inf if d.faces.closed else self._approach
            found = nearest_faces(q[d.vertices], radius, x, d.faces.triangles)
            gap, _ = d.signs.signed(q[d.vertices], found, x)
            new[d.slots[found.point], ALLOWED] = np.maximum(-np.nan_to_num(gap), 0.0)
        return new

    def find(
        self,
        q: Array,
        q0: Array,
        t0: float,
        t1: float,
        allowed: Array,
        way: Array | None = None,
    ) -> Rows:
        """Rows of all vertices near a face.

        Parameters
        ----------
        q : (n_nodes, 3) positions to look at [m].
        q0 : (n_nodes, 3) positions at the start of the step, from which displacements are counted [m].
        t0, t1 : float
            Start and end of the step [s]; shells are where they are at t0 if `q` is `q0`, else at t1.
        allowed : (n_slots,) depth that vertices may have [m].
        way : (n_slots,) or None
            How far each vertex may come in the step [m].
        """
        at_start = q is q0
        parts = [self._rows_of(d, q, q0, t0, t1, at_start, allowed, way) for d in self._directions]
        return _united(parts)

    def entered(self, q: Array, q0: Array, t0: float, t1: float) -> Rows:
        """Rows of the vertices that enter a face on their way from q0 to q, against that face.

        The direction is the normal of the face at the end.
        """
        parts: list[Rows] = []
        for d in self._directions:
            x0, x1 = _positions(d.faces, q0, t0), _positions(d.faces, q, t1)
            nodes = d.vertices if isinstance(d.faces, NodeSurface) else np.full(len(d.vertices), -1)
            found = entered_faces(
                q0[d.vertices], q[d.vertices], x0, x1, d.faces.triangles, nodes=nodes
            )
            normal = d.signs.normals(x1)[0][found.face]
            at = np.einsum("kj,kji->ki", found.weight, x1[d.faces.triangles[found.face]])
            gap = np.einsum("ki,ki->k", normal, q[d.vertices[found.point]] - at)
            parts.append(self._rows(d, found, normal, gap, q - q0, x0, x1))
        return _united(parts)

    def _rows_of(
        self,
        d: _Direction,
        q: Array,
        q0: Array,
        t0: float,
        t1: float,
        at_start: bool,
        allowed: Array,
        way: Array | None,
    ) -> Rows:
        x0, x1 = _positions(d.faces, q0, t0), _positions(d.faces, q, t1)
        x = x0 if at_start else x1
        points, may = q[d.vertices], allowed[d.slots]
        radius = self._approach + may + (0.0 if way is None else way[d.slots])
        of_mesh = isinstance(d.faces, NodeSurface)
        nodes = d.vertices if of_mesh else np.full(len(d.vertices), -1)
        away = d.signs.normals(x)[1][d.vertices] if d.itself else NO_NORMALS
        found = nearest_faces(points, radius, x, d.faces.triangles, nodes=nodes, away=away)
        mine = d.own.normals(q)[1][d.vertices]
        gap, normal = d.signs.signed(points, found, x, BLUR * self._approach, mine)
        beside, *more = d.signs.beside(points, found, x, BLUR * self._approach)
        gap, normal = np.r_[gap, more[0]], np.r_[normal, more[1]]
        found = found.joined(beside)
        deepest = -SELF_DEPTH * self._approach if d.itself else -np.inf
        good = np.flatnonzero((gap > deepest) & (gap + may[found.point] < radius[found.point]))
        found, gap, normal = found.take(good), gap[good], normal[good]
        if at_start and not d.faces.closed:
            # nothing that came through the front lies this deep: it came around a free edge
            behind = np.flatnonzero(gap + may[found.point] < -SELF_DEPTH * self._approach)
            may[found.point[behind]] = -gap[behind]
            allowed[d.slots] = may
        if at_start and isinstance(d.faces, RigidShell) and d.faces.motion is not None:
            turn = d.faces.rotation(t1) @ d.faces.rotation(t0).T
            way_out = gap[:, None] * normal
            normal = normal @ turn.T
            gap = np.einsum("ki,ki->k", way_out, normal)
        u = np.zeros_like(q) if at_start else q - q0
        return self._rows(
            d, found, normal, gap + may[found.point], u, x0, x1, gap_moves=not at_start
        )

    def _rows(
        self,
        d: _Direction,
        found: Found,
        normal: Array,
        gap: Array,
        u: Array,
        x0: Array,
        x1: Array,
        gap_moves: bool = True,
    ) -> Rows:
        """Rows with their gaps carried back to where nothing of the mesh has moved."""
        vertex, k = d.vertices[found.point], len(found.point)
        corners = d.faces.triangles[found.face]
        weight = np.ones((k, 4))
        if isinstance(d.faces, NodeSurface):
            nodes, weight[:, 1:] = np.c_[vertex, corners], -found.weight
            carried = np.zeros((k, 3))
        else:
            nodes, weight[:, 1:] = np.repeat(vertex[:, None], 4, axis=1), 0.0
            carried = np.einsum("kj,kji->ki", found.weight, x1[corners] - x0[corners])
        rows = Rows(
            d.slots[found.point],
            found.face,
            nodes,
            weight,
            normal,
            gap,
            carried,
            np.full(k, d.friction),
            np.full(k, d.pairing, dtype=np.int64),
        )
        if gap_moves:
            rows.gap[:] -= np.einsum("ki,ki->k", normal, rows.displacement(u))
        # a row whose direction no free unknown feels can neither be kept nor broken
        felt = (self._free[nodes] * (np.abs(normal)[:, None, :] * np.abs(weight)[:, :, None])).sum(
            axis=(1, 2)
        )
        return rows.take(np.flatnonzero(felt > 1e-9))


def _positions(surface: Surface, q: Array, t: float) -> Array:
    return q if isinstance(surface, NodeSurface) else surface.at(t)


def _united(parts: list[Rows]) -> Rows:
    rows = parts[0]
    for more in parts[1:]:
        rows = rows.joined(more)
    return rows
