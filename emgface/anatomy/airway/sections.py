"""Area function of a surface along a centre line: plane sections of a triangle mesh."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.sparse.linalg import spsolve

from emgface.errors import DataError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Sections:
    """Plane sections of an airway, from the glottis to the lips.

    ``centre`` (n, 3) [m] and unit normals ``tangent`` (n, 3) of the planes, ``area`` (n,) of the
    closed curve around the centre line [m^2], 0 without such a curve, as in a closure, and
    ``length`` of the centre line [m].
    """

    centre: Floats
    tangent: Floats
    area: Floats
    length: float


def centre_line(
    position: Floats,
    triangle: Integers,
    start: Floats,
    *,
    end: Floats | None = None,
    levels: int = 40,
) -> Floats:
    """First estimate of a centre line [m]: means of rings of equal potential from a point `start`.

    The potential is harmonic over the surface between the rim at `start` and the one at the other end:
    in straight and in bent tubes, its rings lie across the tube. (Rings at equal distance from the start
    incline in a bend, because the inner wall is shorter, and end on one side of an open end.) The line
    has at most `levels` + 2 points, from the plane of `start` to that of `end`, such as the lips of
    a surface that continues over the face, or to the middle of the last ring. Parts that are not
    connected with the beginning are left out. Raises DataError if the surface is empty or not finite.
    """
    if len(triangle) == 0 or not np.isfinite(position).all():
        raise DataError("the surface of the airway is empty or not finite, expected triangles")
    a, b = np.concatenate([triangle[:, [0, 1]], triangle[:, [1, 2]], triangle[:, [2, 0]]]).T
    weight = np.maximum(np.linalg.norm(position[a] - position[b], axis=1), 1e-12)
    graph = coo_array((weight, (a, b)), shape=(len(position), len(position))).tocsr()
    used = np.isin(np.arange(len(position)), triangle)
    rims = _rims(triangle, len(position))
    first = _near(position, start, used, rims)
    distance = dijkstra(graph, directed=False, indices=np.flatnonzero(first), min_only=True)
    reached = np.isfinite(distance)
    if end is None:
        size, own = np.bincount(rims), np.where(reached & ~first, distance, 0.0)
        mean = np.bincount(rims, own) / size
        open_ends = np.where((size > 2) & (mean > 0.0), mean, -1.0)
        far = rims[np.argmax(own)] if open_ends.max() < 0.0 else int(np.argmax(open_ends))
        last = rims == far
    else:
        last = _near(position, end, reached, rims)
        last |= reached & (distance >= distance[last].max())
    potential = _potential(position, triangle, reached, first, last & ~first)
    inside = potential[reached & ~first & ~last]
    at = np.quantile(inside, (np.arange(levels) + 0.5) / levels) if len(inside) else inside
    values = np.unique(at[(at > 0.0) & (at < 1.0)])
    if len(values) < 2:
        raise DataError(
            "the surface has no rings between the points specified, expected a tube of several rings "
            "from the start to the end: check the points and their unit"
        )
    own = triangle[reached[triangle].all(axis=1)]
    rings = [_ring(position, own, potential, value) for value in values]
    # the line goes to the planes of the points specified
    after = position[last].mean(axis=0) if end is None else _ahead(np.array(rings[-2:]), end)
    return np.array([_ahead(np.array(rings[1::-1]), start), *rings, after])


def _ring(position: Floats, triangle: Integers, potential: Floats, value: float) -> Floats:
    """Centroid of the curve of a value of the potential on a surface [m]."""
    above = potential[triangle] > value
    cut = above.any(axis=1) & ~above.all(axis=1)
    points = list[Floats]()
    weight = list[NDArray[np.bool_]]()
    for k in range(3):
        a, b = triangle[cut][:, k], triangle[cut][:, (k + 1) % 3]
        crossed = above[cut][:, k] != above[cut][:, (k + 1) % 3]
        step = np.where(crossed, potential[b] - potential[a], 1.0)
        share = np.clip((value - potential[a]) / step, 0.0, 1.0)[:, None]
        points.append(position[a] + share * (position[b] - position[a]))
        weight.append(crossed)
    corners, on = np.stack(points, axis=1), np.stack(weight, axis=1)
    first, second = corners[on].reshape(-1, 2, 3).transpose(1, 0, 2)
    size = np.maximum(np.linalg.norm(second - first, axis=1), 1e-12)
    return np.average(0.5 * (first + second), axis=0, weights=size)


def _rims(triangle: Integers, count: int) -> Integers:
    """Number (count,) of the open rim of every vertex, a number of its own where it is on none."""
    sides = np.concatenate([triangle[:, [0, 1]], triangle[:, [1, 2]], triangle[:, [2, 0]]])
    edge, uses = np.unique(np.sort(sides, 1), axis=0, return_counts=True)
    graph = coo_array((np.ones((uses == 1).sum()), edge[uses == 1].T), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _near(
    position: Floats, point: Floats, among: NDArray[np.bool_], rims: Integers
) -> NDArray[np.bool_]:
    """Vertices of the open rim round a point; without one, those hardly farther than the nearest."""
    away = np.where(among, np.linalg.norm(position - point, axis=1), np.inf)
    near = away <= 1.5 * away.min() + 1e-12
    for rim in np.unique(rims[near]):
        own = rims == rim
        if own.sum() > 2 and np.linalg.norm(position[own].mean(axis=0) - point) < 1.5 * away.min():
            return own
    return near


def _potential(
    position: Floats,
    triangle: Integers,
    reached: NDArray[np.bool_],
    first: NDArray[np.bool_],
    last: NDArray[np.bool_],
) -> Floats:
    """Harmonic function of the vertices, 0 on `first` and 1 on `last` (cotangents; Pinkall 1993)."""
    n, x = len(position), position[triangle]
    weights, pairs = list[Floats](), list[Integers]()
    for k in range(3):
        p, q = x[:, (k + 1) % 3] - x[:, k], x[:, (k + 2) % 3] - x[:, k]
        area = np.linalg.norm(np.cross(p, q), axis=1)
        weights.append(np.einsum("ti,ti->t", p, q) / np.maximum(area, 1e-18))
        pairs.append(triangle[:, [(k + 1) % 3, (k + 2) % 3]])
    w, (a, b) = np.maximum(np.concatenate(weights), 1e-3), np.concatenate(pairs).T
    L = coo_array(
        (np.r_[w, w, -w, -w], (np.r_[a, b, a, b], np.r_[a, b, b, a])), shape=(n, n)
    ).tocsr()
    free = np.flatnonzero(reached & ~first & ~last)
    potential = last.astype(np.float64)
    potential[free] = spsolve(L[free][:, free].tocsc(), -(L[free] @ potential))
    return potential


def _ahead(pair: Floats, point: Floats) -> Floats:
    """End of the line through two points in the plane of a point across it, not before the second."""
    along = pair[1] - pair[0]
    along = along / np.linalg.norm(along)
    return pair[1] + max(float((point - pair[1]) @ along), 1e-9) * along


def sections(
    position: Floats, triangle: Integers, line: Floats, *, count: int = 40, rounds: int = 0
) -> Sections:
    """Areas of the plane sections of a surface normal to a centre line `line` (k, 3) [m].

    The surface [m] has one orientation, may be open and may consist of several parts. The `count`
    sections lie in the middle of equal parts of the line, which is moved `rounds` times to the
    centroids of its sections and smoothed. The area of an oriented closed curve is the sum of t.((a
    - c) x (b - c))/2 over its segments, without putting them in order. Of the curves in a plane,
    that round the centre counts, the smallest if there are several: limbs of a bent tube and outer
    walls are thus left out. Raises DataError if the line has no length, or no plane meets the
    surface.
    """
    edges = np.sort(
        np.concatenate([triangle[:, [0, 1]], triangle[:, [1, 2]], triangle[:, [2, 0]]]), 1
    )
    edge, index = np.unique(edges, axis=0, return_inverse=True)
    sides = index.reshape(3, -1).T  # edge of every side of every triangle
    line = _resampled(np.asarray(line, np.float64), count)
    tangent, cuts = _tangents(line), list[tuple[float, Floats]]()
    for done in range(rounds + 1):
        tangent = _tangents(line)
        cuts = [
            _section(position, triangle, edge, sides, c, t)
            for c, t in zip(line, tangent, strict=True)
        ]
        if done < rounds:
            moved = line.copy()
            for k in range(1, count - 1):
                if cuts[k][0] > 0.0:
                    moved[k] = cuts[k][1]
            moved[1:-1] = 0.25 * moved[:-2] + 0.5 * moved[1:-1] + 0.25 * moved[2:]
            line = _resampled(moved, count, inner=True)
    area = np.array([f[0] for f in cuts])
    if not (area > 0.0).any():
        raise DataError(
            "no plane across the centre line intersects the surface, expected a surface that "
            "encloses the centre line"
        )
    step = np.linalg.norm(np.diff(line, axis=0), axis=1)
    return Sections(line, tangent, area, float(step.sum() + 0.5 * (step[0] + step[-1])))


def _section(
    position: Floats, triangle: Integers, edge: Integers, sides: Integers, c: Floats, t: Floats
) -> tuple[float, Floats]:
    """Area of the curve round a centre, and the centroid of the nearest curve."""
    d = (position - c) @ t
    above = d >= 0.0
    cut = np.flatnonzero(above[triangle].any(axis=1) & ~above[triangle].all(axis=1))
    if len(cut) == 0:
        return 0.0, c
    crossed = above[edge[sides[cut], 0]] != above[edge[sides[cut], 1]]
    pair = sides[cut][crossed].reshape(-1, 2)
    name, local = np.unique(pair, return_inverse=True)
    local = local.reshape(-1, 2)
    p, q = edge[name].T
    share = d[p] / (d[p] - d[q])
    point = position[p] + share[:, None] * (position[q] - position[p]) - c
    corners = position[triangle[cut]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    a, b = point[local[:, 0]], point[local[:, 1]]
    forward = np.einsum("ij,ij->i", b - a, np.cross(t, normal)) >= 0.0
    a, b = np.where(forward[:, None], a, b), np.where(forward[:, None], b, a)
    graph = coo_array((np.ones(len(local)), local.T), shape=(len(name), len(name)))
    n, part = connected_components(graph, directed=False)
    part = part[local[:, 0]]
    twice = np.cross(a, b) @ t
    area = 0.5 * np.bincount(part, twice, n)
    angle = np.arctan2(twice, np.einsum("ij,ij->i", a, b))
    turns = np.abs(np.bincount(part, angle, n)) / (2.0 * np.pi)
    round_it = np.flatnonzero(turns > 0.5)
    middle = np.stack([np.bincount(part, (a + b)[:, k] * 0.5, n) for k in range(3)], axis=1)
    middle /= np.bincount(part, minlength=n)[:, None]
    chosen = (
        round_it[np.argmin(np.abs(area[round_it]))]
        if len(round_it)
        else np.argmin(np.linalg.norm(middle, axis=1))
    )
    if abs(area[chosen]) > 1e-9:
        edges = part == chosen
        middle[chosen] = ((a + b)[edges] * twice[edges, None]).sum(axis=0) / (6.0 * area[chosen])
    return float(abs(area[chosen])) if len(round_it) else 0.0, c + middle[chosen]


def _resampled(line: Floats, count: int, *, inner: bool = False) -> Floats:
    """Points in the middle of equal parts of a line; where `inner`, from first to last point."""
    s = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    if not (len(line) > 1 and np.isfinite(line).all() and s[-1] > 0.0):
        raise DataError(
            "the centre line has the length zero, expected at least two different points"
        )
    at = np.linspace(0.0, 1.0, count) if inner else (np.arange(count) + 0.5) / count
    return np.stack([np.interp(at * s[-1], s, column) for column in line.T], axis=1)


def _tangents(line: Floats) -> Floats:
    t = np.gradient(line, axis=0)
    return t / np.linalg.norm(t, axis=1, keepdims=True)
