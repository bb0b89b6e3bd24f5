"""Pictures by the z-buffer: silhouettes, hidden parts, orientation, light."""

import numpy as np
import pytest

from emgface.pictures.body import MOUTH, Body
from emgface.pictures.render import (
    LIGHT,
    VIEWS,
    Window,
    axes_of,
    nearest_layer,
    normals,
    project,
    render,
    shaded,
    window_of,
)


def ball(n: int = 40) -> tuple[Body, np.ndarray]:
    """Unit sphere of triangles, grey."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 2 * n + 1)[:-1], np.linspace(0, np.pi, n + 1))
    points = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], -1).reshape(-1, 3)
    k = np.arange((n + 1) * 2 * n).reshape(n + 1, 2 * n)
    a, b = k[:-1], np.roll(k[:-1], -1, axis=1)
    c, d = np.roll(k[1:], -1, axis=1), k[1:]
    corners = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, d, b), (b, d, c))])
    none = np.empty((0, 4), dtype=np.int64)
    return Body(
        len(points), none, points[:0], corners, np.full((len(points), 3), 0.6), len(points)
    ), points


@pytest.fixture(scope="module")
def sphere() -> tuple[Body, np.ndarray]:
    return ball()


def test_silhouette_of_a_sphere(sphere) -> None:
    body, points = sphere
    window = Window(-1.25, -1.25, 1.25, 1.25)
    for view in VIEWS.values():
        picture = render(body, points, view, window, 200)
        assert picture.shape == (200, 200, 4)
        area = picture[..., 3].sum() / 255.0 * (2.5 / 200) ** 2
        assert area == pytest.approx(np.pi, rel=5e-3)
        rows = np.flatnonzero((picture[..., 3] > 127).any(axis=1))
        assert rows[0] + rows[-1] == pytest.approx(199, abs=1), "in the middle"


def test_shading_is_that_of_the_normals(sphere) -> None:
    """Colours of a sphere compared with those of its exact normals."""
    body, points = sphere
    picture = render(body, points, (0.0, 0.0), Window(-1.0, -1.0, 1.0, 1.0), 101, finer=1)
    x = (np.arange(101) - 50.0) / 50.5
    u, v = np.meshgrid(x, -x)
    inside = u**2 + v**2 < 0.8
    n = np.stack([u, v, np.sqrt(np.maximum(0.0, 1.0 - u**2 - v**2))], axis=-1)[inside]
    wanted = 255.0 * shaded(np.full((len(n), 3), 0.6), n)
    assert np.abs(picture[inside][:, :3] - wanted).max() < 4.0
    bright = wanted.sum(axis=1)
    assert np.corrcoef(bright, n[:, 1])[0, 1] > 0.5, "light from above"


def test_cameras_look_from_the_named_side() -> None:
    left, up, front = np.array([-1.0, 0, 0]), np.array([0, 0, 1.0]), np.array([0, 1.0, 0])
    frame = axes_of(VIEWS["front"])
    np.testing.assert_allclose(frame @ left, [1, 0, 0], atol=1e-12)  # on the right of the picture
    np.testing.assert_allclose(frame @ front, [0, 0, 1], atol=1e-12)
    frame = axes_of(VIEWS["left"])
    np.testing.assert_allclose(frame @ left, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(frame @ front, [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(axes_of(VIEWS["right"]) @ left, [0, 0, -1], atol=1e-12)
    assert (axes_of(VIEWS["oblique"]) @ left)[2] > 0.5 and (axes_of(VIEWS["oblique"]) @ up)[2] > 0
    for view in VIEWS.values():
        np.testing.assert_allclose(axes_of(view) @ axes_of(view).T, np.eye(3), atol=1e-12)


def test_the_nearest_triangle_is_seen_and_neighbours_share_no_pixel() -> None:
    # A square of two triangles, and before its left half another.
    points = np.array([[0, 0], [8, 0], [8, 8], [0, 8], [0, 0], [4, 0], [4, 8], [0, 8.0]])
    depth = np.array([0, 0, 0, 0, 1, 1, 1, 1.0])
    triangle = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    pixel, face, weight = nearest_layer(points, depth, triangle, (8, 8))
    assert sorted(pixel) == [*range(64)]
    column = pixel % 8
    assert (face[column < 4] >= 2).all() and (face[column >= 4] < 2).all()
    np.testing.assert_allclose(weight.sum(axis=1), 1.0)
    at = np.einsum("pk,pkd->pd", weight, points[triangle[face]])
    np.testing.assert_allclose(at, np.stack([column + 0.5, pixel // 8 + 0.5], axis=1), atol=1e-12)
    outside, _, _ = nearest_layer(points - 100.0, depth, triangle, (8, 8))
    assert len(outside) == 0


def test_the_inside_is_darker_in_its_own_light(sphere) -> None:
    """Seen from within, the far pole has the normal of the near one: its light, mixed with the mouth."""
    body, points = sphere
    open_ = points[body.triangle].mean(axis=1)[:, 1] < 0.6  # the cap towards the camera is gone
    opened = Body(body.n, body.rules, body.teeth, body.triangle[open_], body.colour, body.tissue)
    picture = render(opened, points, (0.0, 0.0), Window(-1.0, -1.0, 1.0, 1.0), 51)
    whole = render(body, points, (0.0, 0.0), Window(-1.0, -1.0, 1.0, 1.0), 51)
    near, mouth = whole[25, 25, :3], 255 * np.array(MOUTH)
    expected = mouth + LIGHT["inside"] * (near - mouth)
    np.testing.assert_allclose(picture[25, 25, :3], expected, atol=2.0)
    assert (picture[25, 25, :3] < 0.9 * near).all()
    assert picture[2, 25, :3].min() > 60


def test_normals_point_outwards(sphere) -> None:
    body, points = sphere
    directions = normals(points, body.triangle)
    assert (np.einsum("nd,nd->n", directions, points) > 0.99).all()


def test_window_has_the_points_in_its_middle() -> None:
    points = np.array([[-1.0, 0.0, 0.0], [3.0, 0.0, 2.0]])
    window = window_of(points, VIEWS["front"], 0.1)
    flat = project(points, VIEWS["front"])[:, :2]
    assert (window.left + window.right) / 2 == pytest.approx(flat[:, 0].mean())
    assert window.right - window.left == pytest.approx(4.8)
