"""Marker tracks in the camera frame: lip motion, head motion, measurement noise."""

import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

from emgface.errors import MarkerError
from emgface.muscles import AXES, FACE_MARKERS, LIP_MARKERS

FRAME_RATE = 100.0  #: frames per second of the camera set-up (Eskes et al. 2017, Methods)


def head_motion(
    time: np.ndarray, rotation: float, shift: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Slow rotation and translation of the head, each axis a sum of two sinusoids below 0.6 Hz.

    `rotation` [rad] and `shift` [m] are the amplitudes of each axis. Returns rotation matrices
    (n_times, 3, 3) and translations (n_times, 3) [m] at the times [s].
    """
    frequency = rng.uniform(0.1, 0.6, size=(2, 2, 3))
    phase = rng.uniform(0.0, 2.0 * np.pi, size=(2, 2, 3))
    wave = np.sin(2.0 * np.pi * frequency * time[:, None, None, None] + phase).mean(axis=2)
    return Rotation.from_rotvec(rotation * wave[:, 0]).as_matrix(), shift * wave[:, 1]


def record_markers(
    lip_position: xr.DataArray,
    face_position: xr.DataArray,
    *,
    noise: float,
    rotation: float,
    shift: float,
    rng: np.random.Generator,
    frame_rate: float = FRAME_RATE,
) -> xr.DataArray:
    """Tracks (marker, axis, time_marker) [m] of all sixteen markers in the frame of the cameras.

    The head rotates about the mean of its six markers; its motion acts equally on lip and face
    markers. `lip_position` (marker, axis, time) [m] is given in the frame of the face model,
    `face_position` (face_marker, axis) [m] moves with the skull. `noise` is the standard deviation
    of each coordinate [m]; `rotation` [rad] and `shift` [m] are the amplitudes of `head_motion`.
    Raises MarkerError if a marker is absent.
    """
    missing = [m for m in LIP_MARKERS if m not in lip_position["marker"].values]
    missing += [m for m in FACE_MARKERS if m not in face_position["face_marker"].values]
    if missing:
        raise MarkerError(
            f"markers {', '.join(missing)} are missing, expected the ten lip and six face markers"
        )
    start, end = (float(lip_position["time"][i]) for i in (0, -1))
    time = np.arange(int(np.floor((end - start) * frame_rate + 1e-6)) + 1) / frame_rate
    lips = lip_position.sel(marker=list(LIP_MARKERS), axis=list(AXES))
    lips = lips.interp(time=start + time).transpose("time", "marker", "axis").values
    face = face_position.sel(face_marker=list(FACE_MARKERS), axis=list(AXES))
    face = face.transpose("face_marker", "axis").values
    all_markers = np.concatenate([np.broadcast_to(face, (time.size, *face.shape)), lips], axis=1)
    centre = face.mean(axis=0)
    R, t = head_motion(time, rotation, shift, rng)
    seen = np.einsum("tij,tmj->tmi", R, all_markers - centre) + centre + t[:, None, :]
    seen = seen + noise * rng.standard_normal(seen.shape)
    return xr.DataArray(
        seen.transpose(1, 2, 0),
        coords={
            "marker": [*FACE_MARKERS, *LIP_MARKERS],
            "axis": list(AXES),
            "time_marker": ("time_marker", time, {"units": "s"}),
        },
        dims=("marker", "axis", "time_marker"),
        attrs={"units": "m", "long_name": "marker position in the camera frame, simulated"},
    )
