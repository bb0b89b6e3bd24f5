"""Correspondence of curves to curves: pairs of open loops, and points along a loop in order."""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from emgface.fit.triangulated import Floats, Integers, Surface

FINENESS = 4  #: number of points on the target per point of the loop
TARGET_SPACING = 1.5e-3  #: largest distance of the points on the target [m]
TANGENT = 3.0e-2  #: weight of differences of direction, relative to the spacing of the points [m]
EVEN = 3.0  #: weight of differences of the distances along both loops [1]
STARTS = 3  #: number of pairs of points tried as beginning
LONGEST_JUMP = 8  #: largest advance along the target per point, relative to the mean [1]
LARGEST_CENTRE_DISTANCE, LARGEST_LENGTH_RATIO = 0.03, 1.6
"""Distance of the centres [m] and ratio of the lengths beyond which loops do not correspond."""


@dataclass(frozen=True)
class LoopPair:
    """A loop of the mesh and its counterpart on the target."""

    mine: Integers  #: (k,) nodes of the mesh
    target: Floats  #: (n, 3) points of the closed polygon [m]


def pair_loops(mine: tuple[Integers, ...], position: Floats, target: Surface) -> list[LoopPair]:
    """Pair loops by centre and length; loops without a similar counterpart have no pair.

    Holes of a scan thus remain holes, and a scan that covers the mouth has no contour of the lips.
    """
    cost = np.full((len(mine), len(target.loops)), np.inf)
    for i, loop in enumerate(mine):
        p = position[loop]
        for j, other in enumerate(target.loops):
            q = target.points[other]
            apart = float(np.linalg.norm(p.mean(axis=0) - q.mean(axis=0)))
            ratio = length(p) / length(q)
            if (
                apart < LARGEST_CENTRE_DISTANCE
                and 1.0 / LARGEST_LENGTH_RATIO < ratio < LARGEST_LENGTH_RATIO
            ):
                cost[i, j] = apart + 0.2 * abs(length(p) - length(q))
    pairs: list[LoopPair] = []
    while np.isfinite(cost).any():
        i, j = np.unravel_index(int(np.argmin(cost)), cost.shape)
        pairs.append(LoopPair(mine[i], target.points[target.loops[j]]))
        cost[i, :], cost[:, j] = np.inf, np.inf
    return pairs


def length(polygon: Floats) -> float:
    """Length of a closed polygon [m]."""
    return float(np.linalg.norm(np.roll(polygon, -1, axis=0) - polygon, axis=1).sum())


def along(points: Floats, polygon: Floats) -> tuple[Floats, Floats]:
    """Points of a closed polygon for the points (k, 3) of another, in order, and tangents there.

    Cyclic dynamic time warping: the sum of squared distances, of differences of the tangents and of
    the unevenness of the distances along both loops is least among all monotone correspondences, in
    either direction of the polygon.
    """
    n = max(150, FINENESS * len(points), int(length(polygon) / TARGET_SPACING))
    spacing = length(points) / len(points)
    tangent = _tangents(points)
    best: tuple[float, Floats, Floats] | None = None
    for way in (polygon, polygon[::-1]):
        fine = _resampled(way, n)
        other = _tangents(fine)
        apart = ((points[:, None] - fine[None]) ** 2).sum(axis=2)
        turned = ((tangent[:, None] - other[None]) ** 2).sum(axis=2)
        cost = apart + TANGENT * spacing * turned
        if best is None or cost.min(axis=1).sum() < best[0]:
            best = float(cost.min(axis=1).sum()), fine, cost
    assert best is not None
    _, fine, cost = best
    indices = _in_order(points, fine, cost)
    return _between(points, fine, indices), _tangents(fine)[indices]


def _between(points: Floats, fine: Floats, at: Integers) -> Floats:
    """Nearest points on the two segments that meet at the found points."""
    best, least = fine[at], ((fine[at] - points) ** 2).sum(axis=1)
    for other in (-1, 1):
        edge = fine[(at + other) % len(fine)] - fine[at]
        size = np.maximum((edge**2).sum(axis=1), 1e-30)
        t = np.clip(((points - fine[at]) * edge).sum(axis=1) / size, 0.0, 1.0)
        foot = fine[at] + t[:, None] * edge
        apart = ((foot - points) ** 2).sum(axis=1)
        best = np.where((apart < least)[:, None], foot, best)
        least = np.minimum(least, apart)
    return best


def _in_order(points: Floats, fine: Floats, cost: Floats) -> Integers:
    """Indices into the fine polygon, from the best of some beginnings."""
    best, chosen = np.inf, np.zeros(len(points), dtype=np.int64)
    step = length(fine) / len(fine)
    stretch = length(fine) / length(points)
    for first in np.argsort(cost.min(axis=1))[:STARTS]:
        at = int(cost[first].argmin())
        rolled = np.roll(np.roll(cost, -first, axis=0), -at, axis=1)
        rolled = np.pad(rolled, ((0, 1), (0, 1)), mode="wrap")
        closed = np.roll(points, -first, axis=0)
        gaps = np.linalg.norm(np.roll(closed, -1, axis=0) - closed, axis=1)
        total, path = _warp(rolled, step, stretch * gaps)
        if total < best:
            best = total
            chosen = np.roll((path[:-1] + at) % len(fine), first)
    return chosen


def _warp(cost: Floats, step: float, gaps: Floats) -> tuple[float, Integers]:
    """Monotone path of least cost from the first to the last corner, at most `reach` columns a row."""
    rows, columns = cost.shape
    reach = min(columns, LONGEST_JUMP * int(np.ceil(columns / max(rows - 1, 1))))
    jumps = np.arange(reach)
    table = np.full((rows, columns), np.inf)
    choice = np.zeros((rows, columns), dtype=np.int64)
    table[0, 0] = cost[0, 0]
    for i in range(1, rows):
        before = np.concatenate([np.full(reach - 1, np.inf), table[i - 1]])
        window = sliding_window_view(before, reach)[:, ::-1]  # column j: predecessors j - jump
        total = window + EVEN * (jumps * step - gaps[i - 1]) ** 2
        choice[i] = total.argmin(axis=1)
        table[i] = total[np.arange(columns), choice[i]] + cost[i]
    path = np.empty(rows, dtype=np.int64)
    path[-1] = columns - 1
    for i in range(rows - 1, 0, -1):
        path[i - 1] = path[i] - choice[i, path[i]]
    return float(table[-1, -1]), path


def _resampled(polygon: Floats, n: int) -> Floats:
    closed = np.vstack([polygon, polygon[:1]])
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    s = np.linspace(0.0, at[-1], n, endpoint=False)
    return np.column_stack([np.interp(s, at, closed[:, k]) for k in range(3)])


def _tangents(polygon: Floats) -> Floats:
    t = np.roll(polygon, -1, axis=0) - np.roll(polygon, 1, axis=0)
    size = np.linalg.norm(t, axis=1, keepdims=True)
    return t / np.where(size > 0, size, 1.0)
