"""The published reference face: counts and tables of its specification, both folder layouts."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from emgface.errors import FaceError
from emgface.face.artisynth import import_artisynth
from emgface.face.landmarks import ring_of_nodes
from emgface.face.parts import elements_of, fibres_of
from emgface.face.quality import element_centres
from emgface.face.surface import boundary_faces
from emgface.muscles import FACE_MARKERS, LIP_MARKERS, MODELLED, MUSCLES

Import = Callable[..., xr.Dataset]


def table(models: Path, name: str) -> pd.DataFrame:
    return pd.read_csv(models / "face_reference" / "derived" / name)


def checkout(models: Path, folder: Path) -> Path:
    """The layout of the original repository, made of links to the files."""
    refmodel = folder / "src/artisynth/models/face/geometry/refmodel"
    (refmodel / "oop").mkdir(parents=True)
    for file in (models / "face_reference").rglob("*"):
        if file.is_dir() or "derived" in file.parts:
            continue
        place = refmodel / file.relative_to(models / "face_reference")
        if file.name.startswith("atlas_"):
            place = refmodel.parent / file.name
        place.symlink_to(file)
    return folder


def test_muscle_elements_are_those_of_the_published_rule(
    models: Path, imported: Import, reference_face: xr.Dataset
) -> None:
    expected = table(models, "muscle_elements_5mm.csv")
    face = imported(oop="radius", oom="radius")
    for muscle in MUSCLES:
        name, side = muscle.split("_")
        rows = expected[(expected["muscle"] == name.replace("MEN", "MENT"))]
        ids = set(rows["element"][rows["side"] == side])
        assert set(face["element_id"].values[elements_of(face, muscle)]) == ids, muscle
        if name not in ("OOP", "OOM"):
            np.testing.assert_array_equal(
                elements_of(face, muscle), elements_of(reference_face, muscle)
            )


def test_layers_are_those_of_the_published_table(models: Path, reference_face: xr.Dataset) -> None:
    expected = table(models, "elements.csv")
    np.testing.assert_array_equal(reference_face["element_id"].values, expected["element"])
    np.testing.assert_array_equal(
        reference_face["layer"].values, expected["layer_0inner_1centre_2outer"]
    )


@pytest.mark.parametrize(
    ("choice", "count"), [({}, 322), ({"oop": "active"}, 408), ({"oop": "block"}, 420)]
)
def test_hand_made_sets_split_by_side(imported: Import, choice: dict[str, str], count: int) -> None:
    face = imported(**choice)
    centres = element_centres(face["position"].values, face["connectivity"].values)
    for muscle, total in (("OOP", count), ("OOM", 466)):
        left, right = elements_of(face, f"{muscle}_L"), elements_of(face, f"{muscle}_R")
        assert len(left) == len(right) == total // 2
        assert (centres[left, 0] < 0).all() and (centres[right, 0] > 0).all()


def test_hand_made_sets_overlap_as_published(imported: Import, reference_face: xr.Dataset) -> None:
    def whole(face: xr.Dataset, muscle: str) -> set[int]:
        parts = [elements_of(face, f"{muscle}_{side}") for side in "LR"]
        return {int(k) for k in np.concatenate(parts)}

    oom, oldoop = whole(reference_face, "OOM"), whole(reference_face, "OOP")
    active = whole(imported(oop="active"), "OOP")
    assert (len(oom & oldoop), len(oom & active), len(active & oldoop)) == (120, 122, 304)
    layer = reference_face["layer"].values
    assert np.bincount(layer[list(oldoop)]).tolist() == [158, 128, 36]
    assert np.bincount(layer[list(active)]).tolist() == [174, 174, 60]
    assert np.bincount(layer[list(oom)]).tolist() == [176, 182, 108]


def test_fibres_follow_the_published_grouping(models: Path, reference_face: xr.Dataset) -> None:
    expected = table(models, "fibres_left.csv")
    lists = pd.Series(expected["muscle"].replace("MENT", "MEN"))
    for muscle in MODELLED:
        rows = expected[lists == muscle]
        left = fibres_of(reference_face, f"{muscle}_L")
        assert len(left) == rows["fibre"].nunique()
        for fibre, (_, points) in zip(left, rows.groupby("fibre"), strict=True):
            np.testing.assert_allclose(
                fibre, points[["xproj_mm", "yproj_mm", "zproj_mm"]].to_numpy() * 1e-3, atol=1e-7
            )
        for one, other in zip(left, fibres_of(reference_face, f"{muscle}_R"), strict=True):
            # The mesh that points are projected into is symmetric within 0.034 mm.
            np.testing.assert_allclose(other, one * [-1.0, 1.0, 1.0], atol=3.4e-5)


def test_lateral_levator_anguli_oris_alone(models: Path) -> None:
    face = import_artisynth(models, lao_fibres="lateral", oop="radius", oom="radius")
    assert len(fibres_of(face, "LAO_L")) == 1
    assert len(elements_of(face, "LAO_L")) == len(elements_of(face, "LAO_R")) == 29


@pytest.mark.parametrize(
    ("radius", "counts"),
    [
        (
            3e-3,
            dict(ZYG=4, RIS=3, LLSAN=39, LAO=24, BUC=14, OOP=79, OOM=164, DLI=26, DAO=12, MEN=23),
        ),
        (
            6e-3,
            dict(
                ZYG=40, RIS=60, LLSAN=154, LAO=76, BUC=72, OOP=315, OOM=559, DLI=123, DAO=51, MEN=64
            ),
        ),
    ],
)
def test_other_radii(models: Path, radius: float, counts: dict[str, int]) -> None:
    face = import_artisynth(models, radius=radius, oop="radius", oom="radius")
    for side in "LR":
        counted = {muscle: len(elements_of(face, f"{muscle}_{side}")) for muscle in counts}
        assert counted == counts
    distinct = len(np.unique(face["bundle_index"].values))
    assert distinct == {3e-3: 662, 6e-3: 1910}[radius]


def test_elements_and_directions_of_other_muscles_are_mirrored(reference_face: xr.Dataset) -> None:
    centres = element_centres(
        reference_face["position"].values, reference_face["connectivity"].values
    )
    mirror = np.array([-1.0, 1.0, 1.0])
    owner = reference_face["bundle_muscle"].values
    direction = reference_face["bundle_direction"].values
    for k, muscle in enumerate(MUSCLES[:10]):
        left, right = (elements_of(reference_face, f"{muscle[:-2]}_{side}") for side in "LR")
        gap = np.linalg.norm(centres[left][:, None] * mirror - centres[right][None], axis=2)
        partner = gap.argmin(axis=1)
        assert gap.min(axis=1).max() < 3.4e-5
        assert len(np.unique(partner)) == len(right)
        sine = np.linalg.norm(
            np.cross(direction[owner == k] * mirror, direction[owner == k + 10][partner]), axis=1
        )
        # Centres differ by microns, tetrahedra by millimetres.
        assert np.median(sine) < 1e-6


def test_fixed_nodes(reference_face: xr.Dataset) -> None:
    assert np.bincount(reference_face["fixed"].values).tolist() == [7668, 322, 730]


def test_lip_markers(models: Path, reference_face: xr.Dataset) -> None:
    expected = table(models, "lip_markers_proposed.csv").set_index("marker").loc[list(LIP_MARKERS)]
    nodes = reference_face["marker_node"].values
    np.testing.assert_array_equal(reference_face["node_id"].values[nodes], expected["node"])
    np.testing.assert_allclose(
        reference_face["position"].values[nodes],
        expected[["x_mm", "y_mm", "z_mm"]].to_numpy() * 1e-3,
        atol=1e-9,
    )
    assert (reference_face["fixed"].values[nodes] == 0).all()


def test_rings_round_the_mouth(models: Path, reference_face: xr.Dataset) -> None:
    expected = table(models, "lip_ring_nodes.csv")
    faces, _ = boundary_faces(reference_face["connectivity"].values)
    outer = np.unique(_skin(reference_face, faces))
    ring = ring_of_nodes(
        reference_face["position"].values, reference_face["connectivity"].values, outer, 1807
    )
    np.testing.assert_array_equal(ring[expected["node"].to_numpy() - 1], expected["ring"])
    sizes = np.bincount(ring[ring >= 0])[:11].tolist()
    assert sizes == [50, 52, 52, 52, 54, 54, 56, 56, 54, 52, 56]
    for offset in (-1, 1):
        moved = import_artisynth(models, marker_ring_offset=offset)["marker_node"].values
        before = reference_face["marker_node"].values
        np.testing.assert_array_equal(ring[moved], ring[before] + offset)
    with pytest.raises(FaceError, match="no ring -1"):
        import_artisynth(models, marker_ring_offset=-4)


def _skin(face: xr.Dataset, faces: np.ndarray) -> np.ndarray:
    """Nodes of outer elements that belong to no other layer."""
    connectivity, layer = face["connectivity"].values, face["layer"].values
    outer = connectivity[layer == 2]
    rest = connectivity[layer != 2]
    return np.setdiff1d(outer[outer >= 0], rest[rest >= 0])


def test_face_markers_are_rigid_skin_and_symmetric(reference_face: xr.Dataset) -> None:
    markers = reference_face["face_marker_position"]
    assert tuple(markers["face_marker"].values) == FACE_MARKERS
    at = {name: markers.sel(face_marker=name).values for name in FACE_MARKERS}
    for name in ("forehead", "temple"):
        np.testing.assert_array_equal(at[f"{name}_left"] * [-1, 1, 1], at[f"{name}_right"])
        assert at[f"{name}_left"][0] < 0
    assert at["nasion"][2] > at["rhinion"][2]
    assert at["forehead_left"][2] > at["nasion"][2] > reference_face["position"].values[1075, 2]
    # A rotation is determined only if the points span a plane well.
    extent = np.linalg.svd(markers.values - markers.values.mean(axis=0), compute_uv=False)
    assert extent[1] > 0.02


def test_lip_opening_nodes(reference_face: xr.Dataset) -> None:
    nodes = reference_face["lip_opening_node"].values
    z = reference_face["position"].values[nodes, 2] * 1e3
    assert z == pytest.approx([-80.9, -84.9], abs=0.05)


def test_both_layouts_give_the_same_face(
    models: Path, reference_face: xr.Dataset, tmp_path: Path
) -> None:
    root = checkout(models, tmp_path)
    refmodel = root / "src/artisynth/models/face/geometry/refmodel"
    for folder in (root, refmodel):
        xr.testing.assert_identical(import_artisynth(folder), reference_face)


def test_absent_file_is_named_with_the_places_searched(models: Path, tmp_path: Path) -> None:
    root = checkout(models, tmp_path)
    refmodel = root / "src/artisynth/models/face/geometry/refmodel"
    (refmodel / "muscles.node").unlink()
    with pytest.raises(FaceError, match=r"muscles\.node .*not found in .*refmodel"):
        import_artisynth(root)
    with pytest.raises(FaceError, match="no folder"):
        import_artisynth(tmp_path / "absent")
    with pytest.raises(FaceError, match="oop is 'oldop', expected one of oldoop, active"):
        import_artisynth(models, oop="oldop")  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("name", "line", "message"),
    [
        ("newface.elem", 6342, r"newface\.elem, line 6342: .*truncated"),
        ("newface.node", 8720, r"newface\.node, line 8720: "),
        ("newface.node", 1206, r"node 1206 is not in the (node list|mesh)"),
        ("muscles.node", 100, r"muscle point \d+ is absent"),
    ],
)
def test_damaged_files(models: Path, tmp_path: Path, name: str, line: int, message: str) -> None:
    root = checkout(models, tmp_path)
    place = root / "src/artisynth/models/face/geometry/refmodel" / name
    lines = (models / "face_reference" / name).read_text().splitlines()
    place.unlink()
    if line == len(lines):
        lines[-1] = lines[-1][:52]
    else:
        del lines[line - 1]
    place.write_text("\n".join(lines) + "\n")
    with pytest.raises(FaceError, match=message):
        import_artisynth(root)


def test_inverted_element_is_named(models: Path, tmp_path: Path) -> None:
    root = checkout(models, tmp_path)
    place = root / "src/artisynth/models/face/geometry/refmodel/newface.elem"
    lines = place.read_text().splitlines()
    row = lines[99]
    assert int(row[78:]) == 100
    lines[99] = row[24:48] + row[:24] + row[48:]
    place.unlink()
    place.write_text("\n".join(lines) + "\n")
    with pytest.raises(FaceError, match=r"element 100 is inverted at rest: .* determinant is -"):
        import_artisynth(root)


def test_too_small_a_radius_leaves_a_muscle_empty(models: Path) -> None:
    with pytest.raises(FaceError, match=r"muscle \w+_L has no element"):
        import_artisynth(models, radius=1e-4)


def test_a_copy_gives_the_same_face_and_is_unchanged_by_an_import(
    models: Path, reference_face: xr.Dataset, tmp_path: Path
) -> None:
    copy = tmp_path / "face_reference"
    shutil.copytree(models / "face_reference", copy, ignore=shutil.ignore_patterns("derived"))
    before = {file: file.stat().st_mtime_ns for file in copy.rglob("*")}
    xr.testing.assert_identical(import_artisynth(copy), reference_face)
    assert {file: file.stat().st_mtime_ns for file in copy.rglob("*")} == before
