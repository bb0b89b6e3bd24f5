"""Closest faces of a surface, signed distances and their directions."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from sim._kernels.signed import met, places, signed
from sim._kernels.triangles import normals
from sim.contact.connectivity import sides_of
from sim.contact.search import SAME_DISTANCE, Candidates, Found
from sim.contact.surfaces import NodeSurface, Surface
from sim.scene import Index
from sim.state import Array

Result = TypeVar("Result")


class Recent(Generic[Result]):
    """Function of positions with a cache of its latest results.

    A step evaluates the same positions several times, alternately at its start and its end; those of a
    shell at rest are always the same. `make` computes the result for one or several arrays; `size`
    results are kept.
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


Normals = tuple[Array, Array, Array]
"""Unit normals of faces (m, 3) and vertices (n, 3), and flatness of the surface at vertices
(n,)."""


@dataclass(frozen=True, eq=False)
class Met:
    """Features that points meet, grouped by point."""

    point: Index  #: (k,) indices of the points
    face: Index  #: (k,) a triangle of the feature
    place: Index  #: (k,) number of the feature: triangle, edge or vertex
    wall: NDArray[np.bool_]  #: (k,) True for further walls of a groove
    weight: Array  #: (k, 3) barycentric weights of the closest point
    gap: Array  #: (k,) distance along the normal, negative inside [m]
    normal: Array  #: (k, 3) outward unit vectors


class SignedFaces:
    """Faces of a surface: closest faces, entered faces and signed distances.

    The sign follows from the normal of the nearest face, or from the sum of the normals of the nearest
    edge, or from the angle-weighted normals of the nearest vertex (Baerentzen and Aanaes 2005, Signed
    distance computation using the angle weighted pseudonormal). At a free edge of an open surface there
    is no sign. `across` (m, 3) are the faces beyond the edges of each, -1 at a free one.
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
        self.across = np.where(paired, match // 3, -1).reshape(-1, 3)
        self._edge = np.where(paired, np.minimum(own, match), own).reshape(-1, 3)
        self._free = np.zeros(size, dtype=bool)
        self._free[surface.open_edges] = True
        self._recent = Recent(self._normals_at)
        self._at_rest: Normals | None = None
        if not isinstance(surface, NodeSurface) and surface.motion is None:
            self._at_rest = self._normals_at(surface.vertices)

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
        other = self.across[one, side]
        mean = face[one] + np.where((other >= 0)[:, None], face[other], 0.0)
        size = np.linalg.norm(mean, axis=1, keepdims=True)
        out[edge] = mean / np.where(size > 0.0, size, 1.0)
        return out

    def _normals(self, x: Array) -> Normals:
        return self._recent(x) if self._at_rest is None else self._at_rest

    def _normals_at(self, x: Array) -> Normals:
        face, corner, flat = np.empty((len(self.triangles), 3)), np.empty_like(x), np.empty(len(x))
        normals(x, self.triangles, face, corner, flat)
        return face, corner, flat

    def places_of(self, found: Found, x: Array) -> tuple[Found, Index]:
        """Unique closest faces, edges and vertices of points, and their indices (k,).

        An edge has the same index for both its faces, and a vertex for all; weights are on the feature.
        """
        # the first of the faces that share a feature, closest or earliest, irrespective of their
        # numbering
        found = found.take(np.argsort(found.value, kind="stable"))
        place, weight = np.empty(len(found.point), dtype=np.int64), found.weight.copy()
        about = self.across, self._free, self._edge, place
        places(found.face, weight, found.feature, x, self.triangles, *about)
        key = found.point * (4 * len(self.triangles) + len(self._free)) + place
        _, first = np.unique(key, return_index=True)
        return replace(found, weight=weight).take(first), place[first]

    def met(
        self,
        points: Array,
        radius: Array,
        may: Array,
        x: Array,
        near: Candidates,
        away: Array,
        against: Array,
        blur: float,
        deepest: float,
    ) -> Met:
        """Features that points meet within a radius, from their depths outwards.

        They are the closest face, edge or vertex, or all equally close ones, with the mean normal of
        the faces that meet there. A point in a groove also meets the face adjacent to the closest one at
        a concave edge, if it is above both. A point inside, midway between faces with opposite normals,
        meets only the first.

        Parameters
        ----------
        points, radius, x, near, away
            As of `closest_faces`.
        may : (n,) depth that points may have, by which their radius is larger [m].
        against : outward normals of the points, which are included in the mean normals of edges and
            vertices, so that the forces between two edges are not diagonal.
        blur : distance from an edge or a vertex [m] below which the direction is the mean normal of its
            faces, because that of the distance changes over a length equal to the distance; the gap is
            then measured along it. Within it a further wall is met also by a point that is not above
            its face.
        deepest : gap below which a feature is not met [m].
        """
        by_face, by_corner, flat = self._normals(x)
        start, listed = near.along(points, points, x, x, radius)
        room = 4 * len(listed) + 1
        point, face, place = (np.empty(room, dtype=np.int64) for _ in range(3))
        wall, gap = np.empty(room, dtype=np.bool_), np.empty(room)
        weight, normal = np.empty((room, 3)), np.empty((room, 3))
        found = point, face, place, wall, weight, gap, normal
        about = points, radius, may, x, self.triangles, start, listed, away, SAME_DISTANCE
        signs = self.across, self._free, self._edge, by_face, by_corner, flat
        n = met(*about, *signs, blur, against, deepest, *found)
        return Met(point[:n], face[:n], place[:n], wall[:n], weight[:n], gap[:n], normal[:n])

    def signed(self, points: Array, found: Found, x: Array) -> tuple[Array, Array]:
        """Signed distances (k,), negative inside and NaN at a free edge [m], and their gradients (k, 3).

        Points (n, 3) and vertices x (m, 3) are in [m]; `found` is of `closest_faces`.
        """
        by_face, by_corner, flat = self._normals(x)
        k = len(found.point)
        gap, normal = np.empty(k), np.empty((k, 3))
        about = found.point, found.face, found.weight, found.value, found.feature, x, self.triangles
        signs = self.across, self._free, by_face, by_corner, flat
        signed(np.ascontiguousarray(points), *about, *signs, gap, normal)
        return gap, normal
