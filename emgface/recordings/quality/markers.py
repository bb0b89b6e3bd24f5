"""Measures of each marker, and detection of exchanged markers."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr

from emgface.signals.filters import sampling_rate

LAYOUT = {
    "forehead_left": (-1.0, 0.4, 3.4), "forehead_right": (1.0, 0.4, 3.4),
    "temple_left": (-2.3, -1.6, 2.0), "temple_right": (2.3, -1.6, 2.0),
    "nasion": (0.0, 0.5, 2.5), "rhinion": (0.0, 0.9, 1.8),
    "corner_left": (-1.0, 0.0, 0.0), "corner_right": (1.0, 0.0, 0.0),
    "upper_lateral_left": (-0.6, 0.35, 0.3), "upper_lateral_right": (0.6, 0.35, 0.3),
    "upper_paramedian_left": (-0.22, 0.5, 0.38), "upper_paramedian_right": (0.22, 0.5, 0.38),
    "lower_lateral_left": (-0.6, 0.3, -0.32), "lower_lateral_right": (0.6, 0.3, -0.32),
    "lower_paramedian_left": (-0.22, 0.42, -0.42), "lower_paramedian_right": (0.22, 0.42, -0.42),
}  # fmt: skip
"""Approximate positions in halves of the mouth width, in the axes of the face (x right)."""

#: least number of markers of the layout for the detection of exchanged names
LEAST_LAYOUT_MARKERS = 6
BETTER = 0.75
"""Misfit of exchanged names over that of the given ones, below which they are suspected."""
OPPOSITE = -0.7
"""Cosine between the vectors from one marker to another below which they are opposite."""
COINCIDENT_FRAMES = 2  #: frames with exactly the same position from which two markers coincide
NEAREST = 0.003  #: jump of a marker [m] above which an exchange within a trial is suspected


def marker_quality(position: xr.DataArray) -> pd.DataFrame:
    """Measure noise and largest speed of every marker (marker, axis, time_marker) [m].

    The table (index: marker) has the columns ``noise`` [m], root mean square of the noise of the
    three axes together, from the median of third differences (which vanish for a smooth motion),
    and ``largest_speed`` [m/s] between consecutive frames. Raises SignalError if the clock is not
    uniform.
    """
    rate = sampling_rate(position["time_marker"])
    rows: list[tuple[float, float]] = []
    for values in position.transpose("marker", "axis", "time_marker").values:
        third = np.diff(values, 3, axis=1)
        third = third[:, np.asarray(np.isfinite(third).all(axis=0))]
        # With coefficients 1 3 3 1, white noise of variance s^2 has third differences of 20 s^2.
        spread = np.median(np.abs(third), axis=1) / 0.6745 if third.size else np.full(3, np.nan)
        step = np.linalg.norm(np.diff(values, axis=1), axis=0) * rate
        fastest = float(np.nanmax(step)) if np.isfinite(step).any() else np.nan
        rows.append((float(np.sqrt(np.sum(spread**2) / 20.0)), fastest))
    index = [str(name) for name in position["marker"].values]
    return pd.DataFrame(rows, index=index, columns=["noise", "largest_speed"])


def swapped_markers(position: xr.DataArray) -> pd.DataFrame:
    """Find markers whose names were exchanged, within a trial or throughout.

    Within a trial, two markers exchange their positions from one frame to the next. Throughout, the
    mean positions fit the layout of the face clearly better with two names exchanged. The columns
    are ``first``, ``second`` (names), ``time`` [s] (of the exchange; NaN throughout) and ``ratio``
    (distance or misfit after over before an exchange; small is certain). A row of the names
    ``left`` and ``right`` means all of them, or mirrored axes.
    """
    values = position.transpose("marker", "axis", "time_marker").values
    names = [str(m) for m in position["marker"].values]
    rows = _within(values, names, position["time_marker"].values) + _throughout(values, names)
    return pd.DataFrame(rows, columns=["first", "second", "time", "ratio"])


def coinciding_markers(position: xr.DataArray) -> pd.DataFrame:
    """Find pairs of markers with exactly the same position, which two measured points never have.

    The columns are ``first``, ``second`` (names), ``frames`` (their number, at least
    `COINCIDENT_FRAMES`) and ``time`` [s] of the first.
    """
    values = position.transpose("marker", "axis", "time_marker").values
    names, time = [str(m) for m in position["marker"].values], position["time_marker"].values
    rows: list[tuple[str, str, int, float]] = []
    for i in range(len(names)):
        for j in range(i + 1, len(names)):
            equal = np.asarray((values[i] == values[j]).all(axis=0))
            same = np.flatnonzero(equal & values[i].any(axis=0))  # zeros are no position
            if same.size >= COINCIDENT_FRAMES:
                rows.append((names[i], names[j], int(same.size), float(time[same[0]])))
    return pd.DataFrame(rows, columns=["first", "second", "frames", "time"])


_Row = tuple[str, str, float, float]


def _within(values: np.ndarray, names: Sequence[str], time: np.ndarray) -> list[_Row]:
    before, after = values[:, :, :-1], values[:, :, 1:]
    stayed = np.asarray(np.linalg.norm(after - before, axis=1))
    rows: list[_Row] = []
    for i in range(len(names)):
        for j in range(i + 1, len(names)):
            crossed = np.linalg.norm(after[i] - before[j], axis=0)
            crossed = crossed + np.linalg.norm(after[j] - before[i], axis=0)
            given = np.asarray(stayed[i] + stayed[j])
            leap = np.asarray(np.minimum(stayed[i], stayed[j]) > NEAREST)
            for k in np.flatnonzero(leap & np.asarray(crossed < 0.5 * given)):
                ratio = float(crossed[k] / given[k])
                rows.append((names[i], names[j], float(time[k + 1]), ratio))
    return rows


def _throughout(values: np.ndarray, names: Sequence[str]) -> list[_Row]:
    seen = np.asarray(np.isfinite(values).any(axis=(1, 2)))
    known = [i for i, name in enumerate(names) if name in LAYOUT and seen[i]]
    if len(known) < LEAST_LAYOUT_MARKERS:
        return []
    # Frames with all markers, so that the motion of the head is common to all.
    whole = np.asarray(np.isfinite(values[known]).all(axis=(0, 1)))
    if not whole.any():
        return []
    frame = values[known][:, :, int(np.argmax(whole))]
    layout = np.array([LAYOUT[names[i]] for i in known])
    labels = [names[i] for i in known]
    rows: list[_Row] = []
    given = _misfit(frame, layout)
    mirrored = _misfit(frame, layout * [-1.0, 1.0, 1.0])
    if mirrored < BETTER * given:
        rows.append(("left", "right", float("nan"), mirrored / given))
        layout, given = layout * [-1.0, 1.0, 1.0], mirrored
    while given > 0:
        tried: list[tuple[float, int, int]] = []
        for i in range(len(labels)):
            for j in range(i + 1, len(labels)):
                order = np.arange(len(labels))
                order[[i, j]] = j, i
                left = _misfit(frame[order], layout)
                # Exchanged neighbours change the misfit little, but reverse the vector between them.
                if left < BETTER * given or (left < given and _reversed(frame, layout, i, j)):
                    tried.append((left, i, j))
        if not tried:
            break
        best, i, j = min(tried)
        rows.append((labels[i], labels[j], float("nan"), best / given))
        frame[[i, j]] = frame[[j, i]]
        given = best
    return rows


def _reversed(points: np.ndarray, layout: np.ndarray, i: int, j: int) -> bool:
    """Test if the vector from one marker to another is opposite to that of the layout."""
    others = [k for k in range(len(points)) if k not in (i, j)]
    turn = _turn(points[others], layout[others])
    given, expected = turn @ (points[i] - points[j]), layout[i] - layout[j]
    return bool(given @ expected < OPPOSITE * np.linalg.norm(given) * np.linalg.norm(expected))


def _turn(points: np.ndarray, layout: np.ndarray) -> np.ndarray:
    """Rotation that fits points to the layout in the least-squares sense."""
    a, b = points - points.mean(axis=0), layout - layout.mean(axis=0)
    u, _, vt = np.linalg.svd(b.T @ a)
    return u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt


def _misfit(points: np.ndarray, layout: np.ndarray) -> float:
    """Root mean square distance after the best translation, rotation and scaling."""
    a, b = points - points.mean(axis=0), layout - layout.mean(axis=0)
    u, s, vt = np.linalg.svd(a.T @ b)
    s[-1] *= np.sign(np.linalg.det(u @ vt))
    # The residual of the best scaled rotation of a is |b|^2 - (sum of singular values)^2 / |a|^2.
    left = np.sum(b**2) - s.sum() ** 2 / np.sum(a**2)
    return float(np.sqrt(max(left, 0.0) / len(points)))
