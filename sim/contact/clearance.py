"""Shells made clear of the tissue that starts inside or too near them."""

from dataclasses import replace
from typing import Any

import numpy as np

from sim.contact.ipc import Barrier, CollisionPair, toolkit
from sim.contact.search import Found, SignedFaces, nearest_faces
from sim.contact.surfaces import NodeSurface, Pairing, RigidShell
from sim.errors import ContactFailure
from sim.state import Array

DEEPEST = 5e-3
"""Largest initial overlap that counts as one [m]; what lies deeper is on the other side."""

TOUCHING = 1e-8
"""Surfaces of the mesh that are nearer at rest cannot be told apart [m]."""

ROUNDS = 200


def cleared(pairing: Pairing, X: Array, barrier: Barrier) -> CollisionPair:
    """Pairing whose surfaces start apart: its shells are dented where tissue is in the way.

    A vertex of a shell recedes along the mean normal of its triangles, against the outside, until
    everything is clear by the distance of the barrier. The dents move with the shell and stay. An
    overlap is measured along the normal of the nearest triangle, hence needs no closed shell.

    Parameters
    ----------
    pairing : Pairing
    X : (n_nodes, 3) rest positions [m].
    barrier : Barrier

    Raises
    ------
    ContactFailure
        Surfaces of the mesh touch or cross at rest, or a shell would have to recede by more than
        DEEPEST.
    """
    shells = [s for s in pairing.surfaces if isinstance(s, RigidShell)]
    pair = CollisionPair(pairing, shells, X, barrier)
    if not shells:
        _require_apart(pair, X)
        return pair
    (shell,) = shells  # a pairing has at least one surface of the mesh
    recede = _recession(pair, shell, X, barrier.distance)
    if not recede.any():
        return pair
    dented = replace(
        shell, vertices=shell.vertices - recede[:, None] * _normals(shell, shell.vertices)
    )
    return CollisionPair(pairing, [dented], X, barrier)


def _recession(pair: CollisionPair, shell: RigidShell, X: Array, distance: float) -> Array:
    """How far each vertex of the shell recedes (k,) [m]."""
    (tissue,) = (s for s in pair.pairing.surfaces if isinstance(s, NodeSurface))
    outward, behind = SignedFaces(shell), SignedFaces(tissue)
    x, first = pair.vertices(X, 0.0), pair.n_soft
    normals = _normals(shell, x[first:])
    recede = np.zeros(len(shell.vertices))
    y = x.copy(order="F")
    for _ in range(ROUNDS):
        y[first:] = x[first:] - recede[:, None] * normals
        here = np.ascontiguousarray(y[first:])
        need = np.zeros(len(shell.vertices))
        found, lacking = _lacking(outward, here, X[tissue.nodes], distance)
        at = shell.triangles[found.face]
        np.maximum.at(need, at, np.broadcast_to(lacking[:, None], at.shape))
        found, lacking = _lacking(behind, X, here[shell.nodes], distance)
        np.maximum.at(need, shell.nodes[found.point], lacking)
        np.maximum(need, _lacking_edges(pair, y, distance)[first:], out=need)
        if not (need > 1e-3 * distance).any():
            break
        recede += np.where(need > 0.0, need + 1e-3 * distance, 0.0)
        if recede.max() > DEEPEST:
            break
    if recede.max() > DEEPEST or toolkit().has_intersections(pair.mesh, y):
        at = int(np.argmax(recede))
        near = int(tissue.nodes[np.argmin(((X[tissue.nodes] - x[first + at]) ** 2).sum(axis=1))])
        raise ContactFailure(
            f"pairing {pair.pairing.name!r} starts tangled: shell {shell.name!r} would have to recede "
            f"by more than {DEEPEST * 1e3:g} mm near node {near}, expected surfaces that start apart or "
            "overlap less: move the shell, or turn its triangles to be seen counter-clockwise from "
            "the side of the tissue",
            surface=pair.pairing.name,
            node=near,
        )
    return recede


def _lacking(faces: SignedFaces, x: Array, points: Array, distance: float) -> tuple[Found, Array]:
    """Nearest faces of points, and by how much each point is too near or behind, >= 0 [m]."""
    found = nearest_faces(points, DEEPEST, x, faces.triangles)
    gap, _ = faces.signed(points, found, x)
    gap = np.where(np.isnan(gap), found.value, gap)  # beyond a free edge nothing is behind
    return found, np.maximum(distance - gap, 0.0)


def _lacking_edges(pair: CollisionPair, y: Array, distance: float) -> Array:
    """By how much each vertex is too near to something on the other surface, edges included (k,)."""
    found = toolkit().NormalCollisions()
    found.build(pair.mesh, y, distance)
    edges, faces = np.asarray(pair.mesh.edges), np.asarray(pair.mesh.faces)
    need = np.zeros(len(y))
    for k in range(len(found)):
        ids = [v for v in found[k].vertex_ids(edges, faces) if v >= 0]
        lacking = distance - np.sqrt(found[k].compute_distance(y, edges, faces))
        need[ids] = np.maximum(need[ids], lacking)
    return need


def _normals(shell: RigidShell, x: Array) -> Array:
    """Unit normals (k, 3) of the vertices of a shell at x."""
    return SignedFaces(shell).normals(np.ascontiguousarray(x))[1]


def _require_apart(pair: CollisionPair, X: Array) -> None:
    """Refuse surfaces of the mesh that touch or cross at rest."""
    x = pair.vertices(X, 0.0)
    ipctk = toolkit()
    edges, faces = np.asarray(pair.mesh.edges), np.asarray(pair.mesh.faces)
    if ipctk.has_intersections(pair.mesh, x):
        search = ipctk.LBVH()
        search.can_vertices_collide = pair.mesh.can_collide
        search.build(x, pair.mesh.edges, pair.mesh.faces)
        for candidate in search.detect_edge_face_candidates():
            edge, face = edges[candidate.edge_id], faces[candidate.face_id]
            if ipctk.is_edge_intersecting_triangle(*x[edge], *x[face]):
                _refuse(pair, edge, face, "cross")
    found = pair.collisions(x)
    for k in range(len(found)):
        if found[k].compute_distance(x, edges, faces) < TOUCHING**2:
            ids = [v for v in found[k].vertex_ids(edges, faces) if v >= 0]
            _refuse(pair, ids[:1], ids[1:], "touch")


def _refuse(pair: CollisionPair, some: Any, others: Any, how: str) -> None:
    here, there = (pair.node[list(part)].tolist() for part in (some, others))
    raise ContactFailure(
        f"pairing {pair.pairing.name!r} starts tangled: nodes {here} and {there} {how} at rest, "
        "expected surfaces of the mesh that start apart: part them by a small gap",
        surface=pair.pairing.name,
        node=here[0],
    )
