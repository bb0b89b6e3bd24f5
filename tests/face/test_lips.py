"""Surfaces for contact: closed lips, lining of the mouth, bones of the published face."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from emgface.errors import FaceError
from emgface.face.artisynth_contact import read_obj, read_triangles
from emgface.face.closed import check_closed, open_edges, volume
from emgface.face.file import load_face, save_face
from emgface.face.lips import exposed, lining, lip_surface
from emgface.face.parts import LIPS, MANDIBLE, SKULL, arches_of
from emgface.face.surface import boundary_faces, winding_number
from emgface.face.validity import check_face

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])


@pytest.fixture(scope="module")
def template(coarse: xr.Dataset) -> xr.Dataset:
    return coarse


def test_closed_tetrahedron() -> None:
    check_closed(CORNERS, TETRAHEDRON, "a tetrahedron")
    assert volume(CORNERS, TETRAHEDRON) == pytest.approx(1.0 / 6.0)
    assert len(open_edges(TETRAHEDRON[:3])) == 3


@pytest.mark.parametrize(
    ("triangles", "message"),
    [
        (TETRAHEDRON[1:], "not closed: 3 edges .* between points 0 and 1"),
        (TETRAHEDRON[:, ::-1], "is oriented inwards"),
        (np.concatenate([TETRAHEDRON[:3], TETRAHEDRON[3:, ::-1]]), "not closed: 3 edges"),
        (np.concatenate([TETRAHEDRON, TETRAHEDRON[:1]]), "a triangle twice"),
        (np.concatenate([TETRAHEDRON, [[0, 0, 1]]]), "triangle 4 has no area"),
        (TETRAHEDRON[:0], "no triangles"),
    ],
)
def test_open_surfaces_are_refused(triangles: np.ndarray, message: str) -> None:
    with pytest.raises(FaceError, match=f"the surface of the lid .*{message}"):
        check_closed(CORNERS, triangles, "the lid")


@pytest.mark.parametrize("lip", LIPS)
def test_lips_are_found_from_the_elements(template: xr.Dataset, lip: str) -> None:
    """Orientation, margin, tapered corners and symmetry."""
    X = template["position"].values
    surface = lip_surface(template, lip)
    shown = exposed(template, surface)
    assert 0.4 < shown.mean() < 0.9
    corners = X[surface]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    faces, _ = boundary_faces(template["connectivity"].values)
    within = corners.mean(axis=1) - 1e-4 * normal
    np.testing.assert_allclose(winding_number(within[::9], corners), 1.0, atol=1e-9)
    nodes = np.unique(surface)
    margin = template["lip_opening_node"].values[LIPS.index(lip)]
    assert margin in nodes
    mirrored = {tuple(p) for p in (X[nodes] * [-1.0, 1.0, 1.0] + 0.0).round(9).tolist()}
    assert {tuple(p) for p in (X[nodes] + 0.0).round(9).tolist()} == mirrored
    other = np.unique(lip_surface(template, LIPS[1 - LIPS.index(lip)]))
    assert len(np.intersect1d(nodes, other)) == 0
    half = 0.5 * template.attrs["measure_mouth_width"]
    assert 0.5 * half < np.abs(X[nodes, 0]).max() < 1.2 * half


def test_the_lining_faces_the_teeth(template: xr.Dataset) -> None:
    X, surface = template["position"].values, lining(template)
    corners = X[surface]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = corners.mean(axis=1)
    inner = (middle[:, 1] < np.median(middle[:, 1])) & (np.abs(middle[:, 0]) < 10e-3)
    assert (normal[inner, 1] < 0).mean() > 0.9
    assert exposed(template, surface).all()
    run = np.concatenate([surface[:, [0, 1]], surface[:, [1, 2]], surface[:, [2, 0]]])
    assert len(np.unique(run, axis=0)) == len(run), "no triangle lies over another"


def test_a_face_without_teeth_or_lip(template: xr.Dataset) -> None:
    with pytest.raises(FaceError, match="the face has no teeth, expected dental arches"):
        lining(template.drop_dims(["arch_point", "arch_facet"]))
    with pytest.raises(FaceError, match="unknown lip 'left', expected upper or lower"):
        lip_surface(template, "left")


def test_published_bones_and_lips(reference_face: xr.Dataset, tmp_path: Path) -> None:
    """Counts and volumes of the specification; inner nodes within the shells at rest."""
    face = load_face(save_face(reference_face, tmp_path / "face.nc"))
    X = face["position"].values
    arches = {arch.bone: arch for arch in arches_of(face)}
    for bone, points, triangles, size in ((MANDIBLE, 190, 376, 9809), (SKULL, 288, 572, 7696)):
        arch = arches[bone]
        assert (len(arch.points), len(arch.triangles)) == (points, triangles)
        assert volume(arch.points, arch.triangles) * 1e9 == pytest.approx(size, abs=0.5)
        box = np.array([arch.points.min(axis=0), arch.points.max(axis=0)])
        near = np.flatnonzero(((box[0] < X) & (box[1] > X)).all(axis=1))
        inside = winding_number(X[near], arch.points[arch.triangles]) > 0.5
        free = face["fixed"].values[near] == 0
        assert (inside & free).sum() == 12
    nodes: dict[str, np.ndarray] = {}
    for lip, count, triangles, size, shown in (
        ("lower", 520, 1036, 6852, 720),
        ("upper", 642, 1280, 8397, 904),
    ):
        surface = lip_surface(face, lip)
        nodes[lip] = np.unique(surface)
        assert (len(nodes[lip]), len(surface)) == (count, triangles)
        assert volume(X, surface) * 1e9 == pytest.approx(size, abs=0.5)
        assert exposed(face, surface).sum() == shown
    shared = face["node_id"].values[np.intersect1d(nodes["lower"], nodes["upper"])]
    assert shared.tolist() == [1808, 1809, 1810, 1927, 6200, 6201, 6202, 6315]
    run = lining(face)
    assert exposed(face, run).all()
    # Without stored lip surfaces, those found for the two lips have no node in common.
    bare = face.drop_dims("lip_facet")
    lips = [np.unique(lip_surface(bare, lip)) for lip in LIPS]
    assert len(np.intersect1d(*lips)) == 0 and min(map(len, lips)) > 300


def test_damaged_surfaces_are_located(tmp_path: Path) -> None:
    path = tmp_path / "bone.obj"
    for text, message in (
        ("v 0 0 0\nv 1 0\n", "line 2: found 'v 1 0', expected three numbers"),
        ("v 0 0 0\nf 1 2 3 4\n", "line 2: .*expected three vertices"),
        ("v 0 0 0\nf 1 1 2\n", "line 2: .*expected vertices from 1 to 1"),
        ("v 0 0 0\n", "contains no faces"),
    ):
        path.write_text(text)
        with pytest.raises(FaceError, match=message):
            read_obj(path)
    path.write_text("[ f 1 2 3\n  f 1 2\n]\n")
    with pytest.raises(FaceError, match="line 2: .*expected 'f' and three node ids"):
        read_triangles(path)
    path.write_text("[ f 1 2 3\n  f 3 2 4 ]\n")
    assert read_triangles(path).tolist() == [[1, 2, 3], [3, 2, 4]]


def test_lips_named_upside_down_are_refused(template: xr.Dataset) -> None:
    """Otherwise the opening would be positive after the lips have passed through each other."""
    check_face(template)
    swapped = template.assign(
        lip_opening_node=template["lip_opening_node"].copy(
            data=template["lip_opening_node"].values[::-1]
        )
    )
    with pytest.raises(FaceError, match=r"upper lip .* lies 2.85 mm below .* exchange them"):
        check_face(swapped)
