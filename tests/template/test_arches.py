"""Dental arches and named surfaces of the lips: shape, symmetry, distance from tissue at rest."""

import numpy as np
import pytest
import xarray as xr

from emgface.errors import DataError, FaceError
from emgface.face.closed import check_closed
from emgface.face.file import load_face, save_face
from emgface.face.parts import MANDIBLE, SKULL, Arch, arches_of, facets_of
from emgface.face.penetration import Penetration
from emgface.face.surface import boundary_faces, triangles, winding_number
from emgface.face.template import Measures, dental_arches, random_measures, template_face
from emgface.face.template.arches import CLEARANCE, EXPOSURE, OVERBITE, OVERJET
from tests.template.conftest import sheets

MIRROR = np.array([-1.0, 1.0, 1.0])


def normals(arch: Arch) -> np.ndarray:
    corners = arch.points[arch.triangles]
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


@pytest.mark.parametrize("bone", [SKULL, MANDIBLE])
def test_arch(bone: int) -> None:
    arch = next(a for a in dental_arches(Measures()) if a.bone == bone)
    normal, middle = normals(arch), arch.points[arch.triangles].mean(axis=1)
    assert (np.linalg.norm(normal, axis=1) > 0).all()
    # The wall without the strip behind the incisal edge.
    sign = 1 if bone == SKULL else -1
    edge = sign * (sign * arch.points[:, 2]).min()
    wall = sign * (middle[:, 2] - edge) > 1.5e-3
    # The first intersection of a ray along -y is with the front, of a lateral ray with the outer
    # wall.
    front = wall & (np.abs(middle[:, 0]) < 10e-3) & (normal[:, 1] > 0)
    back = wall & (np.abs(middle[:, 0]) < 10e-3) & (normal[:, 1] < 0)
    assert front.sum() > 50 and back.sum() > 50
    assert middle[front, 1].mean() - middle[back, 1].mean() > 2e-3, "the front faces forward"
    lateral = wall & (middle[:, 0] > 20e-3)
    outer = lateral & (normal[:, 0] > 0)
    widest = [middle[side, 0].max() for side in (outer, lateral & ~outer)]
    assert widest[0] - widest[1] > 1e-3, "to the cheeks"
    rows = {tuple(point) for point in arch.points.tolist()}
    assert rows == {(-x if x else x, y, z) for x, y, z in arch.points.tolist()}
    # triangles are also mirrored, so that sliding is symmetric
    corners = arch.points[arch.triangles] + 0.0
    faces, images = (
        {frozenset(map(tuple, face)) for face in (each + 0.0).tolist()}
        for each in (corners, corners * MIRROR)
    )
    assert faces == images and len(faces) == len(arch.triangles)
    # Sizes of published casts: 45 to 60 mm between the outer faces of the molars, 22 to 34 mm deep.
    assert 45e-3 < np.ptp(arch.points[:, 0]) < 60e-3
    at_edge = sign * (arch.points[:, 2] - edge) < 1e-3
    assert 22e-3 < np.ptp(arch.points[at_edge, 1]) < 36e-3


@pytest.mark.parametrize("seed", [None, 3])
@pytest.mark.parametrize("bone", [SKULL, MANDIBLE])
def test_an_arch_is_a_closed_body(bone: int, seed: int | None) -> None:
    """Points just inside every triangle are inside, points just outside are outside."""
    measures = Measures() if seed is None else random_measures(seed)
    arch = next(a for a in dental_arches(measures) if a.bone == bone)
    check_closed(arch.points, arch.triangles, "an arch")
    corners = arch.points[arch.triangles][::7]
    normal = normals(arch)[::7]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    for side, inside in ((-1, 1.0), (1, 0.0)):
        points = corners.mean(axis=1) + side * 1e-4 * normal
        winding = winding_number(points, arch.points[arch.triangles])
        np.testing.assert_allclose(winding, inside, atol=1e-9)


def test_the_upper_incisors_stand_before_and_over_the_lower() -> None:
    m = Measures()
    upper, lower = dental_arches(m)
    assert upper.points[:, 2].min() == pytest.approx(0.5 * m.lip_gap - EXPOSURE)
    top = lower.points[:, 2].max()
    assert top == pytest.approx(upper.points[:, 2].min() + OVERBITE)
    edges = (upper.points[:, 2].min(), top)
    front = [
        a.points[(np.abs(a.points[:, 0]) < 1e-9) & (a.points[:, 2] == z), 1].max()
        for a, z in zip((upper, lower), edges, strict=True)
    ]
    assert front[0] - front[1] == pytest.approx(OVERJET, abs=0.2e-3)


@pytest.mark.parametrize("seed", [None, 17])
def test_arches_touch_nothing_at_rest(seed: int | None) -> None:
    """No point of an arch is inside the tissue or closer to its nodes than half the clearance."""
    measures = Measures() if seed is None else random_measures(seed)
    face = template_face(resolution="medium", measures=measures)
    position = face["position"].values
    faces, _ = boundary_faces(face["connectivity"].values)
    surface = position[triangles(faces, position)]
    for arch in arches_of(face):
        assert np.abs(winding_number(arch.points[::4], surface)).max() < 0.5
        gap = np.linalg.norm(arch.points[:, None] - position[None], axis=2).min(axis=1)
        assert gap.min() > 0.5 * CLEARANCE


@pytest.mark.parametrize("asymmetry", [0.0, 1.0])
def test_lips_and_corners_rest_on_the_teeth(asymmetry: float) -> None:
    """Their lining is within 2 mm of an arch, and not inside it."""
    face = template_face(resolution="coarse", measures=random_measures(2, asymmetry=asymmetry))
    inner = sheets(face)[:, : 1 + 1, 0]  # the two rings of the vermilion
    inner = inner[np.abs(inner[..., 2]) > 1e-3]  # margins are curved away
    points = np.concatenate([a.points[a.triangles].mean(axis=1) for a in arches_of(face)])
    points = np.concatenate([points, *(a.points for a in arches_of(face))])
    gap = np.linalg.norm(inner[:, None] - points[None], axis=2).min(axis=1)
    assert np.quantile(gap, 0.9) < 3e-3
    assert Penetration(face).at_rest() == {"maxilla": (0, 0.0), "mandible": (0, 0.0)}


def test_clearance() -> None:
    near, far = (dental_arches(Measures(), clearance=c)[0].points for c in (0.0, 1e-3))
    assert ((near - far)[:, 1] > -1e-12).all() and (near - far)[:, 1].max() == pytest.approx(1e-3)
    with pytest.raises(FaceError, match="the clearance of the teeth is -0.001 m"):
        dental_arches(Measures(), clearance=-1e-3)


def test_arches_and_surfaces_are_part_of_the_face(coarse: xr.Dataset, tmp_path) -> None:
    read = load_face(save_face(coarse, tmp_path / "face.nc"))
    for stored, made in zip(arches_of(read), dental_arches(Measures()), strict=True):
        assert stored.bone == made.bone
        np.testing.assert_array_equal(stored.points, made.points)
        np.testing.assert_array_equal(stored.triangles, made.triangles)
    np.testing.assert_array_equal(
        facets_of(read, "upper_lip_margin"), facets_of(coarse, "upper_lip_margin")
    )


def facet_normals(face: xr.Dataset, surface: str) -> tuple[np.ndarray, np.ndarray]:
    corners = face["position"].values[facets_of(face, surface)]
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    return normal / np.linalg.norm(normal, axis=1)[:, None], corners.mean(axis=1)


def test_lip_surfaces(medium: xr.Dataset) -> None:
    """Orientation of margins, linings and vermilion of the lips, and symmetry."""
    rays = medium.attrs["rays"]
    for lip, sign in (("upper", 1), ("lower", -1)):
        normal, middle = facet_normals(medium, f"{lip}_lip_margin")
        assert len(normal) == 3 * rays // 2
        near = np.abs(middle[:, 0]) < 15e-3
        assert (sign * normal[near, 2] < 0).all() and (sign * middle[near, 2] > 0).all()
        normal, middle = facet_normals(medium, f"{lip}_lip_inner")
        assert (normal[np.abs(middle[:, 0]) < 12e-3, 1] < 0).all()
        normal, middle = facet_normals(medium, f"{lip}_lip_vermilion")
        assert (normal[np.abs(middle[:, 0]) < 12e-3, 1] > 0).all()
        assert np.abs(middle[:, 0]).max() < 0.5 * medium.attrs["measure_mouth_width"]
    margin = set(facets_of(medium, "upper_lip_margin").ravel().tolist())
    assert margin <= set(np.arange(sheets(medium)[..., 0].size).reshape(rays, -1, 4)[:, 0].ravel())
    every = [facets_of(medium, str(name)) for name in medium["surface"].values]
    flat = np.sort(np.concatenate(every), axis=1)
    assert len(np.unique(flat, axis=0)) == len(flat), "no facet belongs to two surfaces"
    for nodes in every:
        points = medium["position"].values[nodes].mean(axis=1).round(9)
        mirrored = {tuple(p) for p in (points * MIRROR + 0.0).tolist()}
        assert {tuple(p) for p in (points + 0.0).tolist()} == mirrored


def test_unknown_surface(coarse: xr.Dataset) -> None:
    with pytest.raises(
        DataError, match="unknown surface 'tongue': expected one of upper_lip_inner"
    ):
        facets_of(coarse, "tongue")
    plain = coarse.drop_dims(["facet", "surface", "arch_point", "arch_facet"])
    assert arches_of(plain) == []
    with pytest.raises(DataError, match="unknown surface 'skin': expected one of none"):
        facets_of(plain, "skin")
