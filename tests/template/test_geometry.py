"""Grid, quality, topology, symmetry and attachments of the template."""

import numpy as np
import pytest
import xarray as xr
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from emgface.errors import FaceError
from emgface.face.check import face_report, sheet_nodes
from emgface.face.file import load_face, save_face
from emgface.face.landmarks import ring_of_nodes
from emgface.face.parts import FREE, INNER, MANDIBLE, OUTER, SKULL
from emgface.face.quality import element_quality
from emgface.face.surface import boundary_faces
from emgface.face.template import GROUP_PRESETS, preset_measures, random_measures, template_face
from emgface.face.template.build import node_positions, shaped_positions
from emgface.face.template.calibrate import calibrated_surfaces
from emgface.face.template.grid import FACE_RESOLUTIONS, RAYS_PER_STEP, make_grid, refined_grid
from emgface.muscles import FACE_MARKERS, LIP_MARKERS
from tests.template.conftest import sheets

MIRROR = np.array([-1.0, 1.0, 1.0])


@pytest.mark.parametrize("resolution", [*FACE_RESOLUTIONS, 450, 1200, 20_000])
def test_number_of_elements(resolution: str | int) -> None:
    grid = make_grid(resolution)
    wanted = FACE_RESOLUTIONS[resolution] if isinstance(resolution, str) else resolution
    assert len(grid.connectivity) == pytest.approx(wanted, rel=0.12)
    assert grid.rays % RAYS_PER_STEP == 0
    if isinstance(resolution, str):
        assert len(grid.connectivity) == wanted


def test_refined_grids_are_nested_in_proportion() -> None:
    first = refined_grid(1)
    for k in (2, 5):
        grid = refined_grid(k)
        assert len(grid.connectivity) == k**2 * len(first.connectivity)
        np.testing.assert_allclose(grid.s[::k], first.s, atol=1e-15)
        np.testing.assert_allclose(grid.left_rays[0][::k], first.left_rays[0], atol=1e-15)
    with pytest.raises(FaceError, match="the refinement of the grid is 0, expected a number >= 1"):
        refined_grid(0)


@pytest.mark.parametrize("resolution", ["finest", 100, 10**7])
def test_impossible_resolutions(resolution: str | int) -> None:
    with pytest.raises(FaceError, match=f"the resolution is .*{resolution}"):
        template_face(resolution=resolution)


@pytest.mark.parametrize(("name", "floor"), [("coarse", 0.25), ("medium", 0.25), ("fine", 0.25)])
def test_quality(name: str, floor: float, request: pytest.FixtureRequest) -> None:
    """Far above the 0.011 of the published mesh and the required 0.1."""
    face = request.getfixturevalue(name)
    quality = element_quality(face["position"].values, face["connectivity"].values)
    assert quality.smallest_det.min() > 0
    assert quality.scaled_jacobian.min() > floor
    assert np.median(quality.scaled_jacobian) > 0.8
    # The skin of a coarse cheek is 1.5 mm thick and its cells 30 mm long.
    assert face_report(face).summary.loc["largest edge ratio", "value"] < 25


def test_volume_converges(coarse: xr.Dataset, medium: xr.Dataset, fine: xr.Dataset) -> None:
    """Chords of a curved surface lose volume with the square of the element size."""
    volume = [
        element_quality(face["position"].values, face["connectivity"].values).volume.sum()
        for face in (coarse, medium, fine)
    ]
    assert volume[0] < volume[1] < volume[2]
    assert volume[2] == pytest.approx(volume[1], rel=0.01)


def test_layers_are_sheets(coarse: xr.Dataset) -> None:
    layer = coarse["layer"].values
    assert np.bincount(layer).tolist() == [192, 192, 192]
    last = sheets(coarse).shape[2] - 1
    number = np.arange(coarse.sizes["node"]).reshape(sheets(coarse).shape[:3])
    np.testing.assert_array_equal(np.sort(sheet_nodes(coarse, INNER)), number[..., 0].ravel())
    np.testing.assert_array_equal(np.sort(sheet_nodes(coarse, OUTER)), number[..., last].ravel())


def test_boundary_is_one_closed_surface_with_one_hole(coarse: xr.Dataset) -> None:
    faces, _ = boundary_faces(coarse["connectivity"].values)
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).all()
    nodes = np.unique(faces)
    n = coarse.sizes["node"]
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    assert len(np.unique(connected_components(graph, directed=False)[1][nodes])) == 1
    assert len(nodes) - len(edges) + len(faces) == 0


def test_rings_surround_the_mouth(medium: xr.Dataset) -> None:
    """The ring found by edge distance from the margin is the ring of the grid."""
    position, connectivity = medium["position"].values, medium["connectivity"].values
    skin = sheet_nodes(medium, OUTER)
    rim = int(medium["lip_opening_node"].values[0])
    ring = ring_of_nodes(position, connectivity, skin, rim)
    rays, rings = medium.attrs["rays"], medium.attrs["rings"]
    expected = np.broadcast_to(np.arange(rings + 1)[None, :], (rays, rings + 1))
    np.testing.assert_array_equal(ring.reshape(rays, rings + 1, 4)[:, :, 3], expected)


def test_lips_are_apart(fine: xr.Dataset) -> None:
    """At every ray of the slit the upper margin is above the lower one, on all sheets."""
    place = sheets(fine)
    quarter, half = len(place) // 4, len(place) // 2
    upper, lower = place[:quarter, 0], place[half:quarter:-1, 0]
    assert (upper[..., 2] > lower[..., 2]).all()
    np.testing.assert_allclose(upper[..., 0], lower[..., 0], atol=0.4e-3)


def test_mesh_mirrors_bit_by_bit(medium: xr.Dataset) -> None:
    grid = make_grid("medium")
    position, image = medium["position"].values, grid.mirror_node
    np.testing.assert_array_equal(position[image] * MIRROR, position)
    np.testing.assert_array_equal(medium["fixed"].values[image], medium["fixed"].values)
    np.testing.assert_array_equal(image[image], np.arange(len(image)))
    rows = [frozenset(row) for row in grid.connectivity.tolist()]
    mirrored = [frozenset(row) for row in image[grid.connectivity].tolist()]
    assert [rows[k] for k in grid.mirror_element] == mirrored
    np.testing.assert_array_equal(grid.layer[grid.mirror_element], grid.layer)


def test_landmarks_are_in_anatomical_order(fine: xr.Dataset) -> None:
    """Order of the landmarks of a profile from the front and from the side."""
    skin = sheets(fine)[:, :, 3]
    upper, lower = skin[0], skin[len(skin) // 2]
    nose = upper[np.argmax(upper[:, 1])]
    grid = make_grid("fine")
    border, base = grid.rings[0], sum(grid.rings[:2])
    lip_top, subnasale, nasion = upper[:border, 1].max(), upper[base], upper[-1]
    lip_low, sulcus = lower[:border, 1].max(), lower[base]
    chin = lower[base:][np.argmax(lower[base:, 1])]
    assert nose[1] - subnasale[1] > 14e-3 and subnasale[2] < nose[2] < nasion[2] - 30e-3
    assert nose[1] > lip_top > lip_low > chin[1] > sulcus[1]
    assert nasion[1] < subnasale[1]
    assert lower[-1, 1] < chin[1] - 25e-3, "the skin turns under the chin"
    # The sides of the face are behind its middle.
    assert skin[..., 1].min() < 25e-3 < 95e-3 < subnasale[1]
    # Cupid's bow: the vermilion border is higher lateral to the midline than on it.
    rays = np.arange(len(skin) // 8)
    bow = skin[rays, border, 2]
    assert 1 < np.argmax(bow) < 8 and bow.max() - bow[0] > 0.3e-3


def test_attachments(medium: xr.Dataset) -> None:
    place = sheets(medium)
    fixed = medium["fixed"].values.reshape(place.shape[:3])
    assert (fixed[:, -1] != FREE).all(), "the rim is held"
    assert (fixed[:, :-1, 1:] == FREE).all(), "inside the rim only the inner sheet is"
    inner, bone = place[:, :-1, 0], fixed[:, :-1, 0]
    grid = make_grid("medium")
    lips = bone[:, : grid.rings[0] + 1]
    assert (lips == FREE).all()
    assert (bone[:, -2] != FREE).mean() > 0.9
    assert (inner[bone == SKULL][:, 2] > 0).all()
    midline = np.abs(place[..., 0]) < 20e-3
    assert (place[midline & (fixed == MANDIBLE)][:, 2] < 0).all()
    # Fornix and cheek: bone begins at the root of the lip in the midline, far out at the corner.
    first = [int(np.argmax(bone[ray] != FREE)) for ray in (0, grid.rays // 2, grid.rays // 4)]
    assert 0.010 < inner[0, first[0], 2] < 0.025
    assert 0.010 < -inner[grid.rays // 2, first[1], 2] < 0.025
    assert -inner[grid.rays // 4, first[2], 0] > 45e-3


def test_markers(medium: xr.Dataset) -> None:
    at = dict(
        zip(LIP_MARKERS, medium["position"].values[medium["marker_node"].values], strict=True)
    )
    assert len(np.unique(medium["marker_node"].values)) == len(LIP_MARKERS)
    for name, point in at.items():
        other = name.replace("left", "*").replace("right", "left").replace("*", "right")
        np.testing.assert_array_equal(point * MIRROR, at[other])
        assert (point[0] < 0) == name.endswith("left")
        assert name.startswith("corner") or (point[2] > 0) == name.startswith("upper")
    half = 0.5 * medium.attrs["measure_mouth_width"]
    assert abs(at["corner_left"][0]) == pytest.approx(half + 3.5e-3, abs=1.5e-3)
    assert 0.15 < abs(at["upper_paramedian_left"][0]) / half < 0.45
    assert 0.55 < abs(at["upper_lateral_left"][0]) / half < 0.9
    points = dict(zip(FACE_MARKERS, medium["face_marker_position"].values, strict=True))
    assert points["nasion"][0] == points["rhinion"][0] == 0.0
    assert points["nasion"][2] > points["rhinion"][2] > 0.04
    assert points["rhinion"][1] > points["nasion"][1]
    assert points["forehead_left"][2] > points["nasion"][2]
    assert points["temple_left"][0] < -0.05 and points["temple_left"][1] < points["nasion"][1]
    for name in ("forehead", "temple"):
        left, right = points[f"{name}_left"], points[f"{name}_right"]
        np.testing.assert_array_equal(left * MIRROR, right)


def test_markers_stay_where_they_are_at_every_resolution(
    coarse: xr.Dataset, medium: xr.Dataset, fine: xr.Dataset
) -> None:
    one = coarse["position"].values[coarse["marker_node"].values]
    for other in (medium, fine):
        points = other["position"].values[other["marker_node"].values]
        np.testing.assert_allclose(points, one, atol=1e-9)


def test_sides_can_differ(coarse: xr.Dataset) -> None:
    even = coarse
    odd = template_face(resolution="coarse", measures={"width_asymmetry": 0.1, "droop": 4e-3})
    at = dict(zip(LIP_MARKERS, odd["position"].values[odd["marker_node"].values], strict=True))
    was = dict(zip(LIP_MARKERS, even["position"].values[even["marker_node"].values], strict=True))
    assert at["corner_right"][0] > was["corner_right"][0]
    assert at["corner_left"][0] > was["corner_left"][0]
    width = at["corner_right"][0] + at["corner_left"][0]
    assert width / was["corner_right"][0] == pytest.approx(0.1, abs=0.02)
    lower = at["corner_right"][2] - at["corner_left"][2]
    assert lower == pytest.approx(4e-3, abs=1e-3)
    np.testing.assert_array_equal(odd["connectivity"].values, even["connectivity"].values)
    turned = np.einsum("ij,ij->i", odd["bundle_direction"].values, even["bundle_direction"].values)
    assert 0.8 < turned.min() < 1 - 1e-4


def test_file_round_trip(tmp_path) -> None:
    made = template_face(resolution="coarse")
    xr.testing.assert_identical(load_face(save_face(made, tmp_path / "face.nc")), made)


@pytest.mark.parametrize("preset", GROUP_PRESETS)
@pytest.mark.parametrize("resolution", ["coarse", "fine"])
def test_presets_have_valid_elements(preset: str, resolution: str) -> None:
    grid = make_grid(resolution)
    position = node_positions(calibrated_surfaces(preset_measures(preset)), grid)
    quality = element_quality(position, grid.connectivity)
    assert quality.smallest_det.min() > 0
    assert quality.scaled_jacobian.min() > 0.2


@pytest.mark.parametrize(("resolution", "n"), [("coarse", 7), ("fine", 7)])
def test_volunteers_have_valid_elements(resolution: str, n: int) -> None:
    """A sample of the thousand faces of `docs/template/make.py volunteers`."""
    grid = make_grid(resolution)
    worst = np.empty(n)
    for k in range(n):
        preset = list(GROUP_PRESETS)[k % len(GROUP_PRESETS)]
        position = shaped_positions(random_measures(k, preset=preset, asymmetry=1.0), grid)
        quality = element_quality(position, grid.connectivity)
        assert quality.smallest_det.min() > 0, (k, preset)
        worst[k] = quality.scaled_jacobian.min()
    assert worst.min() > 0.1
    assert np.median(worst) > 0.25
