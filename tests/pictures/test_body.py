"""Drawn body of a face: parts, smooth surface between the nodes, dark region behind the lips."""

import numpy as np
import pytest
import xarray as xr

from emgface.face.parts import arches_of
from emgface.pictures.body import (
    LINING,
    MOUTH,
    NOSTRIL,
    PART_COLOURS,
    REFINED_POINTS,
    SKIN_PART,
    VERMILION_PART,
    Skin,
    body_of,
    make_body,
    nostrils,
    skin_of,
)
from emgface.pictures.subdivision import follow, refined


def sheet(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners of an n by n square of quadrilaterals, and the place of each node."""
    index = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    u = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, n + 1)] * 2, indexing="ij"), -1)
    return np.stack([a, b, c, d], -1).reshape(-1, 4), u.reshape(-1, 2)


def test_points_between_nodes_reproduce_cubics() -> None:
    """The four-point rule is exact for cubic polynomials, away from the border."""
    facet, u = sheet(8)
    x, y = u.T
    value = np.stack([x, y, 1.0 + x - 2.0 * y + 3.0 * x**2 * y - x**3 + x**3 * y**3], axis=1)
    rules, finer, part = refined(facet, np.arange(len(facet)), len(u))
    followed = follow(np.concatenate(rules), value)
    x, y, z = followed.T
    wanted = 1.0 + x - 2.0 * y + 3.0 * x**2 * y - x**3 + x**3 * y**3
    inside = (np.abs(followed[:, :2] - 0.5) < 0.3).all(axis=1)
    assert inside.sum() > 80
    np.testing.assert_allclose(z[inside], wanted[inside], atol=1e-12)
    assert len(finer) == 4 * len(facet) and (np.bincount(part) == 4).all()
    np.testing.assert_array_equal(followed[: len(u)], value)


@pytest.mark.parametrize("power", [1, 2])
def test_surface_is_of_fourth_order_along_a_circle(power: int) -> None:
    """Around a closed band with halved edges, the distance from the circle decreases by 2**4."""
    errors = []
    for n in (12, 24):
        angle = 2 * np.pi * np.arange(n) / n
        ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        points = np.concatenate([np.column_stack([ring, np.full(n, h)]) for h in (0.0, 1.0)])
        k = np.arange(n)
        after = np.roll(k, -1)
        facet = np.stack([k, after, after + n, k + n], axis=1)
        rules, _, _ = refined(facet, np.zeros(n, int), 2 * n)
        followed = follow(np.concatenate(rules), points)
        errors.append(np.abs(np.hypot(followed[:, 0], followed[:, 1]) ** power - 1.0).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.1)


def test_triangles_are_divided_too() -> None:
    facet = np.array([[0, 1, 2, 2], [2, 1, 3, 3]])
    rules, finer, _ = refined(facet, np.zeros(2, int), 4)
    square = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
    followed = follow(np.concatenate(rules), square)
    a, b, c = (followed[finer[:, k]] for k in range(3))
    np.testing.assert_array_equal(followed[:4], square)
    assert len(finer) == 8 and (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_parts_of_a_face(face: xr.Dataset) -> None:
    skin = skin_of(face)
    assert len(np.unique(np.sort(skin.facet, axis=1), axis=0)) == len(skin.facet)
    middle = face["position"].values[skin.node][skin.facet].mean(axis=1)
    at = {part: middle[skin.part == part] for part in (SKIN_PART, VERMILION_PART, LINING)}
    assert all(len(each) for each in at.values())
    near = [np.abs(at[part][np.abs(at[part][:, 0]) < 5e-3]) for part in (VERMILION_PART, LINING)]
    assert near[0][:, 2].max() < 12e-3, "the red is at the lips"
    assert near[0][:, 1].mean() > near[1][:, 1].mean() + 2e-3, "the lining lies behind it"
    plain = face.drop_dims(["facet", "surface"])
    assert set(skin_of(plain).part) == {SKIN_PART}


def test_body_follows_its_nodes(face: xr.Dataset) -> None:
    skin = skin_of(face)
    body, rest = body_of(face, skin), face["position"].values[skin.node]
    points = body.points(rest)
    np.testing.assert_array_equal(points[: body.n], rest)
    assert REFINED_POINTS <= body.tissue < 4 * REFINED_POINTS
    shift = np.array([1e-3, -2e-3, 3e-3])
    moved = body.points(rest + shift)
    tissue = len(points) - len(body.teeth)
    np.testing.assert_allclose(moved[:tissue], points[:tissue] + shift, atol=1e-12)
    np.testing.assert_array_equal(moved[tissue:], points[tissue:])
    assert len(body.teeth) == sum(len(arch.points) for arch in arches_of(face))
    assert set(map(tuple, body.colour[body.tissue : tissue])) == {MOUTH}
    # The dark region must not be visible above the cheeks.
    behind = np.unique(body.triangle[(body.triangle >= body.tissue).all(axis=1)])
    behind = behind[behind < tissue]
    assert points[behind, 2].max() < points[: body.n, 2].max() - 0.02
    bare = make_body(rest, skin, ())
    assert len(bare.teeth) == 0 and bare.tissue == body.tissue


def test_colour_by_node(face: xr.Dataset) -> None:
    body = body_of(face)
    green = body.coloured(np.tile([0.0, 1.0, 0.0], (body.n, 1)))
    np.testing.assert_allclose(green[: body.tissue], [[0.0, 1.0, 0.0]] * body.tissue)
    np.testing.assert_array_equal(green[body.tissue :], body.colour[body.tissue :])
    assert tuple(body.colour[0]) in {*PART_COLOURS.values()} or (body.colour[0] <= 1.0).all()


def test_a_closed_surface_gets_no_back() -> None:
    cube = np.array(
        [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    )
    position = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]] * 2, dtype=float)
    position[4:, 2] = 1.0
    skin = Skin(np.arange(8), cube, np.zeros(6, dtype=np.int64))
    body = make_body(position, skin, ())
    assert body.tissue == len(body.colour)


def test_nostrils_are_drawn_on_the_base_of_the_nose(face):
    """Dark on both sides, above the lips, facing downward; nowhere else, and not without lips."""
    skin = skin_of(face)
    rest = face["position"].values[skin.node]
    body = body_of(face, skin)
    points = body.points(rest)[: body.tissue]
    n, facet, part = len(rest), skin.facet, skin.part
    share = nostrils(rest, facet, part)
    assert share.shape == (n,) and share.max(initial=0.0) <= 1.0
    dark = np.abs(body.colour[: body.tissue] - np.array(NOSTRIL)).max(axis=1) < 0.05
    assert 4 <= dark.sum() < 0.01 * body.tissue
    lips = np.unique(facet[part == VERMILION_PART])
    middle = rest[lips, 0].mean()
    for side in (-1.0, 1.0):
        own = points[dark][side * (points[dark, 0] - middle) > 0.0]
        assert 0.3 * dark.sum() < len(own)
        assert np.ptp(own[:, 0]) < 0.012 and np.ptp(own[:, 1]) < 0.02
    assert points[dark, 2].min() > rest[lips, 2].max()
    # The template is symmetrical.
    np.testing.assert_allclose(points[dark, 0].mean(), middle, atol=1e-6)
    assert not nostrils(rest, facet, np.full_like(part, SKIN_PART)).any()
    # A face that looks upward has no base of a nose above its lips.
    turned = rest * np.array([1.0, 1.0, -1.0])
    assert not nostrils(turned, facet[:, ::-1], part).any()
