"""Markers reconstructed from three synthetic cameras around a face."""

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

from emgface.errors import MarkerError
from emgface.volunteers.cameras import Camera, triangulate

ANGLES = (-35.0, 0.0, 35.0)
PIXEL = 2.0
FRAMES = 20


def camera(angle: float, distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)) -> Camera:
    """Return a camera of 1280 x 1024 pixels, 0.8 m in front of the face at y = 0."""
    turn = Rotation.from_euler("z", angle, degrees=True).as_matrix()
    place = turn @ np.array([0.0, 0.8, 0.02])
    look = -place / np.linalg.norm(place)
    side = np.cross(look, [0, 0, 1.0])
    side /= np.linalg.norm(side)
    rotation = np.stack([side, np.cross(look, side), look])
    intrinsics = np.array([[1900.0, 0, 655], [0, 1910.0, 500], [0, 0, 1]])
    return Camera(intrinsics, rotation, -rotation @ place, np.array(distortion))


def bent() -> list[Camera]:
    return [camera(a, (-0.12, 0.05, 0.002, -0.001)) for a in ANGLES]


def markers() -> np.ndarray:
    rng = np.random.default_rng(2)
    rest = rng.uniform([-0.06, -0.04, -0.08], [0.06, 0.05, 0.08], size=(7, 3))
    time = np.arange(FRAMES)
    return rest[:, :, None] + 0.01 * np.sin(0.3 * time + np.arange(7)[:, None, None])


def images(cameras: list[Camera], points: np.ndarray) -> xr.DataArray:
    pixels = np.stack([c.project(points.transpose(0, 2, 1)) for c in cameras])
    return xr.DataArray(
        pixels.transpose(0, 1, 3, 2),
        dims=("camera", "marker", "image_axis", "time_marker"),
        coords={"marker": [f"m{i}" for i in range(7)], "time_marker": np.arange(FRAMES) / 100},
    )


def test_a_projection_is_that_of_similar_triangles() -> None:
    front = camera(0.0)
    point = np.array([[0.05, 0.1, 0.02]])  # 0.7 m before the camera, at its height
    centre, lateral = front.project(np.array([[0.0, 0.0, 0.02]])), front.project(point)
    assert abs(lateral[0, 0] - centre[0, 0]) == pytest.approx(1900 * 0.05 / 0.7, rel=2e-3)
    assert np.isnan(front.project(np.array([[0.0, 2.0, 0.0]]))).all()


def test_distortion_is_undone() -> None:
    rng = np.random.default_rng(0)
    for one in bent():
        points = rng.uniform(-0.1, 0.1, size=(50, 3))
        seen = points @ one.rotation.T + one.translation
        undistorted = one.normalised(one.project(points))
        np.testing.assert_allclose(undistorted, seen[:, :2] / seen[:, 2:], atol=1e-12)


def test_markers_are_found_where_they_are() -> None:
    triangulation = triangulate(images(bent(), markers()), bent())
    np.testing.assert_allclose(triangulation["position"], markers(), atol=1e-9)
    assert float(triangulation["reprojection_error"].max()) < 1e-6
    assert (triangulation["views"] == 3).all() and triangulation["position"].attrs["units"] == "m"


def test_noise_in_the_images_gives_the_expected_error_in_space() -> None:
    cameras, rng = bent(), np.random.default_rng(5)
    tracks = images(cameras, markers())
    noisy = tracks + 0.2 * rng.normal(size=tracks.shape)
    error = triangulate(noisy, cameras)
    away = error["position"].values - markers()
    # 0.2 pixels over 1900 pixels of focal length at 0.8 m are 0.08 mm in each image.
    assert 0.02e-3 < np.sqrt(np.mean(away**2)) < 0.2e-3
    # Six coordinates less three unknowns: rms over three views of 0.2 sqrt(2 * 3 / 6).
    rms = float(np.sqrt((error["reprojection_error"] ** 2).mean()))
    assert rms == pytest.approx(0.2, rel=0.15)


def test_the_least_squares_are_those_of_a_general_optimiser() -> None:
    from scipy.optimize import least_squares

    cameras, rng = bent(), np.random.default_rng(6)
    tracks = images(cameras, markers()) + PIXEL * rng.normal(size=(3, 7, 2, FRAMES))
    triangulation = triangulate(tracks, cameras)["position"].values[3, :, 4]
    pixels = tracks.values[:, 3, :, 4]
    best = least_squares(
        lambda x: np.concatenate([c.project(x) - p for c, p in zip(cameras, pixels, strict=True)]),
        triangulation + 0.001, xtol=1e-14, ftol=1e-14, gtol=1e-14,
    )  # fmt: skip
    np.testing.assert_allclose(triangulation, best.x, atol=1e-9)


def test_two_views_suffice_and_one_does_not() -> None:
    tracks = images(bent(), markers())
    tracks[0, 2, :, 5] = np.nan
    tracks[0, 3, :, 6] = tracks[2, 3, 1, 6] = np.nan
    triangulation = triangulate(tracks, bent())
    np.testing.assert_allclose(triangulation["position"][2, :, 5], markers()[2, :, 5], atol=1e-9)
    assert np.isnan(triangulation["position"][3, :, 6]).all() and np.isnan(
        triangulation["reprojection_error"][3, 6]
    )
    assert (int(triangulation["views"][2, 5]), int(triangulation["views"][3, 6])) == (2, 1)
    assert int(np.isnan(triangulation["position"]).sum()) == 3


def test_a_wrong_match_has_a_large_reprojection_error() -> None:
    tracks = images(bent(), markers())
    tracks[1, 0, :, 3] = tracks[1, 1, :, 3]
    error = triangulate(tracks, bent())["reprojection_error"]
    assert float(error[0, 3]) > 5.0 and float(error.max()) == float(error[0, 3])


def test_tracks_that_match_no_cameras_are_refused() -> None:
    with pytest.raises(MarkerError, match="found 2 cameras for 3 tracks"):
        triangulate(images(bent(), markers()), bent()[:2])
    with pytest.raises(MarkerError, match="expected camera, marker, image_axis, time_marker"):
        triangulate(images(bent(), markers()).isel(camera=0), bent())
