"""Membership by radius, directions by interpolation and projection, against plain computations."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from emgface.errors import FaceError
from emgface.face.bundles import (
    distance_to_fibres,
    elements_within,
    fibre_directions,
    interpolation_weights,
    project_into_mesh,
    symmetric_directions,
)
from emgface.face.quality import element_centres
from emgface.face.surface import boundary_faces, nearest_on_triangles, triangles, winding_number

CUBE = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
CUBE_ELEMENT = np.array([[0, 1, 3, 2, 4, 5, 7, 6]])


def test_distance_to_a_segment_is_clamped_at_its_ends() -> None:
    fibre = np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 2.0, 0]])
    points = np.array([[0.5, 0, 3.0], [-3.0, -4.0, 0], [1.0, 5.0, 4.0], [2.0, -1.0, 0]])
    np.testing.assert_allclose(
        distance_to_fibres(points, [fibre]), [3.0, 5.0, 5.0, np.sqrt(2.0)], rtol=1e-15
    )


def test_distance_agrees_with_dense_sampling_of_the_fibre() -> None:
    rng = np.random.default_rng(1)
    fibre = rng.normal(size=(6, 3))
    points = rng.normal(size=(40, 3))
    t = np.linspace(0, 1, 20001)[:, None]
    samples = np.concatenate(
        [(1 - t) * a + t * b for a, b in zip(fibre[:-1], fibre[1:], strict=True)]
    )
    brute = np.array([np.linalg.norm(samples - point, axis=1).min() for point in points])
    distance = distance_to_fibres(points, [fibre])
    spacing = np.linalg.norm(np.diff(fibre, axis=0), axis=1).max() / 20000
    # The nearest sample is at most half a spacing off along the fibre.
    assert (distance <= brute + 1e-12).all()
    assert (brute - distance <= spacing / 2).all()


def test_radius_is_exclusive_and_positive() -> None:
    fibre = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    centres = np.array([[0.5, 1.0, 0], [0.5, 0.999, 0], [5.0, 0, 0]])
    assert elements_within(centres, [fibre], 1.0).tolist() == [1]
    assert elements_within(centres, [], 1.0).tolist() == []
    with pytest.raises(FaceError, match="expected a positive length"):
        elements_within(centres, [fibre], 0.0)


def test_coinciding_and_single_points_are_refused() -> None:
    with pytest.raises(FaceError, match="fibre 0 has coinciding points 1 and 2"):
        distance_to_fibres(CUBE, [np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0]])])
    with pytest.raises(FaceError, match="fibre 0 has 1 point"):
        fibre_directions(CUBE, [np.zeros((1, 3))])
    with pytest.raises(FaceError, match="no fibre"):
        fibre_directions(CUBE, [])


def test_weights_reproduce_a_linear_field_inside_the_hull() -> None:
    rng = np.random.default_rng(2)
    sites = rng.normal(size=(30, 3))
    points = 0.3 * rng.normal(size=(50, 3))
    site, weight = interpolation_weights(points, sites)
    inside = np.linalg.norm(np.einsum("nk,nki->ni", weight, sites[site]) - points, axis=1) < 1e-9
    assert inside.sum() > 25
    np.testing.assert_allclose(weight.sum(axis=1), 1.0, rtol=1e-14)
    assert (weight >= 0).all()


def test_outside_the_hull_the_nearest_point_of_the_hull_counts() -> None:
    from scipy.optimize import nnls

    rng = np.random.default_rng(3)
    sites = rng.normal(size=(12, 3))
    points = 5.0 * rng.normal(size=(20, 3))
    site, weight = interpolation_weights(points, sites)
    product = np.einsum("nk,nki->ni", weight, sites[site])
    for point, near in zip(points, product, strict=True):
        # min |sum w_i s_i - p| with w >= 0, sum w = 1 (a heavy extra row) by non-negative
        # least squares.
        heavy = 1e4
        a = np.vstack([sites.T, np.full(len(sites), heavy)])
        w, _ = nnls(a, np.append(point, heavy))
        best = sites.T @ (w / w.sum())
        assert np.linalg.norm(near - point) <= np.linalg.norm(best - point) * (1 + 1e-6)


@pytest.mark.parametrize("dimension", [0, 1, 2])
def test_flat_sites_are_interpolated_in_their_own_space(dimension: int) -> None:
    rng = np.random.default_rng(4)
    basis, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    sites = rng.normal(size=(7, dimension)) @ basis[:dimension] + 1.0
    shares = rng.dirichlet(np.ones(7), size=10)
    inside = shares @ sites + 0.5 * rng.normal(size=(10, 3 - dimension)) @ basis[dimension:]
    site, weight = interpolation_weights(inside, sites)
    assert site.shape == (10, dimension + 1)
    # The weights give back the point's foot in the space of the sites.
    np.testing.assert_allclose(
        np.einsum("nk,nki->ni", weight, sites[site]), shares @ sites, atol=1e-12
    )


def test_flat_sites_clamp_to_their_hull() -> None:
    triangle = np.array([[0.0, 0, 0], [1.0, 0, 0], [0, 1.0, 0]])
    site, weight = interpolation_weights(np.array([[2.0, 0.0, 7.0], [2.0, 2.0, -1.0]]), triangle)
    near = np.einsum("nk,nki->ni", weight, triangle[site])
    np.testing.assert_allclose(near, [[1.0, 0, 0], [0.5, 0.5, 0]], atol=1e-15)
    line = np.array([[0.0, 0, 0], [1.0, 1.0, 0], [2.0, 2.0, 0]])
    site, weight = interpolation_weights(np.array([[9.0, 9.0, 3.0], [0.5, 0.5, 1.0]]), line)
    near = np.einsum("nk,nki->ni", weight, line[site])
    np.testing.assert_allclose(near, [[2.0, 2.0, 0], [0.5, 0.5, 0]], atol=1e-15)


def test_straight_fibre_gives_its_own_direction() -> None:
    fibre = np.linspace([0.0, 0, 0], [3.0, 3.0, 0.0], 4)
    directions = fibre_directions(np.random.default_rng(5).normal(size=(9, 3)), [fibre])
    along = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    np.testing.assert_allclose(directions, np.tile(along, (9, 1)), atol=1e-12)


def test_opposing_segments_do_not_cancel() -> None:
    # Two antiparallel fibres: a plain sum would be zero half way between them.
    up = np.array([[0.0, 0, 0], [0, 0, 1.0], [0, 0, 2.0]])
    down = up[::-1] + [1.0, 0, 0]
    directions = fibre_directions(np.array([[0.5, 0.0, 1.0], [0.4, 0.3, 0.9]]), [up, down])
    np.testing.assert_allclose(np.abs(directions), [[0, 0, 1.0]] * 2, atol=1e-12)


def test_symmetric_directions_mirror_each_other() -> None:
    rng = np.random.default_rng(6)
    left = rng.normal(size=(5, 3)) - [2.0, 0, 0]
    mirror = np.array([-1.0, 1.0, 1.0])
    points = rng.normal(size=(20, 3))
    fibres = [left, left * mirror]
    np.testing.assert_array_equal(
        symmetric_directions(points * mirror, fibres)[points[:, 0] != 0],
        (symmetric_directions(points, fibres) * mirror)[points[:, 0] != 0],
    )


def test_boundary_of_a_cube_is_closed_and_outward() -> None:
    faces, element = boundary_faces(CUBE_ELEMENT)
    assert len(faces) == 6 and (element == 0).all()
    corners = CUBE[triangles(faces, CUBE)]
    # Divergence theorem: outward triangles enclose the volume 1.
    volume = np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    assert volume == pytest.approx(1.0, abs=1e-14)
    points = np.array([[0.5, 0.5, 0.5], [0.1, 0.9, 0.2], [1.5, 0.5, 0.5], [0.5, 0.5, -0.1]])
    np.testing.assert_allclose(winding_number(points, corners), [1, 1, 0, 0], atol=1e-12)


def test_points_outside_move_to_the_nearest_surface_point() -> None:
    points = np.array([[0.5, 0.5, 0.5], [1.5, 0.25, 0.5], [2.0, 2.0, 2.0], [0.5, -1.0, 2.0]])
    projected, outside = project_into_mesh(points, CUBE, CUBE_ELEMENT)
    assert outside.tolist() == [False, True, True, True]
    # The nearest point of a box clamps each coordinate.
    np.testing.assert_allclose(projected, np.clip(points, 0, 1), atol=1e-15)


def test_nearest_on_triangles_agrees_with_dense_sampling() -> None:
    rng = np.random.default_rng(7)
    corners = rng.normal(size=(5, 3, 3))
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, 301), np.linspace(0, 1, 301)))
    keep = u + v <= 1
    shares = np.stack([1 - u - v, u, v], axis=1)[keep]
    samples = np.einsum("pk,tki->tpi", shares, corners).reshape(-1, 3)
    for point in 2.0 * rng.normal(size=(30, 3)):
        nearest, triangle, weights = nearest_on_triangles(point, corners)
        np.testing.assert_allclose(weights @ corners[triangle], nearest, atol=1e-12)
        assert (weights >= 0).all()
        distance = np.linalg.norm(nearest - point)
        brute = np.linalg.norm(samples - point, axis=1).min()
        assert distance <= brute + 1e-12
        assert brute - distance < 0.02


def test_projection_of_the_published_fibres(models: Path, reference_face: xr.Dataset) -> None:
    table = pd.read_csv(models / "face_reference" / "derived" / "fibres_left.csv")
    points = table[["x_mm", "y_mm", "z_mm"]].to_numpy() * 1e-3
    projected, outside = project_into_mesh(
        points, reference_face["position"].values, reference_face["connectivity"].values
    )
    np.testing.assert_array_equal(outside, table["outside_mesh"].to_numpy() == 1)
    expected = table[["xproj_mm", "yproj_mm", "zproj_mm"]].to_numpy() * 1e-3
    # The table prints micrometres to four digits.
    np.testing.assert_allclose(projected, expected, atol=1e-7)


def test_directions_of_another_simulator(shared: Path, reference_face: xr.Dataset) -> None:
    """Every direction of 890 elements equals that of a valid tetrahedralisation.

    Mirrored midpoints are cospherical, so the tetrahedralisation is not unique; a displacement of
    the midpoints by about 10 nm selects one of them.
    """
    file = shared / "artisynth_reference" / "refmodel_model.json"
    muscles = json.loads(file.read_text())["muscles"]
    centres = element_centres(
        reference_face["position"].values, reference_face["connectivity"].values
    )
    rng = np.random.default_rng(0)
    compared = 0
    for bundle in muscles.values():
        index, expected = bundle["element_indices"], np.array(bundle["directions"])
        if not index:
            continue
        segments = [np.array(segment) for segment in bundle["fibres"]]
        open_ones = np.arange(len(index))
        for _ in range(30):
            moved = [segment + 1e-8 * rng.normal(size=3) for segment in segments]
            directions = fibre_directions(centres[index][open_ones], moved)
            sine = np.linalg.norm(np.cross(directions, expected[open_ones]), axis=1)
            # 10 nm on segments of millimetres turn a direction by about 1e-5.
            open_ones = open_ones[sine > 1e-5]
            if len(open_ones) == 0:
                break
        assert len(open_ones) == 0
        compared += len(index)
    assert compared == 890
