"""Cameras of a simulated volunteer: images of markers, and triangulation of their positions.

A camera maps a point X in space to pixels by x = K d(R X + t): R and t transform X to the frame of
the camera, d divides by depth and distorts, K contains focal lengths and principal point. Sources:
Hartley and Zisserman 2004, Multiple View Geometry, 2nd ed., section 12.2; Brown 1971,
Photogrammetric Engineering 37:855 (distortion).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from emgface.errors import MarkerError
from emgface.muscles import AXES

_UNDISTORTING = 50


@dataclass(frozen=True)
class Camera:
    """A calibrated camera.

    `intrinsics` is the upper triangular matrix K (3, 3) [pixel]; `rotation` R (3, 3) and
    `translation` t (3,) [m] transform from the laboratory to the camera, whose optical axis is its
    third axis; `distortion` contains the radial coefficients k1, k2 and the tangential p1, p2.
    """

    intrinsics: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray
    distortion: np.ndarray

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of points (..., 3) [m] in space; NaN for a point behind the camera."""
        seen = np.asarray(points) @ self.rotation.T + self.translation
        depth = np.where(seen[..., 2:] > 0, seen[..., 2:], np.nan)
        bent = self._distorted(seen[..., :2] / depth)
        return bent @ self.intrinsics[:2, :2].T + self.intrinsics[:2, 2]

    def normalised(self, pixels: np.ndarray) -> np.ndarray:
        """Undistorted image coordinates x/z and y/z in the frame of the camera, of pixels (..., 2).

        They are NaN where the distortion cannot be inverted.
        """
        bent = np.asarray(pixels, dtype=float) - self.intrinsics[:2, 2]
        bent = bent @ np.linalg.inv(self.intrinsics[:2, :2]).T
        coordinates = bent.copy()
        for _ in range(
            _UNDISTORTING
        ):  # fixed-point iteration; a few steps suffice for usual lenses
            coordinates = coordinates + (bent - self._distorted(coordinates))
        left = np.abs(self._distorted(coordinates) - bent).max(axis=-1, keepdims=True)
        return np.where(left < 1e-9, coordinates, np.nan)

    def _distorted(self, plain: np.ndarray) -> np.ndarray:
        k1, k2, p1, p2 = self.distortion
        x, y = plain[..., 0], plain[..., 1]
        square = x**2 + y**2
        radial = 1.0 + k1 * square + k2 * square**2
        return np.stack(
            [
                x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x**2),
                y * radial + p1 * (square + 2.0 * y**2) + 2.0 * p2 * x * y,
            ],
            axis=-1,
        )


def triangulate(tracks: xr.DataArray, cameras: Sequence[Camera]) -> xr.Dataset:
    """Compute the positions of markers from their tracks in several images.

    For each marker and frame the homogeneous linear equations of all cameras that record it
    determine a position, which three Gauss-Newton steps improve to the least squares of the image
    distances.

    `tracks` (camera, marker, image_axis, time_marker) [pixel] are NaN where a camera does not
    record the marker. The result contains ``position(marker, axis, time_marker)`` [m], NaN for
    fewer than two cameras; ``reprojection_error(marker, time_marker)`` [pixel], the
    root-mean-square distance of the images; and ``views(marker, time_marker)`` [1], the number of
    cameras. Raises MarkerError if the dims or the number of cameras do not fit.
    """
    dims = ("camera", "marker", "image_axis", "time_marker")
    if set(tracks.dims) != set(dims) or tracks.sizes.get("image_axis") != 2:
        raise MarkerError(
            f"found tracks of dims {tracks.dims} and shape {tracks.shape}, expected "
            f"{', '.join(dims)} with two image axes"
        )
    if tracks.sizes["camera"] != len(cameras) or len(cameras) < 2:
        raise MarkerError(
            f"found {len(cameras)} cameras for {tracks.sizes['camera']} tracks, expected one each "
            "and at least two"
        )
    pixels = tracks.transpose("camera", "marker", "time_marker", "image_axis").values
    shape = pixels.shape[1:3]
    flat = pixels.reshape(len(cameras), -1, 2).astype(float)
    seen = np.asarray(np.isfinite(flat).all(axis=2))
    points = _intersection(flat, seen, cameras)
    for _ in range(3):
        points = _improved(points, flat, seen, cameras)
    away = np.stack([c.project(points) for c in cameras]) - flat
    square = np.where(seen, np.sum(away**2, axis=2), 0.0)
    views = seen.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        error = np.sqrt(square.sum(axis=0) / views)
    lost = (views < 2) | ~np.isfinite(points).all(axis=1)
    points[lost], error[lost] = np.nan, np.nan
    coords = {"marker": tracks["marker"], "time_marker": tracks["time_marker"]}
    return xr.Dataset(
        {
            "position": (
                ("marker", "axis", "time_marker"),
                points.reshape(*shape, 3).transpose(0, 2, 1),
                {"units": "m"},
            ),
            "reprojection_error": (
                ("marker", "time_marker"), error.reshape(shape), {"units": "pixel"},
            ),
            "views": (("marker", "time_marker"), views.reshape(shape), {"units": "1"}),
        },
        {**coords, "axis": list(AXES)},
    )  # fmt: skip


def _intersection(pixels: np.ndarray, seen: np.ndarray, cameras: Sequence[Camera]) -> np.ndarray:
    """Linear solution, shape (points, 3): x (r3 X + t3) = r1 X + t1 for each image coordinate."""
    left = np.zeros((pixels.shape[1], 3, 3))
    right = np.zeros((pixels.shape[1], 3))
    for camera, image, there in zip(cameras, pixels, seen, strict=True):
        plain = camera.normalised(image)
        good = there & np.isfinite(plain).all(axis=1)
        for axis in (0, 1):
            value = np.where(good, plain[:, axis], 0.0)[:, None]
            row = camera.rotation[axis] - value * camera.rotation[2]
            known = value[:, 0] * camera.translation[2] - camera.translation[axis]
            row, known = row * good[:, None], known * good
            left += row[:, :, None] * row[:, None, :]
            right += row * known[:, None]
    return _solved(left, right, seen.sum(axis=0) >= 2)


def _improved(
    points: np.ndarray, pixels: np.ndarray, seen: np.ndarray, cameras: Sequence[Camera]
) -> np.ndarray:
    """One Gauss-Newton step on the image distances, derivatives by central differences."""
    step = 1e-6
    left = np.zeros((len(points), 3, 3))
    right = np.zeros((len(points), 3))
    for camera, image, there in zip(cameras, pixels, seen, strict=True):
        slope = np.stack(
            [
                (camera.project(points + shift) - camera.project(points - shift)) / (2 * step)
                for shift in step * np.eye(3)
            ],
            axis=2,
        )
        away = image - camera.project(points)
        good = there & np.isfinite(slope).all(axis=(1, 2)) & np.isfinite(away).all(axis=1)
        slope = np.where(good[:, None, None], slope, 0.0)
        away = np.where(good[:, None], away, 0.0)
        left += np.einsum("pki,pkj->pij", slope, slope)
        right += np.einsum("pki,pk->pi", slope, away)
    move = _solved(left, right, seen.sum(axis=0) >= 2)
    return points + np.where(np.isfinite(move), move, 0.0)


def _solved(left: np.ndarray, right: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Solve 3 x 3 systems; NaN if a point is not determined."""
    result = np.full(right.shape, np.nan)
    firm = usable & (np.linalg.cond(left) < 1e15)
    result[firm] = np.linalg.solve(left[firm], right[firm][:, :, None])[:, :, 0]
    return result
