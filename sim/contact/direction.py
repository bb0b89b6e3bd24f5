"""Contact rows of vertices of one surface with faces of another."""

from dataclasses import dataclass

import numpy as np

from sim.contact.rows import ENTERED, NEAREST, WALL, Flags, Rows, no_rows
from sim.contact.search import NO_NORMALS, Candidates, Found, closest_faces, entered_faces
from sim.contact.signed_distance import Met, SignedFaces
from sim.contact.surfaces import NodeSurface, RigidShell, Surface
from sim.contact.tolerances import ContactTolerances
from sim.scene import Index
from sim.state import Array

SELF_DEPTH = 0.2
"""Fraction of the approach distance that may lie behind a face of the same surface."""

SKIN = 2.0  #: skin of the lists of faces near vertices, relative to the approach distance
BLUR = 0.2  #: fraction of the approach distance over which edges are rounded in the contact normals
FELT = 1e-9  #: least weight of the free unknowns in a row


@dataclass(frozen=True, eq=False)
class Move:
    """Geometry of a step, or of its part up to a trial."""

    #: (n_nodes, 3) positions at the start, and current ones [m]
    q0: Array
    q: Array
    #: start and end of the step [s]; shells are at their positions at t0 if `q` is `q0`, otherwise at
    #: t1
    t0: float
    t1: float

    @property
    def at_start(self) -> bool:
        """Test if the positions are those at the start."""
        return self.q is self.q0

    def ends(self, surface: Surface) -> tuple[Array, Array]:
        """Positions of the vertices of a surface at both ends [m]."""
        if isinstance(surface, NodeSurface):
            return self.q0, self.q
        return surface.at(self.t0), surface.at(self.t1)


class Direction:
    """Vertices of one surface of a pairing, and points on its edges, against the faces of the other.

    Parameters
    ----------
    pairing : index of the pairing.
    friction : Coulomb's coefficient.
    vertices : (n, 2) nodes, or vertices of a shell, between which points that have rows are; a vertex is
        repeated.
    share : (n,) fractions of the way from the first to the second.
    first_slot : slot of the first vertex; the others follow.
    own, faces : surface of the vertices, and opposite surface.
    tolerances : their length is the distance below which vertices have rows.
    free : (n_nodes, 3) True for the free unknowns of the scene.
    carriers : (n_nodes,) body that carries each node rigidly, -1 for others.

    Attributes
    ----------
    nodes : (n,) nodes of the points, -1 for those of a shell and within an edge.
    slots : (n,) index of each point in the contact memory.
    """

    def __init__(
        self,
        pairing: int,
        friction: float,
        vertices: Index,
        share: Array,
        first_slot: int,
        own: SignedFaces,
        faces: SignedFaces,
        tolerances: ContactTolerances,
        free: Flags,
        carriers: Index,
    ) -> None:
        self.pairing, self.vertices, self.share = pairing, vertices, share
        self.slots = first_slot + np.arange(len(vertices))
        approach = tolerances.length
        self._friction, self._approach, self._free = friction, approach, free
        self._tolerances = tolerances
        self._own, self._signs, self._itself = own, faces, own is faces
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
        here = Move(q, q, t, t)
        points, x = self.at(here.ends(self.surface)[0]), here.ends(self.faces)[0]
        # An open surface has no inside; depths in a closed one are not limited.
        radius = np.inf if self.faces.closed else self._approach
        found = self.closest(points, radius, x)
        gap, _ = self._signs.signed(points, found, x)
        np.maximum.at(deep, found.point, -np.nan_to_num(gap))
        return deep

    def at(self, of_vertices: Array) -> Array:
        """Values (n, 3) at the points, of values at the vertices of their surface."""
        one, two = (of_vertices[self.vertices[:, k]] for k in (0, 1))
        return one + self.share[:, None] * (two - one)

    def closest(self, points: Array, radius: Array | float, x: Array) -> Found:
        """Closest faces, at positions x of their vertices, of points within a radius."""
        return closest_faces(points, radius, x, self.faces.triangles, self.candidates)

    def turn(self, t0: float, t1: float) -> Array | None:
        """Rotation (3, 3) of the faces from t0 to t1 [s], if they are a moving shell."""
        faces = self.faces
        if not isinstance(faces, RigidShell) or faces.motion is None:
            return None
        return faces.place(t1)[0] @ faces.place(t0)[0].T

    def near(self, move: Move, allowed: Array, way: Array | None) -> Rows:
        """Rows of the vertices near a face.

        `allowed` (n_slots,) is the depth that vertices may have [m]; at the start, entries of vertices
        that have passed around a free edge are increased to their depth. `way` (n_slots,) is an upper
        bound of the displacement of each vertex in the step [m].
        """
        faces, blur = self.faces, BLUR * self._approach
        x0, x1 = move.ends(faces)
        x = x0 if move.at_start else x1
        mine = move.ends(self.surface)[0 if move.at_start else 1]
        points, may = self.at(mine), allowed[self.slots]
        radius = self._approach + may + (0.0 if way is None else way[self.slots])
        away = self.at(self._signs.normals(x)[1]) if self._itself else NO_NORMALS
        outward = away if self._itself else self.at(self._own.normals(mine)[1])
        deepest = -SELF_DEPTH * self._approach if self._itself else -np.inf
        met = self._signs.met(points, radius, may, x, self.candidates, away, outward, blur, deepest)
        if not len(met.point):
            return no_rows()
        gap, normal, deep = met.gap, met.normal, may[met.point]
        if move.at_start and not faces.closed:
            # A vertex at this depth has not entered through the front, but passed around a free
            # edge.
            behind = np.flatnonzero(gap + deep < -SELF_DEPTH * self._approach)
            may[met.point[behind]] = -gap[behind]
            allowed[self.slots], deep = may, may[met.point]
        turn = self.turn(move.t0, move.t1) if move.at_start else None
        if turn is not None:
            way_out = gap[:, None] * normal
            normal = normal @ turn.T
            gap = np.einsum("ki,ki->k", way_out, normal)
        rank = np.where(met.wall, WALL, NEAREST)
        return self._rows(move, met, (met.place, rank), normal, gap + deep)

    def entered(self, move: Move, allowed: Array) -> Rows:
        """Rows of the vertices that enter a face on their path, with its normal at the end.

        allowed (n_slots,) are the depths that vertices may have [m].
        """
        x0, x1 = move.ends(self.faces)
        before, after = self._outside(move, allowed), self.at(move.ends(self.surface)[1])
        triangles = self.faces.triangles
        found = entered_faces(before, after, x0, x1, triangles, self.candidates)
        if not len(found.point):
            return no_rows()
        found, place = self._signs.places_of(found, x1)
        normal = self._signs.normals_of(place, x1)
        at = np.einsum("kj,kji->ki", found.weight, x1[triangles[found.face]])
        gap = np.einsum("ki,ki->k", normal, after[found.point] - at)
        return self._rows(move, found, (place, np.full(len(gap), ENTERED)), normal, gap)

    def _outside(self, move: Move, allowed: Array) -> Array:
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
        found = self.closest(points, self._tolerances.hair, x0)
        gap, normal = self._signs.signed(points, found, x0)
        hair = np.flatnonzero((gap < 0.0) & (allowed[self.slots][found.point] == 0.0))
        at = found.point[hair]
        share = 1.0 / np.bincount(at, minlength=len(points))[at]
        np.add.at(points, at, (share * (self._tolerances.lift - gap[hair]))[:, None] * normal[hair])
        return points

    def outward(self, q: Array, rows: Rows) -> Array:
        """Normals (k, 3) of rows on a surface of the mesh at nodal positions q; zero on a shell."""
        if not isinstance(self.faces, NodeSurface):
            return np.zeros((len(rows), 3))
        return self._signs.normals_of(rows.place, q)

    def _rows(
        self, move: Move, found: Found | Met, about: tuple[Index, Index], normal: Array, gap: Array
    ) -> Rows:
        """Rows with their gaps converted to the start of the step.

        about: their places and ranks.
        """
        ends, share, k = self.vertices[found.point], self.share[found.point], len(found.point)
        vertex = ends[:, 0]
        corners = self.faces.triangles[found.face]
        weight, carried = np.ones((k, 4)), np.zeros((k, 3))
        if isinstance(self.faces, NodeSurface):
            nodes, weight[:, 1:] = np.empty((k, 4), np.int64), -found.weight
            nodes[:, 0], nodes[:, 1:] = vertex, corners
            if not isinstance(self.surface, NodeSurface):
                nodes[:, 0], weight[:, 0] = corners[:, 0], 0.0
                p0, p1 = move.ends(self.surface)
                carried = p0[vertex] - p1[vertex]
        else:
            nodes, weight[:, 2:] = ends[:, [0, 1, 0, 0]], 0.0
            weight[:, 0], weight[:, 1] = 1.0 - share, share
            x0, x1 = move.ends(self.faces)
            carried = np.einsum("kj,kji->ki", found.weight, x1[corners] - x0[corners])
        rows = Rows(
            self.slots[found.point],
            *about,
            nodes,
            weight,
            normal,
            gap,
            carried,
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
        return rows.take(np.flatnonzero((felt > FELT) & ~together))
