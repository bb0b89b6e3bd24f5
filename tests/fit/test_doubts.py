"""Doubts about landmarks reach a user of the function as they reach one of the command."""

import re
import warnings

import pytest
from scipy.spatial.transform import Rotation

import emgface as ef
from emgface.errors import FitError, FitWarning
from emgface.fit.inputs import points_of_face
from emgface.fit.targets import sheets

SIX = "corner_left", "corner_right", "forehead_left", "temple_right", "nasion", "pronasale"

LIPS = re.compile("corner|upper|lower|stomion")


def doubts_text(face, landmarks, **surfaces) -> str:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ef.fit(face, landmarks=landmarks, **surfaces)
    return " ".join(str(one.message) for one in caught if one.category is FitWarning)


@pytest.fixture(scope="module")
def face():
    return ef.face(resolution="coarse")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda p: p | {"nose tip": p["pronasale"]}, "were ignored: nose_tip"),
        (lambda p: {k: 1.5 * v for k, v in p.items()}, "1.5 times as far apart"),
        (lambda p: {k: 0.7 * v for k, v in p.items()}, "0.7 times as far apart"),
        (
            lambda p: {k: v * [1.0, 1.0, 1.25] for k, v in p.items()},
            "check the spacing of the slices",
        ),
        (
            lambda p: {k: v * [1.0, 0.8, 1.0] for k, v in p.items()},
            "25 % smaller against the other",
        ),
        (lambda p: {k: p[k] for k in SIX}, "with 6 landmarks"),
        (lambda p: {k: v for k, v in p.items() if LIPS.match(k)}, "shape is extrapolated"),
    ],
)
def test_doubtful_landmarks_are_warned_of(face, change, expected):
    assert expected in doubts_text(face, change(points_of_face(face)))


@pytest.mark.parametrize("scale", [0.8, 1.0, 1.3])
def test_landmarks_of_children_and_adults_are_not_doubted(face, scale):
    assert doubts_text(face, {k: scale * v for k, v in points_of_face(face).items()}) == ""


@pytest.fixture(scope="module")
def surfaces(face):
    nodes = face["position"].values
    return {name: (nodes, sheet.triangles) for name, sheet in sheets(face).items()}


def test_a_scan_in_another_pose_than_its_landmarks_is_doubted(face, surfaces):
    points, triangles = surfaces["skin"]
    marks, middle = points_of_face(face), points.mean(axis=0)
    assert doubts_text(face, marks, skin=surfaces["skin"]) == ""
    turn = Rotation.from_rotvec([0.17, 0.0, 0.0]).as_matrix()
    turned = (points - middle) @ turn.T + middle
    assert "same scan and pose" in doubts_text(face, marks, skin=(turned, triangles))


@pytest.mark.parametrize("kind", ["inner", "bone"])
def test_the_skin_is_refused_as_a_surface_beneath_it(face, surfaces, kind):
    with pytest.raises(FitError, match=f"given as {kind}; expected at least 2 mm of soft tissue"):
        ef.fit(face, landmarks=points_of_face(face), **{kind: surfaces["skin"]})


@pytest.mark.parametrize("kind", ["inner", "bone"])
@pytest.mark.parametrize("turned", [False, True])
def test_bone_and_inner_surface_are_reported_apart_by_their_sides(face, surfaces, kind, turned):
    """Bone given as inner moved the inner surface by 3 mm, silently: its triangles face the tissue."""
    points, triangles = surfaces["inner"]
    outward = triangles if kind == "inner" else triangles[:, ::-1]
    scan = points, outward[:, ::-1] if turned else outward
    said = doubts_text(face, points_of_face(face), skin=surfaces["skin"], **{kind: scan})
    assert (f"given as {kind}, face the other way" in said) == turned
    assert bool(said) == turned


def test_complex_points_are_refused(face, surfaces):
    marks = points_of_face(face)
    with pytest.raises(FitError, match="complex"):
        ef.fit(face, landmarks={name: p + 0j for name, p in marks.items()})
    points, triangles = surfaces["skin"]
    with pytest.raises(FitError, match="complex"):
        ef.fit(face, landmarks=marks, skin=(points + 0j, triangles))
