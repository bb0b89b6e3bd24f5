"""Offset of rigid surfaces that are initially penetrated by tissue or too close to it."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from sim.contact.curvature import pairs_of
from sim.contact.ipc import Barrier, CollisionPair, toolkit
from sim.contact.search import Found, nearest_faces
from sim.contact.signed_distance import SignedFaces
from sim.contact.surfaces import NodeSurface, Pairing, RigidShell
from sim.errors import ContactFailure
from sim.scene import Index
from sim.state import Array

DEEPEST = 5e-3  #: largest initial overlap [m]; deeper nodes are regarded as on the other side
TOUCHING = 1e-8  #: smallest distance at rest of distinguishable surfaces of the mesh [m]
ROUNDS = 200  #: largest number of moves of the vertices of a shell
MARGIN = 1e-3  #: additional offset of a shell, as a fraction of the distance


def cleared(pairing: Pairing, X: Array, barrier: Barrier) -> CollisionPair:
    """Pairing with separated surfaces: its shell is offset where tissue overlaps it.

    Vertices of the shell are offset until all distances exceed that of the barrier. The offsets are
    fixed to the shell. An overlap is measured along the normal of the nearest triangle, so that the
    shell need not be closed. X (n_nodes, 3) are the rest positions [m].

    Raises ContactFailure if surfaces of the mesh touch or cross at rest, or a shell would have to be
    offset by more than DEEPEST.
    """
    shells = [s for s in pairing.surfaces if isinstance(s, RigidShell)]
    pair = CollisionPair(pairing, shells, X, barrier)
    if not shells:
        _require_apart(pair, X)
        return pair
    (shell,) = shells  # a pairing has at least one surface of the mesh
    move = _Dents(pair, shell, X, barrier.distance).find()
    if not move.any():
        return pair
    dented = replace(shell, vertices=shell.vertices + move @ shell.place(0.0)[0])
    return CollisionPair(pairing, [dented], X, barrier)


class _Dents:
    """Search for displacements of the vertices of a shell that separate it from the tissue.

    Every violated distance requires a minimal displacement, along its gradient, of the vertices of
    the shell on which it depends; the largest of these displacements applies to each vertex.
    """

    def __init__(self, pair: CollisionPair, shell: RigidShell, X: Array, distance: float) -> None:
        (tissue,) = (s for s in pair.pairing.surfaces if isinstance(s, NodeSurface))
        self._pair, self._shell, self._tissue, self._X = pair, shell, tissue, X
        self._distance, self._ipc = distance, toolkit()
        self._outward, self._skin = SignedFaces(shell), SignedFaces(tissue)
        self._edges, self._faces = np.asarray(pair.mesh.edges), np.asarray(pair.mesh.faces)
        self._x, self._first = pair.vertices(X, 0.0), pair.n_soft
        self._demand = np.zeros((len(shell.vertices), 3))
        # Normals of the original shell; those of the offset shell would be tangential to the
        # offsets.
        self._normals = pair.mesh.face_normals(self._x)

    def find(self) -> Array:
        """Displacements (k, 3) [m].

        Raises ContactFailure if there are none within DEEPEST.
        """
        moved, x = np.zeros_like(self._demand), self._x.copy(order="F")
        for _ in range(ROUNDS):
            self._demand[:] = 0.0
            self._behind(x)
            if self._crossing(x) == 0:
                self._near(x)
            if not self._demand.any():
                return moved
            moved += self._demand
            if np.linalg.norm(moved, axis=1).max() > DEEPEST:
                break
            x[self._first :] = self._x[self._first :] + moved
        worst = int(np.argmax(np.linalg.norm(moved, axis=1)))
        away = self._X[self._tissue.nodes] - self._x[self._first + worst]
        near = int(self._tissue.nodes[np.argmin((away**2).sum(axis=1))])
        name, shell = self._pair.pairing.name, self._shell.name
        raise ContactFailure(
            f"pairing {name!r} starts intersecting: shell {shell!r} would have to be offset "
            f"by more than {DEEPEST * 1e3:g} mm near node {near}, expected surfaces that "
            "start apart or nearly so: move the shell, or orient its triangles "
            "counter-clockwise as seen from the tissue",
            surface=name,
            node=near,
        )

    def _ask(self, vertices: Index, moves: Array) -> None:
        """Require displacements `moves` (n, 3) of vertices (n,) of the shell."""
        size = (moves**2).sum(axis=1)
        order = np.argsort(size, kind="stable")
        own = (self._demand**2).sum(axis=1)
        last = np.zeros(len(own), dtype=np.int64)
        last[vertices[order]] = order  # The largest displacement is written last.
        named = np.unique(vertices)
        greater = named[size[last[named]] > own[named]]
        self._demand[greater] = moves[last[greater]]

    def _behind(self, x: Array) -> None:
        """Nodes of the tissue behind or close to the shell, and vertices of the shell in the tissue."""
        shell, tissue = np.ascontiguousarray(x[self._first :]), self._tissue
        found, lacking, normal = self._lacking(self._outward, shell, self._X[tissue.nodes])
        share = found.weight / (found.weight**2).sum(axis=1, keepdims=True)
        moves = -(share * lacking[:, None])[:, :, None] * normal[:, None, :]
        self._ask(self._shell.triangles[found.face].ravel(), moves.reshape(-1, 3))
        found, lacking, normal = self._lacking(self._skin, self._X, shell[self._shell.nodes])
        self._ask(self._shell.nodes[found.point], lacking[:, None] * normal)

    def _lacking(self, faces: SignedFaces, x: Array, points: Array) -> tuple[Found, Array, Array]:
        """Closest faces of points, missing distance of each point, and outward normals."""
        found = nearest_faces(points, DEEPEST, x, faces.triangles)
        gap, normal = faces.signed(points, found, x)
        lacking = np.where(
            gap < self._distance, self._distance - gap + MARGIN * self._distance, 0.0
        )
        return found, np.where(np.isnan(gap), 0.0, lacking), normal

    def _crossing(self, x: Array) -> int:
        """Separate edges that intersect triangles; return their number."""
        crossings = 0
        for edge, face in crossed(self._pair, x):
            crossings += 1
            into_tissue = self._faces[face][0] < self._first
            own = self._edges[edge] if into_tissue else self._faces[face]
            move = (1.0 if into_tissue else -1.0) * self._distance * self._normals[face]
            self._ask(own.astype(np.int64) - self._first, np.tile(move, (len(own), 1)))
        return crossings

    def _near(self, x: Array) -> None:
        """Pairs, including edges, that are closer than the distance."""
        found = self._ipc.NormalCollisions()
        found.build(self._pair.mesh, x, self._distance)
        for pair in pairs_of(found):
            ids = np.array([v for v in pair.vertex_ids(self._edges, self._faces) if v >= 0])
            away, weight = pair.compute_distance_vector_with_coefficients(x[ids].ravel())
            gap = float(np.linalg.norm(away))
            own = ids >= self._first
            w = np.asarray(weight)[own]
            lacking = self._distance - gap + MARGIN * self._distance
            if gap > 0.0 and (w**2).sum() > 0.0:
                moves = np.outer(w, np.asarray(away) * (lacking / gap / (w**2).sum()))
                self._ask(ids[own] - self._first, moves)


def crossed(pair: CollisionPair, x: Array) -> Iterator[tuple[int, int]]:
    """Edges and triangles of the collision mesh that intersect at x."""
    ipctk = toolkit()
    if not ipctk.has_intersections(pair.mesh, x):
        return
    edges, faces = np.asarray(pair.mesh.edges), np.asarray(pair.mesh.faces)
    search = ipctk.LBVH()
    search.can_vertices_collide = pair.mesh.can_collide
    search.build(x, pair.mesh.edges, pair.mesh.faces)
    for found in search.detect_edge_face_candidates():
        corners = x[edges[found.edge_id]], x[faces[found.face_id]]
        if ipctk.is_edge_intersecting_triangle(*corners[0], *corners[1]):
            yield int(found.edge_id), int(found.face_id)


def _require_apart(pair: CollisionPair, X: Array) -> None:
    """Refuse surfaces of the mesh that touch or cross at rest."""
    x = pair.vertices(X, 0.0)
    edges, faces = np.asarray(pair.mesh.edges), np.asarray(pair.mesh.faces)
    for edge, face in crossed(pair, x):
        _refuse(pair, edges[edge], faces[face], "cross")
    found = pair.collisions(x)
    for near in pairs_of(found):
        if near.compute_distance(x, edges, faces) < TOUCHING**2:
            ids = [v for v in near.vertex_ids(edges, faces) if v >= 0]
            _refuse(pair, ids[:1], ids[1:], "touch")


def _refuse(pair: CollisionPair, some: Any, others: Any, how: str) -> None:
    here, there = (pair.node[list(part)].tolist() for part in (some, others))
    raise ContactFailure(
        f"pairing {pair.pairing.name!r} starts intersecting: nodes {here} and {there} {how} at rest, "
        "expected surfaces of the mesh that start apart: separate them by a small gap",
        surface=pair.pairing.name,
        node=here[0],
    )
