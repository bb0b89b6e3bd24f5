"""Closest faces of a surface, signed distances and their directions."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Generic, TypeVar

import numpy as np

from sim._kernels.signed import places, signed, walls
from sim._kernels.triangles import normals
from sim.contact.connectivity import sides_of
from sim.contact.search import NO_NORMALS, Found
from sim.contact.surfaces import Surface
from sim.scene import Index
from sim.state import Array

Result = TypeVar("Result")


class Recent(Generic[Result]):
    """Function of positions with a cache of its latest results.

    A step evaluates the same positions several times, alternately at its start and its end; those
    of a shell at rest are always the same.

    Parameters
    ----------
    make : callable
        Result for one or several arrays of positions.
    size : int
        Number of cached results.
    """

    def __init__(self, make: Callable[..., Result], size: int = 2) -> None:
        self._make = make
        self._kept: deque[tuple[tuple[Array, ...], Result]] = deque(maxlen=size)

    def __call__(self, *x: Array) -> Result:
        """Result for positions x, the same object while it is cached."""
        for known, result in self._kept:
            if len(known) == len(x) and all(map(np.array_equal, known, x)):
                return result
        result = self._make(*x)
        self._kept.append((tuple(a.copy() for a in x), result))
        return result


class SignedFaces:
    """Faces of a surface: closest faces, entered faces and signed distances.

    Parameters
    ----------
    surface : NodeSurface or RigidShell

    Notes
    -----
    The sign follows from the normal of the nearest face, or from the sum of the normals of the
    nearest edge, or from the angle-weighted normals of the nearest vertex (Baerentzen and Aanaes
    2005, Signed distance computation using the angle weighted pseudonormal). At a free edge of an
    open surface there is no sign.
    """

    def __init__(self, surface: Surface) -> None:
        self.surface, self.triangles = surface, surface.triangles
        sides = sides_of(surface.triangles)
        size = int(surface.triangles.max()) + 1
        key, back = sides[:, 0] * size + sides[:, 1], sides[:, 1] * size + sides[:, 0]
        order = np.argsort(key)
        place = np.minimum(np.searchsorted(key[order], back), len(key) - 1)
        match = order[place]
        paired, own = key[match] == back, np.arange(len(key))
        self._across = np.where(paired, match // 3, -1).reshape(-1, 3)
        self._edge = np.where(paired, np.minimum(own, match), own).reshape(-1, 3)
        self._free = np.zeros(size, dtype=bool)
        self._free[surface.open_edges] = True
        self._normals = Recent(self._normals_at)

    def normals(self, x: Array) -> tuple[Array, Array]:
        """Unit normals of the faces (k, 3) and of the vertices x (m, 3), zero for unused ones."""
        face, corner, _ = self._normals(x)
        return face, corner

    def normals_of(self, place: Index, x: Array) -> Array:
        """Unit normals (k, 3) of features: faces, edges and vertices numbered by `distinct`."""
        face, corner, _ = self._normals(x)
        m, out = len(self.triangles), np.empty((len(place), 3))
        within, vertex = place < m, place >= 4 * m
        edge = ~within & ~vertex
        out[within], out[vertex] = face[place[within]], corner[place[vertex] - 4 * m]
        one, side = np.divmod(place[edge] - m, 3)
        other = self._across[one, side]
        mean = face[one] + np.where((other >= 0)[:, None], face[other], 0.0)
        size = np.linalg.norm(mean, axis=1, keepdims=True)
        out[edge] = mean / np.where(size > 0.0, size, 1.0)
        return out

    def _normals_at(self, x: Array) -> tuple[Array, Array, Array]:
        face, corner, flat = np.empty((len(self.triangles), 3)), np.empty_like(x), np.empty(len(x))
        normals(x, self.triangles, face, corner, flat)
        return face, corner, flat

    def places(self, found: Found, x: Array) -> tuple[Index, Array]:
        """Indices (k,) of the closest faces, edges or vertices, and weights on them.

        An edge has the same index for both its faces, and a vertex for all.
        """
        place, weight = np.empty(len(found.point), dtype=np.int64), found.weight.copy()
        about = (self._across, self._free, self._edge)
        places(found.face, weight, found.feature, x, self.triangles, *about, place)
        return place, weight

    def places_of(self, found: Found, x: Array) -> tuple[Found, Index]:
        """Unique closest faces, edges and vertices of points, and their indices."""
        place, weight = self.places(found, x)
        _, first = np.unique(self._keys(found, place), return_index=True)
        return replace(found, weight=weight).take(first), place[first]

    def _keys(self, found: Found, place: Index) -> Index:
        """Unique integers (k,) of points and features, in the order of points."""
        return found.point * (4 * len(self.triangles) + len(self._free)) + place

    def distinct(
        self,
        points: Array,
        every: Found,
        placed: tuple[Index, Array],
        x: Array,
        blur: float,
        against: Array,
    ) -> tuple[Found, Index, Array, Array]:
        """Unique closest features of equally close faces.

        A point inside, midway between faces with opposite normals, keeps the first.

        Parameters
        ----------
        points, x, blur, against
            As of `signed`.
        every : Found
            Of `closest_faces`.
        placed : their `places`.

        Returns
        -------
        found : Found
        place : (k,) number of the face, edge or vertex.
        gap, normal : (k,), (k, 3)
            As of `signed`, the normal of a feature from all its faces.
        """
        gaps, normals = self.signed(points, every, x, blur, against)
        places, weight = placed
        _, first, group = np.unique(
            self._keys(every, places), return_index=True, return_inverse=True
        )
        normal, gap = np.zeros((len(first), 3)), np.full(len(first), np.nan)
        np.add.at(normal, group, normals)
        np.fmax.at(gap, group, gaps)
        size = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = np.where(size > 0.0, normal / np.where(size > 0.0, size, 1.0), normals[first])
        found, place = replace(every, weight=weight).take(first), places[first]
        leader = np.searchsorted(found.point, found.point)
        against_it = np.einsum("ki,ki->k", normal, normal[leader]) < 0.0
        good = np.flatnonzero(~(against_it & (gap < 0.0)))
        return found.take(good), place[good], gap[good], normal[good]

    def beside(
        self, points: Array, found: Found, places: Index, x: Array, near: float
    ) -> tuple[Found, Array, Array]:
        """Faces adjacent to the closest one at a concave edge, if the point is above both.

        A point in a groove has rows for both its walls.

        Parameters
        ----------
        points : (n, 3) [m]
        found : Found
            Of `closest_faces`.
        places : (k,) their features.
        x : (m, 3) positions of the vertices of the triangles [m].
        near : float
            Distance below which a further face is included also if the point is not above it [m].

        Returns
        -------
        found : Found
            The same points, once per further face, with the distances from its plane. Faces that
            contain closest points in their interior are omitted.
        gap : (k,) distance from the plane of the face, negative behind [m].
        normal : (k, 3) its unit normal.
        """
        by_face, _ = self.normals(x)
        n_faces = len(self.triangles)
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
        point = found.point[which[:n]]
        within = places < n_faces
        known = found.point[within] * n_faces + places[within]
        key, first = np.unique(point * n_faces + face[:n], return_index=True)
        keep = first[~np.isin(key, known)]
        beside = Found(point[keep], face[keep], weight[keep], np.abs(gap[keep]), feature[keep])
        return beside, gap[keep], by_face[face[keep]]

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
        x : (m, 3) positions of the vertices of the triangles [m].
        blur : float
            Distance from an edge or a vertex [m] below which the direction is the mean normal of
            its faces, because the gradient of the distance changes over a length equal to the
            distance; the gap is then measured along the mean normal.
        against : (n, 3), optional
            Outward normals of the points, which are included in this mean, so that the forces
            between two edges are not diagonal.

        Returns
        -------
        gap : (k,) distance, negative inside [m]; NaN at a free edge.
        normal : (k, 3) outward unit vectors, without blur the gradient of the gap.
        """
        by_face, by_corner, flat = self._normals(x)
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
            flat,
            blur,
            against,
            gap,
            normal,
        )
        return gap, normal
