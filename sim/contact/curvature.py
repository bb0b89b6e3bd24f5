"""Stiffness of a barrier: its second derivative without the turning of normals."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.scene import Index
from sim.state import Array


@dataclass(frozen=True)
class NormalStiffness:
    """Sum over pairs k of scale_k J_k J_k', with J_k = share_ka n_k at vertex a of the pair.

    Attributes
    ----------
    vertex : (n, 4) vertices of every pair; those without a share repeat the first.
    share : (n, 4) derivative of the distance vector by the vertices [1].
    normal : (n, 3) unit vectors.
    scale : (n,) second derivative by the distance, >= 0 [N/m].
    """

    vertex: Index
    share: Array
    normal: Array
    scale: Array

    def blocks(self) -> Array:
        """All of it (n, 4, 3, 4, 3) [N/m]."""
        J = self.share[:, :, None] * self.normal[:, None, :]
        return np.einsum("k,kai,kbj->kaibj", self.scale, J, J)

    def own_blocks(self) -> Array:
        """A bound from above that couples no two vertices (n, 4, 3, 3) [N/m].

        By Cauchy's inequality (sum_a c_a u_a)^2 <= sum_a |c_a| * sum_a |c_a| u_a^2.
        """
        c = np.abs(self.share)
        weight = self.scale[:, None] * c * c.sum(axis=1, keepdims=True)
        return np.einsum("ka,ki,kj->kaij", weight, self.normal, self.normal)


def pairs_of(found: Any) -> list[Any]:
    """All pairs of a set of collisions, as copies: ``found[k]`` does not keep its set alive."""
    kinds = found.vv_collisions, found.ev_collisions, found.ee_collisions, found.fv_collisions
    return [pair for kind in kinds for pair in kind]


def normal_stiffness(
    found: Any, mesh: Any, x: Array, distance: float, stiffness: float
) -> NormalStiffness:
    """Stiffness of all pairs, without the turning of their normals.

    The pairs of the area-weighted barrier have weights of both signs, which count every place once: one
    that is nearest at a corner, and the corner. A projection of each pair on its own would keep what
    they are there to take away. So pairs with the same nearest points are united first, and the turning
    of their normals, which pressure only makes softer, is left out.

    Parameters
    ----------
    found : ipctk.NormalCollisions
    mesh : ipctk.CollisionMesh
    x : (k, 3) vertices [m].
    distance, stiffness : of the barrier [m], [Pa].

    Returns
    -------
    NormalStiffness
        Positive semi-definite.
    """
    edges, faces = np.asarray(mesh.edges), np.asarray(mesh.faces)
    pairs = pairs_of(found)
    n = len(pairs)
    if n == 0:
        none = np.empty((0, 4))
        return NormalStiffness(none.astype(np.int64), none, none[:, :3], none[:, 0])
    vertex, share = np.full((n, 4), -1), np.zeros((n, 4))
    scale = np.empty(n)
    for k, pair in enumerate(pairs):
        ids = [v for v in pair.vertex_ids(edges, faces) if v >= 0]
        here = x[ids].ravel()
        coefficients = pair.compute_coefficients(here)
        vertex[k, : len(ids)] = ids
        share[k, : len(ids)] = coefficients
        vertex[k, np.abs(share[k]) < 1e-12] = -1  # not where the distance is
        scale[k] = pair.weight * (pair.mollifier(here) if pair.is_mollified() else 1.0)
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
