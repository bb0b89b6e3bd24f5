"""Wanted positions of the lip markers of a face, from the recorded ones."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from analysis.noise import marker_noise
from emgface.errors import MarkerError, UnitsError
from emgface.face.measured import check_lips
from emgface.muscles import LIP_MARKERS
from emgface.recordings.head import LARGEST_RATIO, in_head_frame
from emgface.signals.parameters import HeadFrameParameters
from emgface.signals.resampling import resample
from sim.state import Array

REST_MEAN_DURATION = 0.1
"""Duration at the start of a recording whose mean is the position at rest [s]."""
UNKNOWN_NOISE = 1e-4
"""Noise of a coordinate that is assumed where the frames are too few to estimate it [m]."""


@dataclass(frozen=True)
class Wanted:
    """Positions of lip markers on a face during a recording.

    ``position`` (time, marker, axis) [m] is NaN while a marker is lost; ``scale`` is the ratio of
    the sizes of the two mouths [1], ``noise`` the standard deviation of a coordinate on the face
    [m], and ``at_rest`` the root mean square displacement of a coordinate within the first
    `REST_MEAN_DURATION` [m].
    """

    position: xr.DataArray
    scale: float
    noise: float
    at_rest: float


def wanted_positions(
    recording: xr.Dataset,
    rest: Array,
    face: xr.Dataset,
    head_frame: HeadFrameParameters,
    time: Array,
    start: float,
    left_out: tuple[str, ...] = (),
) -> Wanted:
    """Positions of the lip markers of a face (10, 3) at times of a recording.

    A marker is where it is at `rest` [m] (`LIP_MARKERS`) plus its displacement since rest in the
    head frame, times the ratio of the sizes of the two mouths, of all markers that are visible at
    rest. `time` is since `start`, a time of the recording [s]. Gaps up to ``head_frame.max_gap``
    are interpolated, others are NaN. Raises MarkerError or UnitsError as `in_head_frame`, and if a
    marker that is not in `left_out` is not visible at rest, those visible are fewer than two or
    mirrored, or the sizes of the mouths differ more than those of two heads.
    """
    if "position" not in recording:
        raise MarkerError(
            "the recording has no position of markers, expected lip markers and face markers: choose a "
            "recording with them"
        )
    given = recording["position"]
    names = [str(name) for name in given["marker"].values]
    absent = [name for name in left_out if name not in names]
    if absent:  # of no marker at all, `in_head_frame` tells that it is missing
        given = given.reindex(marker=[*names, *absent]).assign_attrs(given.attrs)
    head = in_head_frame(given, head_frame, face["face_marker_position"], lost="kept")
    lips = head.sel(marker=list(LIP_MARKERS))
    check_lips(lips)
    level = np.sqrt(np.nanmean(marker_noise(lips).values ** 2) / 3.0)
    position = _sampled(lips, start + time)
    resting = position.values[time <= REST_MEAN_DURATION]
    begin = np.full(resting.shape[1:], np.nan)
    visible = np.asarray(np.isfinite(resting).any(axis=(0, 2)))
    begin[visible] = np.nanmean(resting[:, visible], axis=0)
    for name, seen in zip(LIP_MARKERS, visible, strict=True):
        if not seen and name not in left_out:
            raise MarkerError(
                f"marker {name} is not visible in the first {REST_MEAN_DURATION:g} s, expected the "
                "mouth at rest: begin the trial earlier, or leave the marker out"
            )
    size = [_size(x[visible]) for x in (rest, begin)]
    if not min(size) > 0.0:
        raise MarkerError(
            f"{int(visible.sum())} lip markers are visible in the first {REST_MEAN_DURATION:g} s, "
            "expected at least two, because the size of the mouth is computed from their "
            "distances: begin the trial earlier"
        )
    scale = float(size[0] / size[1])
    if not 1.0 / LARGEST_RATIO <= scale <= LARGEST_RATIO:
        raise UnitsError(
            f"the mouth of the face is {scale:.3g} times that of the recording, expected at most a "
            f"factor of {LARGEST_RATIO:g}: check the unit of the lip markers"
        )
    moved = scale * (position.values - begin)
    return Wanted(
        position.copy(data=rest + moved),
        scale,
        scale * float(level if np.isfinite(level) else UNKNOWN_NOISE),
        float(np.sqrt(np.nanmean(moved[time <= REST_MEAN_DURATION] ** 2))),
    )


def marker_nodes(face: xr.Dataset) -> np.ndarray:
    """Nodes (10,) of the lip markers of a face."""
    return face["marker_node"].sel(marker=list(LIP_MARKERS)).values.astype(np.int64)


def _size(x: Array) -> float:
    return float(np.linalg.norm(x - x.mean(axis=0))) if len(x) else 0.0


def _sampled(lips: xr.DataArray, times: Array) -> xr.DataArray:
    """Positions (time, marker, axis) at times [s], NaN next to frames without the marker."""
    frames = lips["time_marker"].values
    values = lips.transpose("marker", "axis", "time_marker").values
    out = np.full((len(times), values.shape[0], 3), np.nan)
    inside = (times >= frames[0] - 1e-9) & (times <= frames[-1] + 1e-9)
    if inside.sum() < 2:
        raise MarkerError(
            f"markers are recorded from {frames[0]:.4g} to {frames[-1]:.4g} s, the activation is "
            f"required from {times[0]:.4g} to {times[-1]:.4g} s: expected overlapping times"
        )
    after = np.clip(np.searchsorted(frames, times - 1e-9), 1, len(frames) - 1)
    for m, one in enumerate(values):
        seen = np.isfinite(one).all(axis=0)
        if seen.sum() < 2:
            continue
        filled = np.array([np.interp(frames, frames[seen], x[seen]) for x in one])
        given = xr.DataArray(
            filled, dims=("axis", "time_marker"), coords={"time_marker": lips["time_marker"]}
        )
        out[inside, m] = resample(given, times[inside], dim="time_marker").transpose("time", "axis")
        exact = np.abs(frames[after] - times) < 1e-9
        known = seen[after] & (seen[after - 1] | exact)
        out[~known, m] = np.nan
    return xr.DataArray(
        out, dims=("time", "marker", "axis"),
        coords={"time": times, "marker": list(LIP_MARKERS), "axis": lips["axis"]},
        attrs={"units": "m"},
    )  # fmt: skip
