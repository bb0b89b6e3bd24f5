"""Detection of an exchange of left and right between electrodes and markers."""

import numpy as np
import pandas as pd
import xarray as xr
from scipy.ndimage import uniform_filter1d

from emgface.muscles import FACE_MARKERS
from emgface.recordings.quality.emg import can_be_judged, in_muscle_band
from emgface.signals.filters import TIME_EMG, sampling_rate

SIDE_COLUMNS = ("left", "right", "correlation", "swapped")
PULLING = ("ZYG", "RIS", "LLSAN", "DAO")  #: muscles that move the mouth corner of their own side
CORNERS = ("corner_left", "corner_right")
DECISIVE = 0.5  #: absolute correlation above which its sign is used
LEAST_APART = 1e-3
"""Difference between the displacements of the corners [m] above which a movement is lateral."""
SHARE_APART = 0.3  #: the same, as a fraction of the displacement
LEAST_VISIBLE = 0.5  #: fraction of the frames in which the corners must be visible
ENVELOPE_WINDOW = 0.2  #: window of the envelope and of the motion [s]


def swapped_sides(recording: xr.Dataset) -> pd.DataFrame:
    """Compare the difference between the sides in EMG with that in the motion of the corners.

    A muscle of one side moves the mouth corner of that side more than the other. If both sides move
    equally, the difference is noise; only movements to one side are used. The recording contains
    EMG [V] and markers [m] on one clock. Columns are ``left``, ``right`` (channels),
    ``correlation`` (of the two differences over time) and ``swapped`` (True below -0.5). Frames in
    which a corner or all skull markers are lost, or without EMG, are left out. There are no rows if half
    of them are, if the corners or both sides of a muscle are missing, or if the EMG has gaps.
    Raises SignalError if a clock is not uniform.
    """
    empty = pd.DataFrame([], columns=list(SIDE_COLUMNS))
    if "emg" not in recording or "position" not in recording:
        return empty
    position = recording["position"]
    if not set(CORNERS) <= {str(m) for m in position["marker"].values}:
        return empty
    ways = _ways(position)
    if ways is None:
        return empty
    frames, way = ways
    emg = recording["emg"]
    rate = sampling_rate(emg[TIME_EMG])
    # Outside of its time the EMG is unknown; a held value would be compared with the motion.
    recorded = (frames >= float(emg[TIME_EMG][0])) & (frames <= float(emg[TIME_EMG][-1]))
    if recorded.sum() < max(2, LEAST_VISIBLE * position.sizes["time_marker"]):
        return empty
    frames, way = frames[recorded], way[:, recorded]
    if not _one_sided(way):
        return empty
    channels = {str(c) for c in emg["channel"].values}
    rows: list[tuple[str, str, float, bool]] = []
    for muscle in PULLING:
        pair = [f"{muscle}_L", f"{muscle}_R"]
        if not set(pair) <= channels:
            continue
        values = emg.sel(channel=pair).transpose("channel", TIME_EMG).values
        if not all(can_be_judged(row, rate) for row in values):
            continue
        size = round(ENVELOPE_WINDOW * rate)
        strength = uniform_filter1d(np.abs(in_muscle_band(values, rate)), size, axis=1)
        scale = strength.mean(axis=1)
        if not (scale > 0).all():
            continue
        sampled = [
            np.interp(frames, emg[TIME_EMG].values, row) for row in strength / scale[:, None]
        ]
        difference = sampled[0] - sampled[1]
        r = float(np.corrcoef(difference, way[0] - way[1])[0, 1])
        rows.append((pair[0], pair[1], r, r < -DECISIVE))
    return pd.DataFrame(rows, columns=list(SIDE_COLUMNS))


def _ways(position: xr.DataArray) -> tuple[np.ndarray, np.ndarray] | None:
    """Frames [s], and distance of each corner from its rest position in them, relative to the skull."""
    steady = [m for m in position["marker"].values if str(m) in FACE_MARKERS]
    corners = position.sel(marker=list(CORNERS)).transpose("marker", "axis", "time_marker").values
    if len(steady) >= 3:
        skull = position.sel(marker=steady).transpose("marker", "axis", "time_marker").values
        skull = skull[np.isfinite(skull).any(axis=(1, 2))]
        # A marker that is lost must not move the mean of the others.
        moved = skull - np.nanmedian(skull, axis=2, keepdims=True)
        seen = np.isfinite(moved)
        # The mean follows the translation of the head; small rotations move both corners equally.
        with np.errstate(invalid="ignore"):
            corners = corners - np.where(seen, moved, 0.0).sum(axis=0) / seen.sum(axis=0)
    kept = np.isfinite(corners).all(axis=(0, 1))
    if kept.sum() < max(2, LEAST_VISIBLE * kept.size):
        return None
    corners = corners[..., kept]
    size = max(1, round(ENVELOPE_WINDOW * sampling_rate(position["time_marker"])))
    way = np.linalg.norm(corners - np.median(corners, axis=2, keepdims=True), axis=1)
    smooth = uniform_filter1d(way, size, axis=1)
    return position["time_marker"].values[kept], smooth


def _one_sided(way: np.ndarray) -> bool:
    """True for a movement to one side; the sides of symmetric ones do not identify the electrodes."""
    apart = float(np.ptp(way[0] - way[1]))
    return apart > max(LEAST_APART, SHARE_APART * float(np.max(way)))
