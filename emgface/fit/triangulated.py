"""Triangulated surfaces: normals, samples, exact nearest points, open edges and their loops."""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

#: distance of the samples on triangles by which nearest triangles are found [m]
TRIANGLE_SPACING = 0.8e-3
POINTS_AT_ONCE = 20_000  #: number of points whose nearest points are found together, for the memory
CANDIDATES = 8  #: number of samples whose triangles are tested for the nearest point


@dataclass(frozen=True, eq=False)
class Surface:
    """Points (n, 3) [m] and outward triangles (m, 3)."""

    points: Floats
    triangles: Integers

    @cached_property
    def vector_areas(self) -> Floats:
        """Normals (m, 3) whose lengths are twice the areas [m2]."""
        a, b, c = (self.points[self.triangles[:, k]] for k in range(3))
        return np.cross(b - a, c - a)

    @cached_property
    def areas(self) -> Floats:
        """Areas (m,) [m2]."""
        return 0.5 * np.linalg.norm(self.vector_areas, axis=1)

    @cached_property
    def normals(self) -> Floats:
        """Unit normals of the triangles (m, 3)."""
        return _unit(self.vector_areas)

    @cached_property
    def point_normals(self) -> Floats:
        """Unit normals of the points (n, 3), means of those of their triangles by area."""
        return _unit(self._summed(self.vector_areas))

    @cached_property
    def point_areas(self) -> Floats:
        """A third of the area of the triangles of each point (n,) [m2]."""
        return self._summed(self.areas[:, None] / 3.0)[:, 0]

    def _summed(self, of_triangle: Floats) -> Floats:
        """Sums over the triangles of each point."""
        n, total = len(self.points), np.zeros((len(self.points), of_triangle.shape[1]))
        for corner in range(3):
            for k in range(of_triangle.shape[1]):
                own = self.triangles[:, corner]
                total[:, k] += np.bincount(own, of_triangle[:, k], minlength=n)
        return total

    @cached_property
    def open_edges(self) -> Integers:
        """Directed edges (k, 2) of one triangle only."""
        edges, _ = self._edges
        return edges[self._alone]

    @cached_property
    def _edges(self) -> tuple[Integers, Integers]:
        t = self.triangles
        edges = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
        return edges, np.tile(np.arange(len(t)), 3)

    @cached_property
    def _alone(self) -> NDArray[np.bool_]:
        edges, _ = self._edges
        low, high = edges.min(axis=1), edges.max(axis=1)
        _, inverse, counts = np.unique(
            low * len(self.points) + high, return_inverse=True, return_counts=True
        )
        return counts[inverse] == 1

    @cached_property
    def at_open_edge(self) -> NDArray[np.bool_]:
        """Triangles with an edge of their own (m,)."""
        mask = np.zeros(len(self.triangles), dtype=bool)
        mask[self._edges[1][self._alone]] = True
        return mask

    @cached_property
    def loops(self) -> tuple[Integers, ...]:
        """Closed loops of open edges, the longest list of points first."""
        following: dict[int, list[int]] = {}
        for a, b in self.open_edges.tolist():
            following.setdefault(a, []).append(b)
        closed: list[Integers] = []
        while following:
            start = next(iter(following))
            loop, here = [start], _next(following, start)
            while here != start and here in following:
                loop.append(here)
                here = _next(following, here)
            if here == start and len(loop) > 2:
                closed.append(np.array(loop, dtype=np.int64))
        return tuple(sorted(closed, key=len, reverse=True))

    @cached_property
    def samples(self) -> tuple[Floats, Integers, Floats]:
        """Points on the triangles, their triangles and the area of each [m2].

        Every triangle has a share of its area of a low-discrepancy sequence (R2 of Roberts), in the
        barycentric square folded on the triangle; the result is the same in every run.
        """
        count = np.maximum(2, np.ceil(self.areas / TRIANGLE_SPACING**2)).astype(np.int64)
        owner = np.repeat(np.arange(len(count)), count)
        k = np.arange(1, len(owner) + 1)[:, None]
        u = (0.5 + k * np.array([0.7548776662466927, 0.5698402909980532])) % 1.0
        outside = u.sum(axis=1) > 1.0
        u[outside] = 1.0 - u[outside]
        a, b, c = (self.points[self.triangles[owner, i]] for i in range(3))
        return a + u[:, :1] * (b - a) + u[:, 1:] * (c - a), owner, (self.areas / count)[owner]

    @cached_property
    def tree(self) -> KDTree:
        """Search tree of the samples."""
        return KDTree(self.samples[0])

    def nearest(
        self, points: Floats, normals: Floats | None = None, cosine: float = 0.3, wide: int = 30
    ) -> "Nearest":
        """Nearest points of the surface, on triangles whose normals agree with `normals` if given.

        Triangles of the nearest samples are tested exactly. A point is `found` only if one of the
        `wide` nearest samples has a normal within the `cosine` of its own.
        """
        parts = [
            self._nearest(
                points[k : k + POINTS_AT_ONCE],
                None if normals is None else normals[k : k + POINTS_AT_ONCE],
                cosine,
                wide,
            )
            for k in range(0, max(1, len(points)), POINTS_AT_ONCE)
        ]
        return Nearest(
            *(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Nearest))
        )

    def _nearest(
        self, points: Floats, normals: Floats | None, cosine: float, wide: int
    ) -> "Nearest":
        _, owner, _ = self.samples
        k = CANDIDATES if normals is None else wide
        _, index = self.tree.query(points, k=min(k, len(owner)))
        candidates = owner[np.asarray(index).reshape(len(points), -1)]
        agreeing = np.ones(len(points), dtype=bool)
        if normals is not None:
            agree = np.einsum("pki,pi->pk", self.normals[candidates], normals) > cosine
            agreeing = agree.any(axis=1)
            # the first agreeing candidates replace the others
            order = np.argsort(~agree, axis=1, kind="stable")[:, :CANDIDATES]
            candidates = np.take_along_axis(candidates, order, axis=1)
            agree = np.take_along_axis(agree, order, axis=1)
            candidates = np.where(agree, candidates, candidates[:, :1])
        rows = np.repeat(np.arange(len(points)), candidates.shape[1])
        corners = self.points[self.triangles[candidates.ravel()]]
        weights = barycentric_nearest(points[rows], corners)
        foot = np.einsum("ri,rij->rj", weights, corners)
        distance = np.linalg.norm(foot - points[rows], axis=1).reshape(candidates.shape)
        best = distance.argmin(axis=1)
        at = np.arange(len(points)) * candidates.shape[1] + best
        triangle = candidates.ravel()[at]
        return Nearest(foot[at], distance.ravel()[at], triangle, weights[at], agreeing)

    def at_border(self, nearest: "Nearest") -> NDArray[np.bool_]:
        """Test which nearest points lie on an open edge of the surface."""
        t = self.triangles[nearest.triangle]
        n = len(self.points)
        low, high = self.open_edges.min(axis=1), self.open_edges.max(axis=1)
        alone = np.unique(low * n + high)
        result = np.zeros(len(t), dtype=bool)
        for i, j in ((0, 1), (1, 2), (2, 0)):
            opposite = 3 - i - j
            key = t[:, [i, j]].min(axis=1) * n + t[:, [i, j]].max(axis=1)
            result |= (nearest.weights[:, opposite] < 1e-9) & np.isin(key, alone)
        return result


@dataclass(frozen=True)
class Nearest:
    """Nearest points of a surface to n points."""

    foot: Floats  #: (n, 3) [m]
    distance: Floats  #: (n,) [m]
    triangle: Integers  #: (n,)
    weights: Floats  #: (n, 3) barycentric coordinates [1]
    agrees: NDArray[np.bool_]  #: (n,) False if no triangle near has an agreeing normal


def barycentric_nearest(points: Floats, corners: Floats) -> Floats:
    """Barycentric coordinates (n, 3) of the point of each triangle (n, 3, 3) nearest to its point.

    The foot of the perpendicular, or the nearest point of the three edges if it lies outside.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac, ap = b - a, c - a, points - a
    d11, d12, d22 = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
    p1, p2 = _dot(ap, ab), _dot(ap, ac)
    area2 = d11 * d22 - d12 * d12
    flat = area2 <= 1e-24
    safe = np.where(flat, 1.0, area2)
    v, w = (d22 * p1 - d12 * p2) / safe, (d11 * p2 - d12 * p1) / safe
    result = np.stack([1.0 - v - w, v, w], axis=1)
    outside = flat | (result < 0.0).any(axis=1)
    if not outside.any():
        return result
    own, q = corners[outside], points[outside]
    best, least = np.zeros((len(q), 3)), np.full(len(q), np.inf)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        edge = own[:, j] - own[:, i]
        length2 = _dot(edge, edge)
        t = np.clip(_dot(q - own[:, i], edge) / np.where(length2 > 0, length2, 1.0), 0.0, 1.0)
        miss = own[:, i] + t[:, None] * edge - q
        nearer = (d := _dot(miss, miss)) < least
        row = np.zeros((len(q), 3))
        row[:, i], row[:, j] = 1.0 - t, t
        best[nearer], least[nearer] = row[nearer], d[nearer]
    result[outside] = best
    return result


def _dot(a: Floats, b: Floats) -> Floats:
    return np.einsum("ij,ij->i", a, b)


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def _next(following: dict[int, list[int]], here: int) -> int:
    """Take an edge that leaves a point."""
    ends = following[here]
    end = ends.pop()
    if not ends:
        del following[here]
    return end
