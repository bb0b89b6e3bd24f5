"""Compiled contact by constraints: rows of vertices with faces, and the contact memory of states."""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field

import numpy as np

from sim.contact.rows import CROSSED, NEAREST, NO_ROWS, WALL, ContactRows, ContactTolerances, Flags
from sim.contact.search import (
    NO_NORMALS,
    Candidates,
    ContactFeatures,
    PointFacePairs,
    SignedFaces,
    closest_faces,
    crossed_faces,
)
from sim.contact.surfaces import NodeSurface, Pairing, RigidShell, Surface, sides_of
from sim.pattern import SymmetricPattern
from sim.scene import CompiledTerm, Index, Layout
from sim.state import Array, State

SELF_DEPTH = 0.2
"""Fraction of the approach distance that may lie behind a face of the same surface."""

SKIN = 2.0  #: skin of the lists of faces near vertices, relative to the approach distance
BLUR = 0.2  #: fraction of the approach distance over which edges are rounded in the contact normals
FELT = 1e-9  #: least weight of the free unknowns in a row


@dataclass(frozen=True, eq=False)
class StepGeometry:
    """Geometry of a step, or of its part up to a trial."""

    #: (n_nodes, 3) positions at the start, and current ones [m]
    q0: Array
    q: Array
    #: start and end of the step [s]; shells are at their positions at t0 if `q` is `q0`, otherwise at
    #: t1
    t0: float
    t1: float
    #: positions of shells at both ends, computed once for all trials of a step
    shells: dict[RigidShell, tuple[Array, Array]] = field(
        default_factory=dict["RigidShell", tuple[Array, Array]]
    )

    @property
    def at_start(self) -> bool:
        """Test if the positions are those at the start."""
        return self.q is self.q0

    def ends(self, surface: Surface) -> tuple[Array, Array]:
        """Positions of the vertices of a surface at both ends [m]."""
        if isinstance(surface, NodeSurface):
            return self.q0, self.q
        if surface not in self.shells:
            self.shells[surface] = surface.at(self.t0), surface.at(self.t1)
        return self.shells[surface]


class VertexFaceContact:
    """Vertices of one surface of a pairing, and points on its edges, against the faces of the other.

    Parameters
    ----------
    pairing : index of the pairing.
    friction : Coulomb's coefficient.
    vertices : (n, 2) nodes, or vertices of a shell, between which points that have rows are; a vertex is
        repeated.
    share : (n,) fractions of the way from the first to the second.
    first_contact_vertex : index in the contact memory of the first vertex; the others follow.
    own, faces : surface of the vertices, and opposite surface.
    tolerances : their length is the distance below which vertices have rows.
    free : (n_nodes, 3) True for the free unknowns of the scene.
    carriers : (n_nodes,) body that carries each node rigidly, -1 for others.

    Attributes
    ----------
    nodes : (n,) nodes of the points, -1 for those of a shell and within an edge.
    contact_vertices : (n,) index of each point in the contact memory.
    """

    def __init__(
        self,
        pairing: int,
        friction: float,
        vertices: Index,
        share: Array,
        first_contact_vertex: int,
        own: SignedFaces,
        faces: SignedFaces,
        tolerances: ContactTolerances,
        free: Flags,
        carriers: Index,
    ) -> None:
        self.pairing, self.vertices, self.share = pairing, vertices, share
        self.contact_vertices = first_contact_vertex + np.arange(len(vertices))
        approach = tolerances.length
        self._friction, self._approach, self._free = friction, approach, free
        self._tolerances = tolerances
        self._own, self.signs, self._itself = own, faces, own is faces
        self.surface, self.faces = own.surface, faces.surface
        one = (vertices[:, 0] == vertices[:, 1]) & isinstance(self.surface, NodeSurface)
        self.nodes = np.where(one, vertices[:, 0], -1)
        among = self.nodes if isinstance(self.faces, NodeSurface) else np.full(len(share), -1)
        triangles, skin = self.faces.triangles, SKIN * approach
        self.candidates = Candidates(triangles, among, skin, every=self._itself)
        pair = [s.nodes for s in (self.surface, self.faces) if isinstance(s, NodeSurface)]
        touched, none = np.concatenate(pair), np.full(len(carriers), -1)
        self._carriers = carriers if len(pair) == 2 else none  # a shell is no body
        self._all_free = bool(free[touched].all() and (self._carriers[touched] < 0).all())
        self._lifted: tuple[Array, Array, Array] | None = None

    @property
    def has_inside(self) -> bool:
        """Test if vertices can be inside the faces."""
        return self.faces.closed and not self._itself

    def depths(self, q: Array, t: float) -> Array:
        """Depth of each vertex at positions q and time t [m]; 0 for self-contact."""
        deep = np.zeros(len(self.vertices))
        if self._itself:
            return deep
        here = StepGeometry(q, q, t, t)
        points, x = self.at(here.ends(self.surface)[0]), here.ends(self.faces)[0]
        # An open surface has no inside; depths in a closed one are not limited.
        radius = np.inf if self.faces.closed else self._approach
        pairs = self.closest(points, radius, x)
        gap, _ = self.signs.signed(points, pairs, x)
        np.maximum.at(deep, pairs.point, -np.nan_to_num(gap))
        return deep

    def at(self, of_vertices: Array) -> Array:
        """Values (n, 3) at the points, of values at the vertices of their surface."""
        one, two = (of_vertices[self.vertices[:, k]] for k in (0, 1))
        return one + self.share[:, None] * (two - one)

    def closest(self, points: Array, radius: Array | float, x: Array) -> PointFacePairs:
        """Closest faces, at positions x of their vertices, of points within a radius."""
        return closest_faces(points, radius, x, self.faces.triangles, self.candidates)

    def turn(self, t0: float, t1: float) -> Array | None:
        """Rotation (3, 3) of the faces from t0 to t1 [s], if they are a moving shell."""
        faces = self.faces
        if not isinstance(faces, RigidShell) or faces.motion is None:
            return None
        return faces.place(t1)[0] @ faces.place(t0)[0].T

    def near(self, move: StepGeometry, allowed: Array, way: Array | None) -> ContactRows:
        """Rows of the vertices near a face.

        `allowed` (n_vertices,) is the depth that vertices may have [m]; at the start, those of vertices
        that have passed around a free edge are increased to their depth. `way` (n_vertices,) is an upper
        bound of the displacement of each vertex in the step [m].
        """
        faces, blur = self.faces, BLUR * self._approach
        x0, x1 = move.ends(faces)
        x = x0 if move.at_start else x1
        mine = move.ends(self.surface)[0 if move.at_start else 1]
        points, may = self.at(mine), allowed[self.contact_vertices]
        radius = self._approach + may + (0.0 if way is None else way[self.contact_vertices])
        away = self.at(self.signs.normals(x)[1]) if self._itself else NO_NORMALS
        outward = away if self._itself else self.at(self._own.normals(mine)[1])
        deepest = -SELF_DEPTH * self._approach if self._itself else -np.inf
        met = self.signs.met(points, radius, may, x, self.candidates, away, outward, blur, deepest)
        if not len(met.point):
            return NO_ROWS
        gap, normal, deep = met.gap, met.normal, may[met.point]
        if move.at_start and not faces.closed:
            # A vertex at this depth has not entered through the front, but passed around a free
            # edge.
            behind = np.flatnonzero(gap + deep < -SELF_DEPTH * self._approach)
            may[met.point[behind]] = -gap[behind]
            allowed[self.contact_vertices], deep = may, may[met.point]
        turn = self.turn(move.t0, move.t1) if move.at_start else None
        if turn is not None:
            way_out = gap[:, None] * normal
            normal = normal @ turn.T
            gap = np.einsum("ki,ki->k", way_out, normal)
        rank = np.where(met.wall, WALL, NEAREST)
        return self._rows(move, met, (met.place, rank), normal, gap + deep)

    def crossed(self, move: StepGeometry, allowed: Array) -> ContactRows:
        """Rows of the vertices that enter a face on their path, with its normal at the end.

        allowed (n_vertices,) are the depths that vertices may have [m].
        """
        x0, x1 = move.ends(self.faces)
        before, after = self._outside(move, allowed), self.at(move.ends(self.surface)[1])
        triangles = self.faces.triangles
        pairs = crossed_faces(before, after, x0, x1, triangles, self.candidates)
        if not len(pairs.point):
            return NO_ROWS
        pairs, place = self.signs.places_of(pairs, x1)
        normal = self.signs.normals_of(place, x1)
        at = np.einsum("kj,kji->ki", pairs.weight, x1[triangles[pairs.face]])
        gap = np.einsum("ki,ki->k", normal, after[pairs.point] - at)
        return self._rows(move, pairs, (place, np.full(len(gap), CROSSED)), normal, gap)

    def _outside(self, move: StepGeometry, allowed: Array) -> Array:
        """Vertices (n, 3) at the start, with slightly penetrating ones moved to the surface.

        After an earlier contact, vertices may be slightly inside and would enter undetected.
        """
        if self._lifted is not None:
            q0, known, points = self._lifted
            if q0 is move.q0 and known is allowed:
                return points
        points = self.at(move.ends(self.surface)[0])
        self._lifted = move.q0, allowed, points
        if self._itself or not self.faces.closed:
            return points
        x0 = move.ends(self.faces)[0]
        pairs = self.closest(points, self._tolerances.hair, x0)
        gap, normal = self.signs.signed(points, pairs, x0)
        hair = np.flatnonzero((gap < 0.0) & (allowed[self.contact_vertices][pairs.point] == 0.0))
        at = pairs.point[hair]
        share = 1.0 / np.bincount(at, minlength=len(points))[at]
        np.add.at(points, at, (share * (self._tolerances.lift - gap[hair]))[:, None] * normal[hair])
        return points

    def _rows(
        self,
        move: StepGeometry,
        pairs: PointFacePairs | ContactFeatures,
        about: tuple[Index, Index],
        normal: Array,
        gap: Array,
    ) -> ContactRows:
        """Rows with their gaps converted to the start of the step.

        about: their places and ranks.
        """
        ends, share, k = self.vertices[pairs.point], self.share[pairs.point], len(pairs.point)
        vertex = ends[:, 0]
        corners = self.faces.triangles[pairs.face]
        weight, shell_motion = np.ones((k, 4)), np.zeros((k, 3))
        if isinstance(self.faces, NodeSurface):
            nodes, weight[:, 1:] = np.empty((k, 4), np.int64), -pairs.weight
            nodes[:, 0], nodes[:, 1:] = vertex, corners
            if not isinstance(self.surface, NodeSurface):
                nodes[:, 0], weight[:, 0] = corners[:, 0], 0.0
                p0, p1 = move.ends(self.surface)
                shell_motion = p0[vertex] - p1[vertex]
        else:
            nodes, weight[:, 2:] = ends[:, [0, 1, 0, 0]], 0.0
            weight[:, 0], weight[:, 1] = 1.0 - share, share
            x0, x1 = move.ends(self.faces)
            shell_motion = np.einsum("kj,kji->ki", pairs.weight, x1[corners] - x0[corners])
        rows = ContactRows(
            self.contact_vertices[pairs.point],
            *about,
            nodes,
            weight,
            normal,
            gap,
            shell_motion,
            np.full(k, self._friction),
            np.full(k, self.pairing, dtype=np.int64),
        )
        if not move.at_start:
            u = move.q - move.q0
            rows.gap[:] -= np.einsum("ki,ki->k", normal, rows.displacement(u))
        if self._all_free:
            return rows
        # A row that does not depend on a free unknown is omitted, as is one between parts of one body,
        # whose derivative is zero but for rounding.
        felt = (self._free[nodes] * (np.abs(normal)[:, None, :] * np.abs(weight)[:, :, None])).sum(
            axis=(1, 2)
        )
        on = self._carriers[nodes]
        together = ((on == on[:, :1]) | (weight == 0.0)).all(axis=1) & (on[:, 0] >= 0)
        kept = (felt > FELT) & ~together
        return rows if kept.all() else rows.take(np.flatnonzero(kept))


CONTACT_MEMORY = "contact"  #: name of the memory in a state

ALLOWED, FORCE, PUSH, FRICTION, DIRECTION = 0, 1, slice(2, 5), slice(5, 8), slice(8, 11)
"""Columns of the memory: allowed depth [m], normal force, its vector, friction [N], normal."""

COLUMNS = 11

SHARP_EDGE = 0.7  #: cosine of the angle of the faces of an edge, below which it is sharp


class CompiledContact(CompiledTerm):
    """Compiled contact, which exerts no force as a term; integrators enforce its rows.

    `reach` [m], `edge_points` and `renewals` are those of `ConstraintContact`; initial penetrations are
    removed at `removal_speed` [m/s], or may remain if it is 0. `rubs` is True if any pairing has
    friction, `in_matrix` if the sparsity pattern contains the entries of the rows. `pairing_of_vertex`
    and `node_of_vertex` (n_vertices,) are the pairing and node of each row of the memory, -1 for a
    vertex that is no node.
    """

    def __init__(
        self,
        pairings: tuple[Pairing, ...],
        frictions: tuple[float, ...],
        reach: float,
        tolerances: ContactTolerances,
        removal_speed: float,
        edge_points: int,
        renewals: int,
        layout: Layout,
    ) -> None:
        self.pattern: SymmetricPattern = layout.pattern
        self.names: tuple[str, ...] = tuple(pairing.name for pairing in pairings)
        self.reach, self.tolerances, self.renewals = reach, tolerances, renewals
        self.rubs = any(friction > 0.0 for friction in frictions)
        self.in_matrix = True
        free = np.zeros(3 * layout.mesh.n_nodes, dtype=bool)
        free[layout.pattern.free] = True
        free = free.reshape(-1, 3)
        self._removal_speed = removal_speed
        self._directions: list[VertexFaceContact] = []
        self._n_contact_vertices = 0
        # all pairings that contain a surface share one object of its faces
        surfaces = {id(s): s for pairing in pairings for s in pairing.surfaces}
        faces = {key: SignedFaces(surface) for key, surface in surfaces.items()}
        for i, pairing in enumerate(pairings):
            pairs = (pairing.surfaces * 2)[:2]
            for a, b in (pairs,) if pairing.itself else (pairs, pairs[::-1]):
                vertices = np.unique(a.triangles)
                if isinstance(a, NodeSurface):
                    vertices = np.setdiff1d(vertices, pairing.shared)
                points, share = np.stack([vertices, vertices], axis=1), np.zeros(len(vertices))
                own, other = faces[id(a)], faces[id(b)]
                of_mesh = isinstance(a, NodeSurface) and a.triangles.max() < layout.mesh.n_nodes
                if edge_points and of_mesh and isinstance(b, RigidShell):
                    on, at = _points_on_edges(own, layout.mesh.X, edge_points)
                    points, share = np.concatenate([points, on]), np.r_[share, at]
                about = own, other, tolerances, free, layout.carriers
                self._directions.append(
                    VertexFaceContact(
                        i, frictions[i], points, share, self._n_contact_vertices, *about
                    )
                )
                self._n_contact_vertices += len(points)
        none = np.empty(0, dtype=np.int64)
        self.pairing_of_vertex: Index = np.concatenate(
            [none] + [np.full(len(d.contact_vertices), d.pairing) for d in self._directions]
        )
        self.node_of_vertex: Index = np.concatenate([none] + [d.nodes for d in self._directions])

    @property
    def directions(self) -> tuple[VertexFaceContact, ...]:
        """Vertices of one surface against the faces of another, in the order of the contact memory."""
        return tuple(self._directions)

    @property
    def removes(self) -> bool:
        """True if initial penetrations are removed."""
        return self._removal_speed > 0.0

    def without_contact_entries(self, pattern: SymmetricPattern) -> "CompiledContact":
        """Same contact with a pattern without entries for the rows."""
        other = copy(self)
        other.pattern, other.in_matrix = pattern, False
        return other

    def normal_forces(self, memory: Mapping[str, Array]) -> Array:
        """Sum of the normal forces (n_pairings,) in a memory of a state [N]."""
        force = (
            memory[CONTACT_MEMORY][:, FORCE]
            if CONTACT_MEMORY in memory
            else np.zeros(self._n_contact_vertices)
        )
        total = np.bincount(self.pairing_of_vertex, force, len(self.names))
        return np.asarray(total, dtype=np.float64)

    def pushing(self, state: State) -> Index:
        """Slots of the active vertices in a state."""
        memory = state.memory.get(CONTACT_MEMORY)
        none = np.empty(0, dtype=np.int64)
        return none if memory is None else np.flatnonzero(memory[:, FORCE] > 0.0)

    def measure(self, state: State) -> tuple[Array, Array, Array]:
        """Number of active contacts, smallest gap [m] and normal force [N], per pairing."""
        memory, n = self.remembered(state.memory, state.q, state.t), len(self.names)
        count, gap, force = np.zeros(n), np.full(n, np.inf), np.zeros(n)
        np.add.at(force, self.pairing_of_vertex, memory[:, FORCE])
        np.add.at(count, self.pairing_of_vertex, memory[:, FORCE] > 0.0)
        here = StepGeometry(state.q, state.q, state.t, state.t)
        near = self.near(here, memory[:, ALLOWED].copy())
        np.minimum.at(gap, near.pairing, near.gap)
        return count, np.where(gap < np.inf, gap, np.nan), force

    def remembered(self, memory: Mapping[str, Array], q: Array, t: float) -> Array:
        """Memory (n_vertices, COLUMNS) of a state; without one, penetrations at q and t may remain."""
        if CONTACT_MEMORY in memory:
            return memory[CONTACT_MEMORY]
        new = np.zeros((self._n_contact_vertices, COLUMNS))
        for direction in self._directions:
            new[direction.contact_vertices, ALLOWED] = direction.depths(q, t)
        return new

    def removed(self, allowed: Array, h: float) -> Array:
        """Decrease of the allowed depths (n_vertices,) in a step of h [m].

        An open surface has no inside, so that penetrations behind it are not removed.
        """
        out = np.minimum(allowed, self._removal_speed * h)
        for direction in self._directions:
            if not direction.has_inside:
                out[direction.contact_vertices] = 0.0
        return out

    def turned(self, vectors: Array, t0: float, t1: float) -> Array:
        """Vectors (n_vertices, 3) rotated with their shells from t0 to t1 [s]."""
        out = vectors.copy()
        for direction in self._directions:
            turn = direction.turn(t0, t1)
            if turn is not None:
                out[direction.contact_vertices] = vectors[direction.contact_vertices] @ turn.T
        return out

    def outward(self, q: Array, rows: ContactRows) -> Array:
        """Normals (k, 3) of the surfaces opposite to rows at positions q of the mesh; zero of shells."""
        out = np.zeros((len(rows), 3))
        for direction in self._directions:
            if len(direction.contact_vertices) and isinstance(direction.faces, NodeSurface):
                first, last = direction.contact_vertices[[0, -1]]
                mine = np.flatnonzero(
                    (rows.contact_vertex >= first) & (rows.contact_vertex <= last)
                )
                if len(mine):
                    out[mine] = direction.signs.normals_of(rows.place[mine], q)
        return out

    def near(self, move: StepGeometry, allowed: Array, way: Array | None = None) -> ContactRows:
        """Rows of all vertices near a face; see `VertexFaceContact.near`."""
        return NO_ROWS.joined(*(d.near(move, allowed, way) for d in self._directions))

    def crossed(self, move: StepGeometry, allowed: Array) -> ContactRows:
        """Rows of all vertices that enter a face on their path; see `VertexFaceContact.crossed`."""
        return NO_ROWS.joined(*(d.crossed(move, allowed) for d in self._directions))


def _points_on_edges(faces: SignedFaces, X: Array, number: int) -> tuple[Index, Array]:
    """Ends (n, 2) and fractions (n,) of a number of points on each sharp convex edge at rest."""
    triangles, across = faces.triangles, faces.across.ravel()
    ends, normal = sides_of(triangles), faces.normals(X)[0]
    beyond = np.roll(triangles, 1, axis=1).ravel()
    once = np.flatnonzero((across >= 0) & (ends[:, 0] < ends[:, 1]))
    own, other = normal[once // 3], normal[across[once]]
    convex = np.einsum("ki,ki->k", other, X[beyond[once]] - X[ends[once, 0]]) < 0.0
    sharp = once[convex & (np.einsum("ki,ki->k", own, other) < SHARP_EDGE)]
    share = np.arange(1, number + 1) / (number + 1)
    return np.repeat(ends[sharp], number, axis=0), np.tile(share, len(sharp))
