"""Scans in another pose and of an unexpected shape are reported, sound ones are not; tips of faces."""

import re

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from benchmarks.fit_ends import DOUBTED, NEAR, apart, end_of, judged
from benchmarks.fit_inputs import cropped, damaged, other_pose, person_of, self_intersection
from emgface.errors import FitError
from emgface.face.artisynth import import_artisynth
from emgface.face.parts import FREE
from emgface.face.template import template_face
from emgface.fit.carry import carry
from emgface.fit.inputs import points_of_face
from emgface.fit.loops import length
from emgface.fit.person import compared_inputs, fit_face, scan_of
from emgface.fit.places import (
    check_landmarks_on,
    missed_landmarks,
    second_layer,
    uncovered_points,
    unexpected_part,
)
from emgface.fit.readers.landmarks import landmarks_of
from emgface.fit.similarity import GROWTH
from emgface.fit.strays import spread_of_spline
from emgface.fit.targets import LandmarkPoints, Target, sheets
from emgface.fit.triangulated import Surface

NOISE = 0.8e-3


@pytest.fixture(scope="module")
def face():
    return template_face(resolution="medium")


def landmarks(face, noise=0.0, seed=0) -> LandmarkPoints:
    points = points_of_face(face)
    there = np.array(list(points.values()))
    given = there + noise * np.random.default_rng(seed).standard_normal(there.shape)
    near = (skin := sheets(face)["skin"].at(face["position"].values)).nearest(there)
    return LandmarkPoints(
        tuple(points), there, given, skin.triangles[near.triangle], near.weights,
        there - near.foot, near.distance < 0.012,
    )  # fmt: skip


@pytest.mark.parametrize("shift", [(3.7, 0, 0), (0, 3.0, 0), (0, 0, 6.0), (2.0, 2.0, -2.0)])
def test_a_scan_that_was_moved_by_millimetres_is_doubted(face, shift):
    skin = sheets(face)["skin"].at(face["position"].values)
    moved = Surface(skin.points + 1e-3 * np.array(shift), skin.triangles)
    sentence = check_landmarks_on(moved, landmarks(face, NOISE), "scan.ply", NOISE)
    assert sentence is not None and "common motion" in sentence


def test_landmarks_with_their_noise_are_not_doubted(face):
    skin = sheets(face)["skin"].at(face["position"].values)
    for seed in range(40):
        assert check_landmarks_on(skin, landmarks(face, NOISE, seed), "scan.ply", NOISE) is None


def test_one_landmark_off_the_scan_is_no_motion(face):
    skin, points = sheets(face)["skin"].at(face["position"].values), landmarks(face, NOISE)
    points.target[points.names.index("pronasale")] += [0.0, 8e-3, 0.0]
    assert check_landmarks_on(skin, points, "scan.ply", NOISE) is None


@pytest.mark.parametrize("change", ["stretched", "ends", "moved"])
def test_all_landmarks_off_a_surface_are_named_with_what_to_try(face, change):
    """One landmark alone was named, and blamed, for a file with a wrong spacing or a part of a scan."""
    skin, points = sheets(face)["skin"].at(face["position"].values), landmarks(face, NOISE)
    middle = skin.points.mean(axis=0)
    if change == "stretched":
        skin = Surface((skin.points - middle) * [1.5, 1.0, 1.0] + middle, skin.triangles)
    elif change == "ends":
        below = (skin.points[skin.triangles][:, :, 2] < middle[2]).all(axis=1)
        skin = Surface(skin.points, skin.triangles[below])
    else:
        skin = Surface(skin.points + [0.0, 0.06, 0.0], skin.triangles)
    with pytest.raises(FitError) as refusal:
        check_landmarks_on(skin, points, "scan.ply", NOISE)
    sentence, near = str(refusal.value), skin.nearest(points.target)
    off = [points.names[k] for k in np.flatnonzero(points.on_skin & (near.distance > 0.012))]
    assert f"{len(off)} of {int(points.on_skin.sum())} landmarks lie off scan.ply" in sentence
    assert sum(name in sentence for name in off) >= min(len(off), 4) and len(off) > 1
    assert ("frame (LPS or RAS)" if change == "moved" else "spacing") in sentence


def test_the_spread_of_a_spline_is_that_of_drawn_shapes():
    """One dimension: between points h apart without noise, the variance of the middle is GROWTH h."""
    at = np.column_stack([np.linspace(-0.5, 0.5, 101), np.zeros((101, 2))])
    at[::2, 1], at[::4, 2] = 1e-9, 1e-9
    with np.errstate(all="ignore"):
        sd = spread_of_spline(at, np.array([[0.005, 5e-10, 2.5e-10]]), 1e-9)
    # variogram 2 G h; middle of a gap h of a random walk: 2 G h / 4
    assert sd[0] == pytest.approx(np.sqrt(2.0 * GROWTH * 0.01 / 4.0), rel=0.05)


def bumped(skin: Surface, height: float) -> Surface:
    centre = skin.points[np.argmin(np.abs(skin.points - skin.points.mean(axis=0)).sum(axis=1))]
    weight = np.exp(-((np.linalg.norm(skin.points - centre, axis=1) / 0.015) ** 2))
    return Surface(skin.points + height * weight[:, None] * [0.0, 1.0, 0.0], skin.triangles)


@pytest.mark.parametrize(("height", "is_told"), [(0.0, False), (0.004, False), (0.03, True)])
def test_a_part_of_a_scan_far_from_its_expected_place_is_reported_with_its_place(
    face, height, is_told
):
    nodes, sheet = face["position"].values, sheets(face)["skin"]
    target = Target("skin", sheet, bumped(sheet.at(nodes), height))
    text = unexpected_part(target, nodes, landmarks(face), NOISE, 0.0, "scan.ply")
    assert (text is not None) == is_told
    if text:
        assert re.match(r"scan.ply has a part \d\d mm from .*, nearest to landmark \w+", text)


def test_bone_is_compared_by_the_nodes_it_attracts(face):
    nodes, sheet = face["position"].values, sheets(face)["inner"]
    surface = sheet.at(nodes)
    for away, is_told in ((0.0, False), (0.03, True)):
        moved = Surface(surface.points - [0.0, away, 0.0], surface.triangles)
        target = Target("bone", sheet, moved, sheet.nodes[::7], -1.0)
        text = unexpected_part(target, nodes, landmarks(face), NOISE, 1.5e-3, "bone.stl")
        assert (text is not None) == is_told


@pytest.mark.parametrize(
    ("crop", "end"),
    [
        (0.0, f"{NEAR}:"),
        (0.01, f"{DOUBTED}, {NEAR}:"),
        (0.015, f"{DOUBTED}, {NEAR}:"),
        (0.025, DOUBTED),
    ],
)
def test_a_scan_that_ends_within_the_face_does_not_shrink_it(generic, person, crop, end):
    """The rim of the face was pulled to the border of the scan: temples 20 mm too far inside.

    Named points beyond a scan that ends within the face are doubted; a whole scan has none.
    """
    skin, rng = person.surface(), np.random.default_rng(0)
    rim = skin.points[max(skin.loops, key=lambda loop: length(skin.points[loop]))]
    within = KDTree(rim).query(skin.points)[0] >= crop
    triangles = skin.triangles[within[skin.triangles].all(axis=1)]
    near = KDTree(skin.points[np.unique(triangles)])
    marks = {
        k: p + NOISE * rng.standard_normal(3)
        for k, p in person.landmarks.items()
        if near.query(p)[0] < 0.01
    }
    ending = end_of(generic, person, marks, (skin.points, triangles))
    assert ending.startswith(end), ending
    assert ("named points of the face" in ending) == (crop > 0.0)


def test_a_scan_of_one_half_is_a_face_or_an_error_that_says_so(generic, person):
    """It was an error of the mesh, without the reason."""
    q, skin, points = person.face["position"].values, person.surface(), points_of_face(person.face)
    sheet = sheets(person.face)["skin"]
    own = sheet.triangles[q[sheet.triangles].mean(axis=1)[:, 0] > 0.0]
    marks = {k: person.landmarks[k] for k, p in points.items() if p[0] > -1.5e-3}
    end = end_of(generic, person, marks, (person.moved(q), own))
    assert len(skin.triangles) > len(own)
    said = "% of the skin" in end or "Expected surfaces and landmarks of the whole face" in end
    assert end.startswith((DOUBTED, NEAR)) or said, end


def test_a_treated_face_is_not_fitted(generic, person):
    """The stress-free shapes of its wounds stayed in the frame of the old geometry."""
    rest = generic["position"].values[np.maximum(generic["connectivity"].values, 0)]
    treated = generic.assign(
        stress_free_position=(("element", "element_node", "axis"), rest, {"units": "m"})
    )
    with pytest.raises(FitError, match="has closed wounds"):
        fit_face(treated, person.landmarks)


def test_a_second_layer_of_a_scan_is_reported():
    """A copy shifted by 3 mm is; two halves apart from each other, or a wall behind, are not."""
    skin = person_of(5).surface()
    x, t = skin.points, skin.triangles
    both = np.concatenate([t, t + len(x)])
    doubled = Surface(np.concatenate([x, x + [0.0, 3e-3, 0.0]]), both)
    sentence = second_layer(doubled, "scan.ply")
    assert sentence is not None and "second layer 2" in sentence
    wall = Surface(
        np.concatenate([x, x + [0.0, 3e-3, 0.0]]), np.concatenate([t, t[:, ::-1] + len(x)])
    )
    upper = x[t][:, :, 2].min(axis=1) > np.median(x[:, 2])
    lower = x[t][:, :, 2].max(axis=1) < np.median(x[:, 2])
    halves = Surface(x, t[upper | lower])
    assert [second_layer(one, "scan.ply") for one in (skin, wall, halves)] == [None] * 3


@pytest.mark.parametrize("kind", ["inner", "bone"])
def test_a_surface_beneath_the_skin_of_another_person_is_reported(generic, kind):
    """The skin of one person with the inner surface of another was fitted silently, by 1.9 mm wrong."""
    group = [person_of(1000 + k, "coarse") for k in range(3)]
    rng = np.random.default_rng(0)
    for a, one in enumerate(group):
        marks = {k: p + NOISE * rng.standard_normal(3) for k, p in points_of_face(one.face).items()}
        q, skin = one.face["position"].values, sheets(one.face)["skin"].triangles
        for b, other in enumerate(group):
            triangles = sheets(other.face)["inner"].triangles
            if kind == "bone":
                constrained = other.face["fixed"].values != FREE
                triangles = triangles[constrained[triangles].all(axis=1)][:, ::-1]
            given = {"skin": (q, skin), kind: (other.face["position"].values, triangles)}
            scans = {name: scan_of(surface, None, name) for name, surface in given.items()}
            try:
                sentences = compared_inputs(
                    generic, landmarks_of(marks), None, scans, False, NOISE
                )[2]
            except FitError as error:
                sentences = [str(error)]
            if a == b:
                assert sentences == []
            else:
                assert any(
                    re.search(r"beneath the skin around|of soft tissue", t) for t in sentences
                )


def test_landmarks_that_the_fitted_face_misses_are_named():
    names = ("nasion", "chin", "corner_left", "temple_left")
    miss = np.array([0.003, 0.0061, 0.0071, np.nan])
    sentence = missed_landmarks(names, miss, NOISE)
    assert sentence is not None and "2 of 3 landmarks by more than 5.0 mm" in sentence
    assert "(corner_left 7.1 mm, chin 6.1 mm)" in sentence and "nasion" not in sentence
    assert missed_landmarks(names, np.array([0.0049, 0.001, 0.0, np.nan]), NOISE) is None
    assert missed_landmarks(names, miss, 1.5e-3) is None  # five deviations of a larger noise


@pytest.mark.slow
def test_a_fold_near_the_corner_of_the_mouth_is_reported():
    """Its part of the surface is where the landmarks suggest; the corner ends 7 mm from its landmark."""
    person = person_of(5)
    _, marks, points, triangles = damaged(person, 10)
    end = end_of(template_face(resolution="coarse"), person, marks, (points, triangles))
    assert end.startswith(f"{DOUBTED}, far") and "corner_right 7" in end, end


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "damage"), [(37, cropped), (53, other_pose), (118, self_intersection)]
)
def test_inputs_that_gave_a_far_face_silently_are_doubted(generic, person, number, damage):
    _, marks, points, triangles = damaged(person, number, damage)
    assert end_of(generic, person, marks, (points, triangles)).startswith(f"{DOUBTED}, far")


def test_points_beyond_the_ends_of_a_scan_are_named():
    """A point on the part of a sphere that was scanned is covered; those beyond need a landmark."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.1)
    sphere = Surface(np.array(ball.vertices), np.array(ball.faces))
    points = dict(zip("abc", 0.1 * np.eye(3), strict=True))
    assert uncovered_points(sphere, points, (), "skin") is None
    above = sphere.points[:, 2] > 0.03
    part = Surface(sphere.points, sphere.triangles[above[sphere.triangles].all(axis=1)])
    sentence = uncovered_points(part, points, (), "scan.ply")
    assert sentence is not None and "scan.ply ends before 2 of" in sentence and "c " not in sentence
    assert uncovered_points(part, points, ("a", "b"), "scan.ply") is None  # both have landmarks


@pytest.fixture(scope="module")
def fitted(generic, person):
    skin = person.surface()
    return fit_face(generic, person.landmarks, skin=(skin.points, skin.triangles)).face


def test_the_ends_see_wrong_faces(fitted, person):
    """Negative controls: the same face mirrored, turned, enlarged, and with two points exchanged."""
    assert judged(fitted, person, ()).startswith(f"{NEAR}:")
    q = fitted["position"].values
    centre = q.mean(axis=0)
    turned = Rotation.from_rotvec([0.0, 0.1, 0.0]).as_matrix()
    wrong = {
        "mirrored": fitted.assign(position=fitted["position"] * [-1.0, 1.0, 1.0]),
        "turned": carry(fitted, (q - centre) @ turned.T + centre).face,
        "enlarged": carry(fitted, 1.1 * (q - centre) + centre).face,
        "exchanged": fitted.copy(deep=True),
    }
    markers = wrong["exchanged"]["marker_node"].values
    markers[[0, 1]] = markers[[1, 0]]
    for name, face in wrong.items():
        assert judged(face, person, ()).startswith("far"), (name, apart(face, person))


def test_an_error_without_a_place_and_any_other_exception_are_bad_ends(
    monkeypatch, generic, person
):
    import benchmarks.fit_ends as module

    for error, end in ((FitError("no"), "unlocated"), (ValueError("x"), "defect")):

        def fail(*given, _error=error, **named):
            raise _error

        monkeypatch.setattr(module, "fit_face", fail)
        assert end_of(generic, person, {}, None).startswith(end)


def test_tips_of_a_fitted_face_are_where_those_of_the_person_are(fitted, person):
    """Its mesh has no nodes in the plane x = 0: the tips were nodes up to 47 mm elsewhere."""
    assert apart(fitted, person)[1] < 3.0


@pytest.mark.parametrize("seed", [302, 303])
def test_the_chin_is_below_the_fold_under_the_lip(seed):
    face = template_face(resolution="coarse", seed=seed)
    known = points_of_face(face)
    face.attrs = {k: v for k, v in face.attrs.items() if not k.startswith("measure_")}
    points = points_of_face(face)
    for name in ("pronasale", "pogonion"):
        assert np.linalg.norm(points[name] - known[name]) < 4e-3, name


def test_the_tip_of_the_nose_of_the_published_face_is_not_on_its_forehead(shared):
    points = points_of_face(import_artisynth(shared / "artisynth_models"))
    # published landmarks prn, sl (fold under the lip) and pg
    assert np.linalg.norm(points["pronasale"] - [0.0, 0.0936, -0.0616]) < 6e-3
    assert -0.1190 < points["pogonion"][2] < -0.0944


def test_sound_persons_are_not_doubted(generic):
    other, rng = person_of(301), np.random.default_rng(1)
    marks = {k: p + NOISE * rng.standard_normal(3) for k, p in other.landmarks.items()}
    skin = other.surface()
    assert end_of(generic, other, marks, (skin.points, skin.triangles)).startswith(f"{NEAR}:")


def test_a_thicker_face_ends_where_its_scan_does(generic):
    """The prior of thickness pushed the temples off the scan by 8 mm, and the fit was refused."""
    other = person_of(301)
    skin = other.surface()
    fit = fit_face(generic, other.landmarks, skin=(skin.points, skin.triangles), thickness=1.0)
    assert judged(fit.face, other, fit.doubts).startswith(f"{NEAR}:")
    reached = 1e-3 * fit.thickness["after"].to_numpy() / fit.prior.wanted
    assert np.median(reached) == pytest.approx(1.0, abs=0.01)
