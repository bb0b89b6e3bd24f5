"""Signed distances to a surface, and their directions."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim._kernels.triangles import CORNER_0, EDGE_0, EDGE_2, INSIDE_FACE, closest, normals
from sim.contact.connectivity import sides_of
from sim.contact.search import NO_NORMALS, Found
from sim.contact.surfaces import Surface
from sim.state import Array

OPPOSED = 0.5
"""Length of the difference of two normals from which they face each other."""

FLAT = 0.95
"""Cosine of the angle between a face and a mean normal, below which an edge is sharp."""

CONCAVE = 0.1
"""Sine of the angle from which two faces make a groove."""

ON_EDGE = 1e-6
"""What lies no farther within a face counts as on its edge [m], as rounding would have it."""

NO_LENGTH = 1e-6
"""Distances below this share of a side have no direction of their own."""


class SignedFaces:
    """Outward directions of a surface, for the signed distance to it.

    Parameters
    ----------
    surface : NodeSurface or RigidShell

    Notes
    -----
    The sign follows from the normal of the nearest face, or from the sum of the normals of the nearest
    edge, or from the angle-weighted normals of the nearest vertex (Baerentzen and Aanaes 2005, Signed
    distance computation using the angle weighted pseudonormal). At a free edge of an open surface there
    is no sign.
    """

    def __init__(self, surface: Surface) -> None:
        self.triangles = surface.triangles
        sides = sides_of(surface.triangles)
        size = int(surface.triangles.max()) + 1
        key, back = sides[:, 0] * size + sides[:, 1], sides[:, 1] * size + sides[:, 0]
        order = np.argsort(key)
        place = np.minimum(np.searchsorted(key[order], back), len(key) - 1)
        match = order[place]
        self._across = np.where(key[match] == back, match // 3, -1).reshape(-1, 3)
        self._free = np.zeros(size, dtype=bool)
        self._free[surface.open_edges] = True
        self._latest: tuple[Array, Array, Array] | None = None

    def normals(self, x: Array) -> tuple[Array, Array]:
        """Unit normals of the faces (k, 3) and of the positions x (m, 3), zero where none is named.

        Those of the latest positions are kept: a step asks for the same ones several times, and a shell
        that does not move has no others.
        """
        if self._latest is not None and np.array_equal(self._latest[0], x):
            return self._latest[1:]
        face, corner = np.empty((len(self.triangles), 3)), np.empty((len(x), 3))
        normals(x, self.triangles, face, corner)
        self._latest = (x.copy(), face, corner)
        return face, corner

    def beside(
        self, points: Array, found: Found, x: Array, near: float
    ) -> tuple[Found, Array, Array]:
        """Faces that meet the nearest one at a concave edge, where a point is above both.

        A point in a groove is held by both its walls.

        Parameters
        ----------
        points : (n, 3) [m]
        found : Found
            Of `nearest_faces`.
        x : (m, 3) positions that the triangles name [m].
        near : float
            A further face counts where the point is above it, or nearer to it than this [m].

        Returns
        -------
        found : Found
            The same points again, once per further face, with the distances from its plane.
        gap : (k,) distance from the plane of the face, negative behind [m].
        normal : (k, 3) its unit normal.
        """
        by_face, _ = self.normals(x)
        across = self._across[found.face]
        row, side = np.nonzero(across >= 0)
        face, first = across[row, side], found.face[row]
        opposite = x[self.triangles[face]] - x[self.triangles[first, side]][:, None]
        height = np.einsum("kji,ki->kj", opposite, by_face[first]).max(axis=1)
        reach = np.sqrt((opposite**2).sum(axis=2).max(axis=1))
        keep = np.flatnonzero(height > CONCAVE * reach)
        row, face = row[keep], face[keep]
        at, k = found.point[row], len(row)
        weight, squared = np.empty((k, 3)), np.empty(k)
        feature = np.empty(k, dtype=np.int64)
        closest(np.ascontiguousarray(points[at]), x, self.triangles[face], weight, squared, feature)
        keep = np.flatnonzero((feature == INSIDE_FACE) | (squared < near * near))
        at, face, weight = at[keep], face[keep], weight[keep]
        nearest = np.einsum("kj,kji->ki", weight, x[self.triangles[face]])
        gap = np.einsum("ki,ki->k", points[at] - nearest, by_face[face])
        return Found(at, face, weight, np.abs(gap), feature[keep]), gap, by_face[face]

    def signed(
        self,
        points: Array,
        found: Found,
        x: Array,
        blur: float = 0.0,
        against: Array = NO_NORMALS,
    ) -> tuple[Array, Array]:
        """Signed distances and their directions.

        Parameters
        ----------
        points : (n, 3) [m]
        found : Found
            Of `nearest_faces`.
        x : (m, 3) positions that the triangles name [m].
        blur : float
            Nearer than about this to an edge or a vertex [m] the mean normal of its faces serves as
            direction, since that of the distance turns within the distance itself; the gap is then
            counted along it.
        against : (n, 3), optional
            Outward normals of the points, which share in that mean: two rims that meet push each other
            straight, not along their diagonals.

        Returns
        -------
        gap : (k,) distance, negative inside [m]; NaN at a free edge.
        normal : (k, 3) unit vectors out of the surface, without blur the gradient of the gap.
        """
        by_face, by_corner = self.normals(x)
        found = self._on_edges(found, x)
        f, what = found.face, found.feature
        outward, free = self._outward(found, by_face, by_corner)
        nearest = np.einsum("kj,kji->ki", found.weight, x[self.triangles[f]])
        way = points[found.point] - nearest
        side = np.einsum("ki,ki->k", way, outward)
        sign = np.where(side < 0.0, -1.0, 1.0)
        gap = np.where(free, np.nan, sign * found.value)
        # within a face the normal is known better than the difference of two near points
        reach = np.sqrt(((x[self.triangles[f, 1]] - x[self.triangles[f, 0]]) ** 2).sum(axis=1))
        apart = (what > 0) & (found.value > NO_LENGTH * reach)
        length = np.where(found.value > 0.0, found.value, 1.0)
        normal = np.where(apart[:, None], (sign / length)[:, None] * way, outward)
        if blur == 0.0:
            return gap, normal
        if len(against):
            outward = _between(outward, against[found.point], by_face[f])
        share = found.value / (found.value + blur)
        mixed = share[:, None] * normal + (1.0 - share)[:, None] * outward
        mixed /= np.linalg.norm(mixed, axis=1, keepdims=True)
        normal = np.where((what > 0)[:, None], mixed, normal)
        along = np.einsum("ki,ki->k", way, normal)
        return np.where((what > 0) & ~free, along, gap), normal

    def _on_edges(self, found: Found, x: Array) -> Found:
        """The same, with what is nearest within a face but a hair from its rim on the rim.

        Bodies with their sides in one plane touch with their rims; a rounding error must not make their
        sides touch instead.
        """
        corners = x[self.triangles[found.face]]
        side = np.linalg.norm(corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]], axis=2)
        double = np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        # distances of the nearest point from the sides opposite the corners
        near = found.weight * double[:, None] < ON_EDGE * side
        count, feature = near.sum(axis=1), found.feature.copy()
        edge = np.flatnonzero((feature == INSIDE_FACE) & (count == 1))
        first = (np.argmax(near[edge], axis=1) + 1) % 3
        inner = self._across[found.face[edge], first] >= 0  # a free edge has no sign
        feature[edge[inner]] = EDGE_0 + first[inner]
        corner = np.flatnonzero((feature < CORNER_0) & (count == 2))
        which = np.argmin(near[corner], axis=1)
        inner = ~self._free[self.triangles[found.face[corner], which]]
        feature[corner[inner]] = CORNER_0 + which[inner]
        return replace(found, feature=feature)

    def _outward(
        self, found: Found, by_face: Array, by_corner: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Mean normals (k, 3) of what is nearest, and whether that is a free edge."""
        f, what = found.face, found.feature
        outward = by_face[f].copy()
        free = np.zeros(len(f), dtype=bool)
        edge = np.flatnonzero((what >= EDGE_0) & (what <= EDGE_2))
        across = self._across[f[edge], what[edge] - EDGE_0]
        outward[edge] += np.where(across[:, None] >= 0, by_face[across], 0.0)
        free[edge] = across < 0
        corner = np.flatnonzero(what >= CORNER_0)
        vertex = self.triangles[f[corner], what[corner] - CORNER_0]
        outward[corner] = by_corner[vertex]
        free[corner] = self._free[vertex]
        size = np.linalg.norm(outward, axis=1, keepdims=True)
        return outward / np.where(size > 0.0, size, 1.0), free


def _between(outward: Array, against: Array, by_face: Array) -> Array:
    """Mean of two opposed normals at a sharp edge, the given ones elsewhere."""
    between = outward - against
    size = np.linalg.norm(between, axis=1, keepdims=True)
    sharp = np.einsum("ki,ki->k", outward, by_face) < FLAT
    use = (size > OPPOSED) & sharp[:, None]
    return np.where(use, between / np.maximum(size, OPPOSED), outward)
