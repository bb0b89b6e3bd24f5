"""Contact of a reduced solid: rows of points near the faces of the same contact at full order.

Positions of the surfaces are q0 + Phi y, so that rows are linear in the velocities of few coordinates.
A step without contact predicts velocities; non-negative impulses along the rows then keep the gaps
open. Points that never come close to a face in the training are omitted.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from sim._kernels.reduced_contact import contact_rows, push_apart
from sim.contact.compiled import CompiledContact, VertexFaceContact
from sim.contact.search import Candidates, SignedFaces
from sim.contact.surfaces import NodeSurface, RigidShell
from sim.errors import SceneError
from sim.pattern import Flags
from sim.scene import Index
from sim.state import Array

ALLOWED_DEPTHS, IMPULSES = "allowed depths", "contact impulses"
"""Memory of a state: depth that each point may have [m], and its impulse of the last step [N s]."""

AHEAD_OF_STEP = (
    1.5  #: factor on the displacement by the velocities for the search radius of a point
)
SOFTNESS = 1e-4
"""Compliance of a row [m/N]. It makes redundant rows solvable, and lets points overlap by some tenths of
a millimetre, because few modes cannot meet hundreds of rows: with 1e-5 some motions are locked."""
RATE_SWEEPS, RATE_TOLERANCE = (
    200,
    1e-4,
)  #: largest number of sweeps; change of a rate [m/s] at which they end
DEEPEST_START = 0.01  #: largest depth at the start [m]
FASTEST = 0.02  #: speed at which points that are too deep are moved out [m/s]


@dataclass(eq=False)
class _Side:
    """Points of one surface against the faces of the other."""

    direction: VertexFaceContact
    own: Index  #: (n,) points of the direction that are kept
    contact_vertices: Index  #: (n,) their indices in the contact at full order
    ends: Index  #: (n, 2) vertices between which they are
    share: Array  #: (n, 1)
    rigid: bool  #: True if the points are those of a shell
    of_points: Array  #: (n, 3, m) derivatives of the points by the coordinates
    of_nodes: Array  #: (k, 3, m) those of the vertices of the faces
    across: Index  #: (f, 3) faces beyond the edges of each, -1 at a free one
    free: Flags  #: (k,) True for the vertices of free edges
    near: Candidates = field(init=False)

    def __post_init__(self) -> None:
        """Begin without lists of faces."""
        faces = self.direction.faces
        nodes = self.direction.nodes[self.own]
        among = nodes if isinstance(faces, NodeSurface) else np.full(len(self.own), -1)
        self.near = Candidates(faces.triangles, among, 2e-3)


Rows = tuple[Array, Array, Index]
"""Rows N (k, m) over the coordinates, their gaps (k,) [m], and their points (k,)."""


class ReducedContact:
    """Contact of a scene with few coordinates.

    Parameters
    ----------
    contact : CompiledContact
        Of the scene at full order, without friction, of shells at rest.
    q0 : (n_nodes, 3) positions where the coordinates are zero [m].
    modes : (3 n_nodes, m) modes, of which those of the step are the first.
    contact_vertices : (k,), optional
        Slots of the contact whose points may touch; default: all.

    Raises
    ------
    SceneError
        There is friction, self-contact, a moving shell, or depths at the start are to be removed.
    """

    def __init__(
        self,
        contact: CompiledContact,
        q0: Array,
        modes: Array,
        contact_vertices: Index | None = None,
    ) -> None:
        _require_supported(contact)
        self._approach = contact.tolerances.length
        self._q0, self._modes = q0, modes
        of_nodes = modes.reshape(len(q0), 3, -1)
        none = np.zeros((0, 3, modes.shape[1]))
        kept = (
            np.arange(len(contact.node_of_vertex)) if contact_vertices is None else contact_vertices
        )
        self._sides = list[_Side]()
        for d in contact.directions:
            own = np.flatnonzero(np.isin(d.contact_vertices, kept))
            if not len(own):
                continue
            rigid = isinstance(d.surface, RigidShell)
            ends, share = d.vertices[own], d.share[own]
            one, two = (none, none) if rigid else (of_nodes[ends[:, k]] for k in (0, 1))
            moved = none if rigid else one + share[:, None, None] * (two - one)
            shell = isinstance(d.faces, RigidShell)
            size = int(d.faces.triangles.max()) + 1
            free = np.zeros(size, dtype=np.bool_)
            free[d.faces.open_edges] = True
            on = none if shell else np.ascontiguousarray(of_nodes[:size])
            across = SignedFaces(d.faces).across
            about = ends, share[:, None], rigid, np.ascontiguousarray(moved), on, across, free
            self._sides.append(_Side(d, own, d.contact_vertices[own], *about))
        self.contact_vertices: Index = (
            np.concatenate([s.contact_vertices for s in self._sides]) if self._sides else kept
        )

    def positions(self, y: Array) -> Array:
        """Positions of all nodes (n_nodes, 3) [m]."""
        r = len(y)
        return self._q0 + (self._modes[:, :r] @ y).reshape(-1, 3)

    def depths(self, y: Array) -> Array:
        """Depth of every point at coordinates y [m]."""
        n, q = len(self.contact_vertices), self.positions(y)
        _, gap, at = self._rows(q, np.full(n, DEEPEST_START))
        deep = np.zeros(n)
        np.maximum.at(deep, at, -gap)
        return deep

    def rows(self, y: Array, v: Array, allowed: Array, h: float) -> Rows:
        """Rows that may be active in a step of h."""
        q = self.positions(y)
        speed = np.linalg.norm((self._modes[:, : len(v)] @ v).reshape(-1, 3), axis=1)
        way, first = np.empty(len(self.contact_vertices)), 0
        for side in self._sides:
            own = 0.0 if side.rigid else speed[side.ends].max(axis=1)
            faces = side.direction.faces
            other = speed[faces.nodes].max() if isinstance(faces, NodeSurface) else 0.0
            way[first : first + len(side.own)] = own + other
            first += len(side.own)
        radius = self._approach + allowed + AHEAD_OF_STEP * h * way
        N, gap, at = self._rows(q, radius)
        return N, gap + allowed[at], at

    def _rows(self, q: Array, radius: Array) -> Rows:
        found_N, found_gap, found_at, first = list[Array](), list[Array](), list[Index](), 0
        for side in self._sides:
            d, n = side.direction, len(side.own)
            vertices, x = (
                s.vertices if isinstance(s, RigidShell) else q for s in (d.surface, d.faces)
            )
            one, two = vertices[side.ends[:, 0]], vertices[side.ends[:, 1]]
            points = np.ascontiguousarray(one + side.share * (two - one))
            within = np.ascontiguousarray(radius[first : first + n])
            start, listed = side.near.along(points, points, x, x, within)
            N, gap, at = np.empty((n + 1, self._modes.shape[1])), np.empty(n + 1), np.empty(n, int)
            # an open surface has no inside
            behind = np.inf if d.faces.closed else self._approach
            k = contact_rows(
                points, within, behind, x, d.faces.triangles, side.across, side.free, start, listed,
                side.of_points, side.of_nodes, N, gap, at,
            )  # fmt: skip
            found_N.append(N[:k])
            found_gap.append(gap[:k])
            found_at.append(at[:k] + first)
            first += n
        return np.concatenate(found_N), np.concatenate(found_gap), np.concatenate(found_at)

    def pushed(self, rows: Rows, W: Array, h: float, v: Array, p: Array) -> tuple[Array, float]:
        """Impulses of the rows [N s] and the largest change of a rate by them [m/s].

        v (r,) are the velocities with the impulses p, and W = N A^-1 N' with the matrix A of the step.
        """
        N, gap, _ = rows
        new = p.copy()
        rate = N[:, : len(v)] @ v + np.maximum(gap, -FASTEST * h) / h
        push_apart(W, rate, SOFTNESS / h**2, RATE_SWEEPS, RATE_TOLERANCE, new)
        return new, float(np.abs(W @ (new - p)).max(initial=0.0))


def near_vertices(contact: CompiledContact, motions: Iterable[Array], within: float) -> Index:
    """Slots whose points come within a distance [m] of a face at positions (n_nodes, 3)."""
    near = np.zeros(len(contact.node_of_vertex), dtype=bool)
    for q in motions:
        for d in contact.directions:
            vertices, x = (
                s.vertices if isinstance(s, RigidShell) else q for s in (d.surface, d.faces)
            )
            met = d.closest(d.at(vertices), within, x)
            near[d.contact_vertices[met.point]] = True
    return np.flatnonzero(near)


def _require_supported(contact: CompiledContact) -> None:
    moving = any(
        isinstance(s, RigidShell) and s.motion is not None
        for d in contact.directions
        for s in (d.surface, d.faces)
    )
    for name, used in (
        ("friction", contact.rubs),
        ("self-contact", any(d.surface is d.faces for d in contact.directions)),
        ("a moving shell", moving),
        ("initial_penetration = 'removed'", contact.removes),
    ):
        if used:
            raise SceneError(
                f"the contact of a reduced model has {name}, which is not supported: leave it out, "
                "or simulate at full order"
            )
