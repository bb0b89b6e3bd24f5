"""Stiffness of a barrier: its second derivative without the rotation of the normals."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sim._kernels import barrier as kernel
from sim.scene import Index
from sim.state import Array


@dataclass(frozen=True)
class NormalStiffness:
    """Sum over pairs k of scale_k J_k J_k', with J_k = share_ka n_k at vertex a of the pair."""

    vertex: Index  #: (n, 4) vertices of every pair; unused ones repeat the first
    share: Array  #: (n, 4) derivative of the distance vector by the vertices [1]
    normal: Array  #: (n, 3) unit vectors
    scale: Array  #: (n,) second derivative by the distance, >= 0 [N/m]

    def blocks(self) -> Array:
        """Full blocks (n, 4, 3, 4, 3) [N/m]."""
        J = self.share[:, :, None] * self.normal[:, None, :]
        return np.einsum("k,kai,kbj->kaibj", self.scale, J, J)

    def own_blocks(self) -> Array:
        """Upper bound without coupling of vertices (n, 4, 3, 3) [N/m].

        By Cauchy's inequality (sum_a c_a u_a)^2 <= sum_a |c_a| * sum_a |c_a| u_a^2.
        """
        c = np.abs(self.share)
        weight = self.scale[:, None] * c * c.sum(axis=1, keepdims=True)
        return np.einsum("ka,ki,kj->kaij", weight, self.normal, self.normal)


def pairs_of(found: Any) -> list[Any]:
    """Copies of all pairs of a set of collisions, because ``found[k]`` does not keep the set alive."""
    return [pair for kind in _kinds(found) for pair in kind]


def normal_stiffness(
    found: Any, mesh: Any, x: Array, distance: float, stiffness: float
) -> NormalStiffness:
    """Stiffness of all pairs, without the rotation of their normals, positive semi-definite.

    The pairs of the area-weighted barrier have weights of both signs, so that every closest point
    is counted once: for example, one whose closest feature is a corner, and the corner itself. A
    projection of each pair would keep the contributions that others cancel. Pairs with the same
    closest points are therefore combined first; the rotation of their normals, which only reduces
    the stiffness, is omitted.

    `found` are ipctk.NormalCollisions of an ipctk.CollisionMesh with vertices x (k, 3) [m]; distance
    [m] and stiffness [Pa] are those of the barrier.
    """
    kind, vertex, scale = _read(found, mesh, x)
    if len(kind) == 0:
        none = np.empty((0, 4))
        return NormalStiffness(none.astype(np.int64), none, none[:, :3], none[:, 0])
    share = np.empty((len(kind), 4))
    kernel.shares(kind, vertex, np.ascontiguousarray(x), share)
    vertex[share == 0.0] = -1  # The distance does not depend on this vertex.
    order = np.argsort(-vertex, axis=1)
    vertex, share = (np.take_along_axis(part, order, axis=1) for part in (vertex, share))
    vertex, first, which = np.unique(vertex, axis=0, return_index=True, return_inverse=True)
    share = np.where(vertex >= 0, share[first], 0.0)
    scale = np.maximum(np.bincount(which.ravel(), scale, len(vertex)), 0.0)
    vertex = np.where(vertex >= 0, vertex, vertex[:, :1])
    away = np.einsum("ka,kai->ki", share, x[vertex])
    gap = np.sqrt((away**2).sum(axis=1))
    y2 = (gap / distance) ** 2
    bend = -(12.0 * y2 - 4.0) * np.log(y2) - 16.0 * (y2 - 1.0) + 2.0 * (y2 - 1.0) ** 2 / y2
    scale *= stiffness / distance * np.where(y2 < 1.0, bend, 0.0)
    return NormalStiffness(vertex, share, away / gap[:, None], scale)


def _read(found: Any, mesh: Any, x: Array) -> tuple[Index, Index, Array]:
    """Types (n,), vertices (n, 4) and weights (n,) of all pairs, for the kernel."""
    edges, faces = np.asarray(mesh.edges), np.asarray(mesh.faces)
    vv, ev, ee, fv = (list(part) for part in _kinds(found))
    rows = [
        np.array([(p.vertex0_id, p.vertex1_id) for p in vv], np.int64).reshape(-1, 2),
        np.array([(p.vertex_id, p.edge_id) for p in ev], np.int64).reshape(-1, 2),
        np.array([(p.edge0_id, p.edge1_id) for p in ee], np.int64).reshape(-1, 2),
        np.array([(p.vertex_id, p.face_id) for p in fv], np.int64).reshape(-1, 2),
    ]
    kind = np.repeat(np.arange(4), [len(part) for part in rows])
    vertex = np.zeros((len(kind), 4), dtype=np.int64)
    vertex[kind == kernel.VERTICES, :2] = rows[0]
    vertex[kind == kernel.EDGE_VERTEX, :3] = np.c_[rows[1][:, :1], edges[rows[1][:, 1]]]
    vertex[kind == kernel.EDGES] = np.c_[edges[rows[2][:, 0]], edges[rows[2][:, 1]]]
    vertex[kind == kernel.FACE_VERTEX] = np.c_[rows[3][:, :1], faces[rows[3][:, 1]]]
    weight = np.array([p.weight for part in (vv, ev, ee, fv) for p in part])
    first = len(vv) + len(ev)
    for k, p in enumerate(ee):
        if p.is_mollified():
            weight[first + k] *= p.mollifier(x[vertex[first + k]].ravel())
    return kind, vertex, weight


def _kinds(found: Any) -> tuple[Any, Any, Any, Any]:
    return found.vv_collisions, found.ev_collisions, found.ee_collisions, found.fv_collisions
