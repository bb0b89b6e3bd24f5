"""Marker tracks of three calibrated cameras."""

import numpy as np
import xarray as xr

from emgface.volunteers.cameras import Camera, triangulate

FOCAL = 2000.0  #: focal length [pixel]
IMAGE = (1280.0, 1024.0)  #: width and height of an image [pixel]
DISTANCE = 0.9  #: distance of the cameras from the mouth [m]
CAMERA_ANGLES = (-35.0, 0.0, 35.0)
"""Angles of the cameras from straight ahead, seen from above [degree]."""
RAISED = (0.12, -0.10, 0.12)  #: heights of the cameras above the mouth [m]
SHORTEST_LOSS, LONGEST_LOSS = 0.02, 0.08  #: range of the duration of a marker loss [s]


def three_cameras(mouth: np.ndarray) -> list[Camera]:
    """Return three cameras in front of a face, directed at the mouth [m]; y is anterior, z up."""
    cameras: list[Camera] = []
    for angle, height in zip(np.deg2rad(CAMERA_ANGLES), RAISED, strict=True):
        place = mouth + DISTANCE * np.array([np.sin(angle), np.cos(angle), 0.0])
        place = place + np.array([0.0, 0.0, height])
        ahead = (mouth - place) / np.linalg.norm(mouth - place)
        side = np.cross(ahead, [0.0, 0.0, 1.0])
        side /= np.linalg.norm(side)
        rotation = np.stack([side, np.cross(ahead, side), ahead])
        intrinsics = np.array(
            [[FOCAL, 0.0, IMAGE[0] / 2], [0.0, FOCAL, IMAGE[1] / 2], [0.0, 0.0, 1.0]]
        )
        distortion = np.array([-0.12, 0.05, 1e-4, -1e-4])
        cameras.append(Camera(intrinsics, rotation, -rotation @ place, distortion))
    return cameras


def film(position: xr.DataArray, *, pixel_noise: float, rng: np.random.Generator) -> xr.DataArray:
    """Project markers (marker, axis, time_marker) [m] into three cameras and triangulate them.

    `pixel_noise` is the standard deviation of each image coordinate [pixel].
    """
    values = position.transpose("marker", "axis", "time_marker").values
    points = values.transpose(0, 2, 1)
    cameras = three_cameras(points.reshape(-1, 3).mean(axis=0))
    pixels = np.stack([camera.project(points) for camera in cameras])
    pixels += pixel_noise * rng.standard_normal(pixels.shape)
    tracks = xr.DataArray(
        pixels.transpose(0, 1, 3, 2),
        coords={"marker": position["marker"], "time_marker": position["time_marker"]},
        dims=("camera", "marker", "image_axis", "time_marker"),
    )
    seen = triangulate(tracks, cameras)["position"]
    return position.copy(data=seen.transpose("marker", "axis", "time_marker").values)


def occlude(position: xr.DataArray, *, rate: float, rng: np.random.Generator) -> xr.DataArray:
    """Replace positions by NaN for short intervals, `rate` times per second for each marker."""
    time = position["time_marker"].values
    values = position.transpose("marker", "axis", "time_marker").values.copy()
    span = float(time[-1] - time[0])
    for marker in values:
        for _ in range(rng.poisson(rate * span)):
            start = rng.uniform(time[0], time[-1])
            lost = (time >= start) & (time < start + rng.uniform(SHORTEST_LOSS, LONGEST_LOSS))
            marker[:, lost] = np.nan
    return position.copy(data=values)
