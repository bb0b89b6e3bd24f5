"""Smooth surfaces through the nodes of a coarse one.

The interpolating four-point scheme (Dyn, Levin and Gregory 1987) is applied along both directions
of quadrilaterals, with the extension of Kobbelt (1996): the surface is smooth and passes through
the nodes. Each new point is a fixed combination of four earlier ones, so that a motion requires
only the positions of the nodes.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


def follow(rules: Indices, values: Floats) -> Floats:
    """Values at all points of the tissue, from those at its nodes (n, k), by rules (m, 4)."""
    n = len(values)
    points = np.concatenate([values, np.empty((len(rules), values.shape[1]))])
    done = 0
    while done < len(rules):
        # All points whose rules refer to computed points are evaluated together.
        ready = rules[done:].max(axis=1) >= n + done
        until = done + int(np.argmax(ready)) if ready.any() else len(rules)
        a, b, c, d = (points[rules[done:until, k]] for k in range(4))
        points[n + done : n + until] = (9.0 * (b + c) - (a + d)) / 16.0
        done = until
    return points


def refined(facet: Indices, part: Indices, n: int) -> tuple[list[Indices], Indices, Indices]:
    """Divide every facet into four, with new points on its edges and in its centre.

    `facet` (m, 4) are corners among n points, where a triangle repeats its last; `part` is passed
    on to the four. Returns the rules of the points on the edges, then of those in quadrilaterals
    (`emgface.pictures.body.Body`), and the new facets and parts.

    Beyond a vertex the line of an edge continues along the opposite edge if four edges meet within
    the surface or three on its border; elsewhere it ends, and the end point is repeated.
    """
    after = np.roll(facet, -1, axis=1)
    before = np.roll(facet, 1, axis=1)
    before[:, 3] = np.where(facet[:, 3] == facet[:, 2], facet[:, 1], facet[:, 2])
    side = facet != after
    tail, head, last = facet[side], after[side], before[side]
    both = np.unique(np.concatenate([tail * n + head, head * n + tail]))
    start, end = both // n, both % n

    def place(a: Indices, b: Indices) -> Indices:
        return np.searchsorted(both, a * n + b)

    # From one edge at a vertex to the next, across a facet.
    turn = np.full(len(both), -1)
    turn[place(tail, head)] = place(tail, last)
    back = np.full(len(both), -1)
    back[turn[turn >= 0]] = np.flatnonzero(turn >= 0)
    degree = np.bincount(start, minlength=n)
    border = np.zeros(n, dtype=bool)
    border[start[turn < 0]] = True
    regular = degree[start] == np.where(border[start], 3, 4)

    def twice(step: Indices) -> Indices:
        once = np.where(step >= 0, step[step], -1)
        return np.where(regular, once, -1)

    opposite = np.maximum(twice(turn), twice(back))
    beyond = np.where(opposite >= 0, end[opposite], start)

    one = np.flatnonzero(start < end)
    edge = np.empty(len(both), dtype=np.int64)
    other = place(end, start)
    edge[one] = n + np.arange(len(one))
    edge[other[one]] = edge[one]
    on_edges = np.stack([beyond[one], start[one], end[one], beyond[other[one]]], axis=1)

    quad = facet[:, 2] != facet[:, 3]
    corners, few = facet[quad], facet[~quad]
    around = [place(corners[:, k], corners[:, (k + 1) % 4]) for k in range(4)]
    across = np.full(len(both), -1)
    for k in range(4):
        across[around[k]] = edge[around[(k + 2) % 4]]
    lines = []
    for k in (0, 1):
        a, b = around[k], around[k + 2]
        far = [across[other[a]], across[other[b]]]
        ends = [np.where(f >= 0, f, edge[e]) for f, e in zip(far, (a, b), strict=True)]
        whole = (far[0] >= 0) & (far[1] >= 0)
        lines.append((whole, np.stack([ends[0], edge[a], edge[b], ends[1]], axis=1)))
    inside = np.where((lines[0][0] | ~lines[1][0])[:, None], lines[0][1], lines[1][1])
    middle = n + len(one) + np.arange(len(corners))
    mid = [edge[each] for each in around]
    new = [np.stack([corners[:, k], mid[k], middle, mid[k - 1]], axis=1) for k in range(4)]
    parts = [part[quad]] * 4
    ab, bc, ca = (edge[place(few[:, k], few[:, (k + 1) % 3])] for k in range(3))
    for a, b, c in ((few[:, 0], ab, ca), (ab, few[:, 1], bc), (ca, bc, few[:, 2]), (ab, bc, ca)):
        new.append(np.stack([a, b, c, c], axis=1))
        parts.append(part[~quad])
    return [on_edges, inside], np.concatenate(new), np.concatenate(parts)


def rim(facet: Indices, position: Floats) -> Indices:
    """Points along the longest border of a surface, oriented as its facets; none if closed."""
    a, b = facet.ravel(), np.roll(facet, -1, axis=1).ravel()
    a, b = a[a != b], b[a != b]
    n = len(position)
    open_ = ~np.isin(a * n + b, b * n + a)
    following = dict(zip(a[open_].tolist(), b[open_].tolist(), strict=True))
    best: list[int] = []
    size = 0.0
    while following:
        loop = [next(iter(following))]
        while (after := following.pop(loop[-1], None)) is not None and after != loop[0]:
            loop.append(after)
        extent = float(np.ptp(position[loop], axis=0).max())
        if extent > size:
            best, size = loop, extent
    if not best:
        return np.empty(0, dtype=np.int64)
    return np.roll(best, -int(np.argmax(position[best, 2])))


def strip(n: int) -> Indices:
    """Triangles that fill a closed line of n points, with the opposite orientation."""
    triangles, low, high = [], 0, n
    while high - low > 2:
        triangles.append((low + 1, low, high % n))
        low += 1
        if high - low > 2:
            triangles.append((low, high % n, high - 1))
            high -= 1
    return np.array(triangles, dtype=np.int64)
