"""The faces of a surface: which are near, signed distances to them, and their directions."""

import numpy as np

from sim._kernels.grid import Grid, grid_of
from sim._kernels.signed import signed, walls
from sim._kernels.triangles import normals
from sim.contact.connectivity import sides_of
from sim.contact.recent import Recent
from sim.contact.search import NO_NORMALS, Found, entered_faces, nearest_faces
from sim.contact.surfaces import Surface
from sim.scene import Index
from sim.state import Array

GRIDS = 3
"""Grids that are kept: at the start, at the end and over a step."""


class SignedFaces:
    """The faces of a surface: the nearest to points, those that points enter, and signed distances.

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
        self.surface, self.triangles = surface, surface.triangles
        sides = sides_of(surface.triangles)
        size = int(surface.triangles.max()) + 1
        key, back = sides[:, 0] * size + sides[:, 1], sides[:, 1] * size + sides[:, 0]
        order = np.argsort(key)
        place = np.minimum(np.searchsorted(key[order], back), len(key) - 1)
        match = order[place]
        self._across = np.where(key[match] == back, match // 3, -1).reshape(-1, 3)
        self._free = np.zeros(size, dtype=bool)
        self._free[surface.open_edges] = True
        self._normals, self._grid = Recent(self._normals_at), Recent(self._grid_over, GRIDS)

    def normals(self, x: Array) -> tuple[Array, Array]:
        """Unit normals of the faces (k, 3) and of the positions x (m, 3), zero where none is named."""
        return self._normals(x)

    def _normals_at(self, x: Array) -> tuple[Array, Array]:
        face, corner = np.empty((len(self.triangles), 3)), np.empty((len(x), 3))
        normals(x, self.triangles, face, corner)
        return face, corner

    def nearest(
        self, points: Array, radius: Array | float, x: Array, nodes: Index, away: Array = NO_NORMALS
    ) -> Found:
        """Nearest face of every point within a radius; see `nearest_faces`."""
        grid = self._grid(x, x)
        return nearest_faces(points, radius, x, self.triangles, nodes=nodes, away=away, grid=grid)

    def entered(self, before: Array, after: Array, x0: Array, x1: Array, nodes: Index) -> Found:
        """First face that every point enters while they move from x0 to x1; see `entered_faces`."""
        grid = self._grid(x0, x1)
        return entered_faces(before, after, x0, x1, self.triangles, nodes=nodes, grid=grid)

    def _grid_over(self, x0: Array, x1: Array) -> Grid:
        return grid_of(x0, x1, self.triangles)

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
        room = 3 * len(found.point)
        which, face, feature = (np.empty(room, dtype=np.int64) for _ in range(3))
        weight, gap = np.empty((room + 1, 3)), np.empty(room)
        n = walls(
            np.ascontiguousarray(points),
            found.point,
            found.face,
            x,
            self.triangles,
            self._across,
            by_face,
            near,
            which,
            face,
            weight,
            gap,
            feature,
        )
        beside = Found(found.point[which[:n]], face[:n], weight[:n], np.abs(gap[:n]), feature[:n])
        return beside, gap[:n], by_face[face[:n]]

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
        k = len(found.point)
        gap, normal = np.empty(k), np.empty((k, 3))
        signed(
            np.ascontiguousarray(points),
            found.point,
            found.face,
            found.weight,
            found.value,
            found.feature,
            x,
            self.triangles,
            self._across,
            self._free,
            by_face,
            by_corner,
            blur,
            against,
            gap,
            normal,
        )
        return gap, normal
