"""Compiled contact by constraints: its rows, and the contact memory of states."""

from collections.abc import Mapping
from copy import copy

import numpy as np

from sim.contact.connectivity import sides_of
from sim.contact.direction import Direction, Move
from sim.contact.rows import Rows, no_rows
from sim.contact.signed_distance import SignedFaces
from sim.contact.surfaces import NodeSurface, Pairing, RigidShell
from sim.contact.tolerances import ContactTolerances
from sim.pattern import SymmetricPattern
from sim.scene import CompiledTerm, Contribution, Index, Layout
from sim.state import Array, Control, State

MEMORY = "contact"  #: name of the memory in a state

ALLOWED, FORCE, PUSH, FRICTION, DIRECTION = 0, 1, slice(2, 5), slice(5, 8), slice(8, 11)
"""Columns of the memory: allowed depth [m], normal force, its vector, friction [N], normal."""

COLUMNS = 11

SHARP = 0.7  #: cosine of the angle of the faces of an edge, below which it is sharp


class CompiledContact(CompiledTerm):
    """Compiled contact, which exerts no force as a term; integrators enforce its rows.

    `reach` [m], `edge_points` and `renewals` are those of `ConstraintContact`; initial penetrations are
    removed at `removal_speed` [m/s], or may remain if it is 0. `rubs` is True if any pairing has
    friction, `in_matrix` if the sparsity pattern contains the entries of the rows. `pairing_of_slot`
    and `vertex_of_slot` (n_slots,) are the pairing and node of each row of the memory, -1 for a vertex
    that is no node.
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
        self._directions: list[Direction] = []
        self._n_slots = 0
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
                    Direction(i, frictions[i], points, share, self._n_slots, *about)
                )
                self._n_slots += len(points)
        none = np.empty(0, dtype=np.int64)
        self.pairing_of_slot: Index = np.concatenate(
            [none] + [np.full(len(d.slots), d.pairing) for d in self._directions]
        )
        self.vertex_of_slot: Index = np.concatenate([none] + [d.nodes for d in self._directions])

    @property
    def directions(self) -> tuple[Direction, ...]:
        """Vertices of one surface against the faces of another, in the order of their slots."""
        return tuple(self._directions)

    @property
    def removes(self) -> bool:
        """True if initial penetrations are removed."""
        return self._removal_speed > 0.0

    def apart(self, pattern: SymmetricPattern) -> "CompiledContact":
        """Same contact with a pattern without entries for the rows."""
        other = copy(self)
        other.pattern, other.in_matrix = pattern, False
        return other

    def pressed(self, memory: Mapping[str, Array]) -> Array:
        """Sum of the normal forces (n_pairings,) in a memory of a state [N]."""
        force = memory[MEMORY][:, FORCE] if MEMORY in memory else np.zeros(self._n_slots)
        found = np.bincount(self.pairing_of_slot, force, len(self.names))
        return np.asarray(found, dtype=np.float64)

    def pushing(self, state: State) -> Index:
        """Slots of the active vertices in a state."""
        memory = state.memory.get(MEMORY)
        none = np.empty(0, dtype=np.int64)
        return none if memory is None else np.flatnonzero(memory[:, FORCE] > 0.0)

    def add(self, q: Array, control: Control, f: Array, K: Array | None = None) -> Contribution:
        """No force and no stiffness, because multipliers separate the surfaces."""
        return Contribution(0.0)

    def measure(self, state: State) -> tuple[Array, Array, Array]:
        """Number of active contacts, smallest gap [m] and normal force [N], per pairing."""
        memory, n = self.remembered(state.memory, state.q, state.t), len(self.names)
        count, gap, force = np.zeros(n), np.full(n, np.inf), np.zeros(n)
        np.add.at(force, self.pairing_of_slot, memory[:, FORCE])
        np.add.at(count, self.pairing_of_slot, memory[:, FORCE] > 0.0)
        here = Move(state.q, state.q, state.t, state.t)
        near = self.near(here, memory[:, ALLOWED].copy())
        np.minimum.at(gap, near.pairing, near.gap)
        return count, np.where(gap < np.inf, gap, np.nan), force

    def remembered(self, memory: Mapping[str, Array], q: Array, t: float) -> Array:
        """Memory (n_slots, COLUMNS) of a state; without one, penetrations at q and t may remain."""
        if MEMORY in memory:
            return memory[MEMORY]
        new = np.zeros((self._n_slots, COLUMNS))
        for direction in self._directions:
            new[direction.slots, ALLOWED] = direction.depths(q, t)
        return new

    def removed(self, allowed: Array, h: float) -> Array:
        """Decrease of the allowed depths (n_slots,) in a step of h [m].

        An open surface has no inside, so that penetrations behind it are not removed.
        """
        out = np.minimum(allowed, self._removal_speed * h)
        for direction in self._directions:
            if not direction.has_inside:
                out[direction.slots] = 0.0
        return out

    def turned(self, vectors: Array, t0: float, t1: float) -> Array:
        """Vectors (n_slots, 3) rotated with their shells from t0 to t1 [s]."""
        out = vectors.copy()
        for direction in self._directions:
            turn = direction.turn(t0, t1)
            if turn is not None:
                out[direction.slots] = vectors[direction.slots] @ turn.T
        return out

    def outward(self, q: Array, rows: Rows) -> Array:
        """Mean normals (k, 3) of the surfaces opposite to rows; see `Direction.outward`."""
        out = np.zeros((len(rows), 3))
        for direction in self._directions:
            first, last = direction.slots[[0, -1]] if len(direction.slots) else (0, -1)
            mine = np.flatnonzero((rows.slot >= first) & (rows.slot <= last))
            out[mine] = direction.outward(q, rows.take(mine))
        return out

    def near(self, move: Move, allowed: Array, way: Array | None = None) -> Rows:
        """Rows of all vertices near a face; see `Direction.near`."""
        return no_rows().joined(*(d.near(move, allowed, way) for d in self._directions))

    def entered(self, move: Move, allowed: Array) -> Rows:
        """Rows of all vertices that enter a face on their path; see `Direction.entered`."""
        return no_rows().joined(*(d.entered(move, allowed) for d in self._directions))


def _points_on_edges(faces: SignedFaces, X: Array, number: int) -> tuple[Index, Array]:
    """Ends (n, 2) and fractions (n,) of a number of points on each sharp convex edge at rest."""
    triangles, across = faces.triangles, faces.across.ravel()
    ends, normal = sides_of(triangles), faces.normals(X)[0]
    beyond = np.roll(triangles, 1, axis=1).ravel()
    once = np.flatnonzero((across >= 0) & (ends[:, 0] < ends[:, 1]))
    own, other = normal[once // 3], normal[across[once]]
    convex = np.einsum("ki,ki->k", other, X[beyond[once]] - X[ends[once, 0]]) < 0.0
    sharp = once[convex & (np.einsum("ki,ki->k", own, other) < SHARP)]
    share = np.arange(1, number + 1) / (number + 1)
    return np.repeat(ends[sharp], number, axis=0), np.tile(share, len(sharp))
