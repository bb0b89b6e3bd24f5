"""Names of markers proposed from their positions, by comparison with the layout of a face."""

from itertools import permutations, product
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr
from scipy.optimize import linear_sum_assignment

from emgface.recordings.quality.markers import LAYOUT

#: largest distance from the expected place, in halves of the mouth's width
LARGEST_PLACE_ERROR: Final = 0.35
HALF_MOUTH_WIDTHS: Final = (0.015, 0.045)  #: smallest and largest half of a mouth's width [m]
CLEARER: Final = 1.5
"""Misfit of the second best orientation over that of the best from which the best is proposed."""
LEAST_UNLABELLED_MARKERS: Final = 14  #: least number of markers if no label is known
_REFINEMENTS: Final = 8


def with_places(table: pd.DataFrame, position: xr.DataArray) -> pd.DataFrame:
    """Complete proposals for markers by their positions.

    `table` is the result of `emgface.recordings.proposal.propose_mapping` for the markers, in their
    order. With three or more known labels the layout is fitted to those markers; otherwise all
    orientations of the axes are tried, which form a right-handed frame. Each unresolved marker near
    a position of the layout that belongs to no other marker is proposed for it, with the certainty
    ``likely``.
    """
    values = position.transpose("marker", "axis", "time_marker").values
    seen = np.asarray(np.isfinite(values).all(axis=1))
    points = values[:, :, int(np.argmax(seen.sum(axis=0)))]
    visible = np.asarray(np.isfinite(points).all(axis=1))
    names = table["name"].astype(str).tolist()
    known = [k for k, name in enumerate(names) if name in LAYOUT and visible[k]]
    free = [k for k, name in enumerate(names) if not name and visible[k]]
    targets = [name for name in LAYOUT if name not in names]
    if not free or not targets:
        return table
    layout = np.array([LAYOUT[name] for name in targets])
    if len(known) >= 3:
        anchor = np.array([LAYOUT[names[k]] for k in known])
        if np.linalg.matrix_rank(anchor - anchor.mean(axis=0), tol=0.1) < 2:
            return table
        placed, half = _laid(points[known], anchor, points[free])
    else:
        oriented = (
            _oriented(points[free], layout) if len(free) >= LEAST_UNLABELLED_MARKERS else None
        )
        if oriented is None:
            return table
        placed, half = oriented
    if not HALF_MOUTH_WIDTHS[0] <= half <= HALF_MOUTH_WIDTHS[1]:
        return table
    distance = np.linalg.norm(placed[:, None] - layout[None], axis=2)
    result = table.copy()
    for i, j in zip(
        *linear_sum_assignment(np.minimum(distance, 10 * LARGEST_PLACE_ERROR)), strict=True
    ):
        if distance[i, j] < LARGEST_PLACE_ERROR:
            reason = (
                f"lies {1e3 * half * distance[i, j]:.0f} mm from where {targets[j]} is expected"
            )
            result.loc[result.index[free[i]], ["name", "certainty", "reason"]] = [
                targets[j], "likely", reason,
            ]  # fmt: skip
    return result


def _laid(points: np.ndarray, layout: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, float]:
    """Other points in the frame of the layout, and the length [m] of its unit (Umeyama 1991)."""
    centre, middle = points.mean(axis=0), layout.mean(axis=0)
    a, b = points - centre, layout - middle
    u, s, vt = np.linalg.svd(b.T @ a)
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    scale = float(np.trace(np.diag(s) @ sign) / np.sum(a**2))
    return scale * (others - centre) @ (u @ sign @ vt).T + middle, 1.0 / scale


def _oriented(points: np.ndarray, layout: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Points in the frame of the layout for the best orientation; None if none is clearly best."""
    placements: list[tuple[float, tuple[int, ...], np.ndarray, float]] = []
    for turn in _orientations():
        size = np.linalg.norm(layout - layout.mean(axis=0)) / np.linalg.norm(
            points - points.mean(axis=0)
        )
        placed = size * (points - points.mean(axis=0)) @ turn.T + layout.mean(axis=0)
        half, pairs = float(1.0 / size), ((), ())
        for _ in range(_REFINEMENTS):
            distance = np.linalg.norm(placed[:, None] - layout[None], axis=2)
            rows, columns = linear_sum_assignment(distance)
            if (again := (tuple(rows.tolist()), tuple(columns.tolist()))) == pairs:
                break
            pairs = again
            placed, half = _laid(points[rows], layout[columns], points)
        distance = np.linalg.norm(placed[:, None] - layout[None], axis=2)
        rows, columns = linear_sum_assignment(distance)
        misfit = float(np.sqrt(np.mean(distance[rows, columns] ** 2)))
        placements.append((misfit, (*rows.tolist(), *columns.tolist()), placed, half))
    placements.sort(key=lambda one: one[0])
    best = placements[0]
    others = [one[0] for one in placements if one[1] != best[1]]
    if best[0] > LARGEST_PLACE_ERROR or (others and min(others) < CLEARER * best[0]):
        return None
    return best[2], best[3]


def _orientations() -> list[np.ndarray]:
    """The 24 rotations that map axes to axes."""
    turns = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        turn = np.eye(3)[list(order)] * np.array(signs)[:, None]
        if np.linalg.det(turn) > 0:
            turns.append(turn)
    return turns
