"""The generated block: complete, symmetric, sound, scalable."""

import numpy as np
import pytest
import xarray as xr
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from emgface.errors import FaceError
from emgface.face.block import block_face
from emgface.face.check import face_report, sheet_nodes
from emgface.face.model import elements_of, fibres_of
from emgface.face.quality import element_centres, element_quality
from emgface.face.surface import boundary_faces
from emgface.muscles import FACE_MARKERS, LIP_MARKERS, MODELLED

MIRROR = np.array([-1.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def block() -> xr.Dataset:
    return block_face()


def partner(points: np.ndarray) -> np.ndarray:
    """Index of the exact mirror image of every point."""
    distance, index = KDTree(points).query(points * MIRROR)
    assert distance.max() < 1e-12
    return index


def test_size_and_element_kinds(block: xr.Dataset) -> None:
    value = face_report(block).summary["value"]
    assert value["elements"] == 20 * 3 * 16 + 12
    assert value["wedges"] == 24
    # 21 x 4 x 17 nodes and eleven doubled ones in each of four sheets.
    assert value["nodes"] == 21 * 4 * 17 + 11 * 4
    assert block.attrs["origin"] == "generated"
    assert np.unique(block["layer"].values).tolist() == [0, 1, 2]


@pytest.mark.parametrize("opening", [0.0, 3e-3, 6e-3])
def test_volume_is_that_of_a_slab_with_a_mouth(opening: float) -> None:
    """The bend keeps volume; the mouth takes opening x integral of the piecewise linear bow."""
    face = block_face(opening=opening)
    volume = face_report(face).summary.loc["volume", "value"]
    u = np.arange(-6, 7) / 10
    bow = np.clip(1.0 - (u / 0.6) ** 2, 0.0, None)
    gap = opening * np.trapezoid(bow, u * 30e-3) * 12e-3
    assert volume == pytest.approx((60e-3 * 12e-3 * 50e-3 - gap) * 1e9, rel=1e-12)


def test_elements_are_sound(block: xr.Dataset) -> None:
    quality = element_quality(block["position"].values, block["connectivity"].values)
    assert quality.smallest_det.min() > 0
    # A right isosceles wedge has sqrt(2/3) = 0.82, the bend costs some of it.
    assert quality.scaled_jacobian.min() > 0.6
    assert face_report(block).summary.loc["largest edge ratio", "value"] < 2.0


def test_mesh_mirrors_exactly(block: xr.Dataset) -> None:
    position, connectivity = block["position"].values, block["connectivity"].values
    # The lips coincide nowhere, so positions identify nodes.
    image = partner(position)
    rows = {frozenset(row[row >= 0].tolist()) for row in connectivity}
    mirrored = {frozenset(image[row[row >= 0]].tolist()) for row in connectivity}
    assert rows == mirrored
    np.testing.assert_array_equal(block["fixed"].values, block["fixed"].values[image])


def test_muscles_mirror_exactly(block: xr.Dataset) -> None:
    position, connectivity = block["position"].values, block["connectivity"].values
    centres = element_centres(position, connectivity)
    image = partner(centres)
    owner, direction = block["bundle_muscle"].values, block["bundle_direction"].values
    for k, muscle in enumerate(MODELLED):
        left, right = elements_of(block, f"{muscle}_L"), elements_of(block, f"{muscle}_R")
        np.testing.assert_array_equal(image[left], right)
        assert (centres[left, 0] < 0).all()
        np.testing.assert_array_equal(direction[owner == k] * MIRROR, direction[owner == k + 10])
        for one, other in zip(
            fibres_of(block, f"{muscle}_L"), fibres_of(block, f"{muscle}_R"), strict=True
        ):
            np.testing.assert_array_equal(one * MIRROR, other)


def test_muscle_directions_are_anatomical(block: xr.Dataset) -> None:
    """Mean direction from origin to insertion on the left, up to sign."""
    expected = {
        # Mostly along x, y or z, and the sign of the product of x and z.
        "ZYG": (2, -1),
        "RIS": (0, None),
        "LLSAN": (2, None),
        "LAO": (2, None),
        "BUC": (0, None),
        "DLI": (2, 1),
        "DAO": (2, 1),
        "MEN": (1, None),
    }
    owner, direction = block["bundle_muscle"].values, block["bundle_direction"].values
    for k, muscle in enumerate(MODELLED):
        if muscle not in expected:
            continue
        rows = direction[owner == k]
        main = np.linalg.eigh(rows.T @ rows)[1][:, -1]
        axis, sign = expected[muscle]
        assert np.argmax(np.abs(main)) == axis, muscle
        if sign is not None:
            assert np.sign(main[0] * main[2]) == sign, muscle


@pytest.mark.parametrize(("muscle", "axes"), [("OOP", (24.0, 10.0)), ("OOM", (20.4, 4.0))])
def test_rings_run_round_the_mouth(muscle: str, axes: tuple[float, float]) -> None:
    """In a flat closed block, directions are tangents of ellipses with the ring's proportions."""
    flat = block_face(opening=0.0, arch=0.0)
    centres = element_centres(flat["position"].values, flat["connectivity"].values)
    place = centres[elements_of(flat, f"{muscle}_L")]
    owner = flat["muscle"].values[flat["bundle_muscle"].values]
    along = flat["bundle_direction"].values[owner == f"{muscle}_L"]
    normal = place / [axes[0] ** 2, 1.0, axes[1] ** 2] * [1.0, 0.0, 1.0]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    np.testing.assert_allclose(np.einsum("ni,ni->n", along, normal), 0.0, atol=1e-12)
    np.testing.assert_array_equal(along[:, 1], 0.0)
    middle = np.abs(place[:, 0]) < 5e-3
    assert (np.abs(along[middle, 0]) > 0.9).all()
    assert (place[middle, 2] > 0).any() and (place[middle, 2] < 0).any()


def test_ring_elements_lie_on_both_lips_and_beyond_the_corner(block: xr.Dataset) -> None:
    centres = element_centres(block["position"].values, block["connectivity"].values)
    for muscle in ("OOP_L", "OOM_L"):
        place = centres[elements_of(block, muscle)]
        assert place[:, 0].min() < -18e-3
        for lip in (-1.0, 1.0):
            row = place[place[:, 2] * lip > 0]
            # No gap along the lip: neighbouring columns are 3 mm apart.
            assert np.diff(np.unique(row[:, 0].round(6))).max() < 3.1e-3
            assert row[:, 0].max() > -3e-3


def test_lips_are_separate_and_meet_at_the_corners(block: xr.Dataset) -> None:
    connectivity, position = block["connectivity"].values, block["position"].values
    centres = element_centres(position, connectivity)
    upper = np.unique(connectivity[(centres[:, 2] > 0)])
    lower = np.unique(connectivity[(centres[:, 2] < 0)])
    joint = np.intersect1d(upper, lower)
    joint = joint[joint >= 0]
    # Common nodes start at the corner, 18 mm from the middle.
    assert np.abs(position[joint, 0]).min() == pytest.approx(18e-3, abs=1e-15)
    assert len(joint) == 10 * 4
    top, bottom = block["lip_opening_node"].values
    assert position[top, 2] - position[bottom, 2] == pytest.approx(3e-3, abs=1e-15)
    assert np.all(position[[top, bottom], 0] == 0.0)


def test_boundary_is_one_closed_surface(block: xr.Dataset) -> None:
    faces, _ = boundary_faces(block["connectivity"].values)
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    edges, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).all()
    nodes = np.unique(faces)
    n = block.sizes["node"]
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    assert len(np.unique(connected_components(graph, directed=False)[1][nodes])) == 1
    # Euler characteristic 2 - 2 g: the mouth is one hole through the slab, g = 1.
    assert len(nodes) - len(edges) + len(faces) == 0


def test_fixed_nodes(block: xr.Dataset) -> None:
    position, fixed = block["position"].values, block["fixed"].values
    rim = (np.abs(position[:, 0]) == 30e-3) | (np.abs(position[:, 2]) == 25e-3)
    assert (fixed[rim] > 0).all()
    assert (fixed[position[:, 2] > 0] != 1).all() and (fixed[position[:, 2] < 0] != 2).all()
    inner = np.zeros(len(position), dtype=bool)
    inner[sheet_nodes(block, 0)] = True
    assert (fixed[~inner & ~rim] == 0).all()
    lips = inner & (np.abs(position[:, 0]) < 20e-3) & (np.abs(position[:, 2]) < 6e-3)
    assert lips.any() and (fixed[lips] == 0).all()


def test_markers(block: xr.Dataset) -> None:
    position = block["position"].values
    at = dict(zip(LIP_MARKERS, position[block["marker_node"].values], strict=True))
    assert len(np.unique(block["marker_node"].values)) == 10
    skin = sheet_nodes(block, 2)
    assert np.isin(block["marker_node"].values, skin).all()
    for name, place in at.items():
        other = name.replace("left", "*").replace("right", "left").replace("*", "right")
        np.testing.assert_array_equal(place * MIRROR, at[other])
        assert (place[0] < 0) == name.endswith("left")
        assert name.startswith("corner") or (place[2] > 0) == name.startswith("upper")
    assert abs(at["upper_lateral_left"][0]) > abs(at["upper_paramedian_left"][0])


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (1.15, 0.9, 1.05)])
def test_face_markers_lie_on_fixed_nodes(scale: tuple[float, float, float]) -> None:
    face = block_face(scale=scale)
    points = face["face_marker_position"].values
    fixed = face["position"].values[face["fixed"].values == 2]
    assert KDTree(fixed).query(points)[0].max() < 1e-12
    names = list(FACE_MARKERS)
    for name in ("forehead", "temple"):
        left, right = (points[names.index(f"{name}_{side}")] for side in ("left", "right"))
        np.testing.assert_array_equal(left * MIRROR, right)
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    assert extent[1] > 5e-3


def test_scale_stretches_the_geometry_and_keeps_the_topology(block: xr.Dataset) -> None:
    scale = (1.2, 0.9, 1.1)
    scaled = block_face(scale=scale)
    for name in ("position", "fibre_position", "face_marker_position"):
        np.testing.assert_allclose(
            scaled[name].values, block[name].values * scale, rtol=1e-13, atol=1e-18
        )
    for name in ("connectivity", "bundle_index", "bundle_muscle", "marker_node", "fixed"):
        np.testing.assert_array_equal(scaled[name].values, block[name].values)
    ratio = (
        face_report(scaled).summary.loc["volume", "value"]
        / face_report(block).summary.loc["volume", "value"]
    )
    assert ratio == pytest.approx(np.prod(scale), rel=1e-12)


@pytest.mark.parametrize("cells", [(6, 6), (10, 8), (14, 12), (30, 24)])
def test_other_resolutions(cells: tuple[int, int]) -> None:
    face = block_face(cells=cells)
    assert face.sizes["element"] == cells[0] * cells[1] * 3 + 12
    partner(face["position"].values)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cells": (20, 15)}, "expected even numbers of at least 6"),
        ({"cells": (4, 8)}, "expected even numbers of at least 6"),
        ({"size": (0.06, 0.0, 0.05)}, "size of the block is .* three positive numbers"),
        ({"scale": (1.0, float("nan"), 1.0)}, "scale of the block is"),
        ({"opening": -1e-3}, "opening is -0.001 m"),
        ({"radius": 1e-4}, r"muscle \w+_L owns no element"),
        ({"opening": 0.2}, "inverted|outside"),
    ],
)
def test_impossible_blocks(options: dict, message: str) -> None:
    with pytest.raises(FaceError, match=message):
        block_face(**options)
