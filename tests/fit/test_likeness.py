"""Measures of a generated face before its mesh is deformed."""

import numpy as np
import pytest

from benchmarks.fit_inputs import person_of
from emgface.face.template import template_face, volunteer_face
from emgface.fit.family import MEASURE_SPREADS, Family
from emgface.fit.inputs import pair_points, points_of_face
from emgface.fit.likeness import nearer_face
from emgface.fit.person import fit_face
from emgface.fit.readers.landmarks import landmarks_of
from emgface.fit.similarity import similarity
from emgface.fit.targets import sheets


@pytest.fixture(scope="module")
def two():
    return person_of(101, "coarse"), person_of(102, "coarse")


def _fitted(one, other, names=("skin", "inner")):
    scans = {name: other.surface(name) for name in names}
    given = {name: (scan.points, scan.triangles) for name, scan in scans.items()}
    return fit_face(one, other.landmarks, rim=True, simulated=True, **given)


def _apart(face, wanted):
    """Distances of the nodes after the best rigid motion [mm]."""
    q, wanted = face["position"].values, wanted["position"].values
    frame = similarity(q, wanted, scaled=False)
    return 1e3 * np.linalg.norm(frame(q) - wanted, axis=1)


def test_nodes_of_another_generated_person_are_found(two):
    """Surfaces alone leave them 1 mm apart, along the skin."""
    one, other = two
    fit = _fitted(one.face, other)
    plain = one.face.copy()
    del plain.attrs["measure_mouth_width"]
    alone = _fitted(plain, other)
    assert np.median(_apart(alone.face, other.face)) > 0.5
    assert np.median(_apart(fit.face, other.face)) < 0.1
    np.testing.assert_array_equal(fit.face["fixed"], other.face["fixed"])
    assert any("the measures of the generated face" in note for note in fit.notes)
    width = fit.face.attrs["measure_mouth_width"]
    assert width == pytest.approx(other.face.attrs["measure_mouth_width"], abs=0.5e-3)


def test_landmarks_alone_bring_the_face_nearer(two):
    one, other = two
    fit = _fitted(one.face, other, ())
    before, after = (_apart(face, other.face) for face in (one.face, fit.face))
    assert np.median(after) < 0.7 * np.median(before)


def test_only_nodes_that_its_measures_give_make_a_family(two):
    one, other = two
    family = Family.from_face(one.face)
    assert family is not None
    np.testing.assert_allclose(family.nodes(family.start), one.face["position"], atol=1e-9)
    changed = one.face.copy(deep=True)
    changed["position"].values[5] += 1e-4
    other_origin = one.face.assign_attrs(origin="imported")
    paired = pair_points(one.face, landmarks_of(other.landmarks), None, 1e-3)
    for face in (changed, other_origin):
        assert Family.from_face(face) is None
        assert nearer_face(face, paired, [], 1e-3) is face


def test_a_face_with_other_muscles_keeps_them():
    face, _ = volunteer_face(3, 1, resolution="coarse", course_shift=2e-3)
    family = Family.from_face(face)
    assert family is not None
    values = family.start.copy()
    values[list(MEASURE_SPREADS).index("mouth_width")] += 2e-3
    member = family.member(values)
    np.testing.assert_array_equal(member["bundle_index"], face["bundle_index"])
    np.testing.assert_array_equal(member["bundle_weight"], face["bundle_weight"])
    assert member.attrs["measure_mouth_width"] > face.attrs["measure_mouth_width"] + 1e-3
    np.testing.assert_allclose(member["position"], family.nodes(values), atol=0.1e-3)


@pytest.mark.parametrize("name", ["pronasale", "pogonion"])
def test_tips_do_not_depend_on_the_mesh(name):
    """The nodes of the coarse face are 8 mm from the tip of the nose."""
    coarse, fine = (template_face(resolution=r, seed=3) for r in ("coarse", "fine"))
    place = points_of_face(coarse)[name]
    np.testing.assert_allclose(place, points_of_face(fine)[name], atol=1e-9)
    nodes = fine["position"].values
    assert np.linalg.norm(nodes - place, axis=1).min() < 1.5e-3
    # of a face that is not of the family, by the curve through its nodes
    imported = points_of_face(coarse.assign_attrs(origin="imported"))[name]
    assert np.linalg.norm(imported - place) < 3.5e-3


def test_landmarks_of_a_fine_face_bring_a_coarse_one_nearer():
    """The measures that landmarks determine, such as the height of the upper lip, have no bias."""
    generic = template_face(resolution="coarse")
    spread, deviations = MEASURE_SPREADS["upper_lip_height"], []
    for seed in (1, 2, 3):
        person = template_face(resolution="medium", seed=seed)
        fitted = fit_face(generic, points_of_face(person), simulated=True).face
        own = template_face(resolution="coarse", seed=seed)
        apart = [np.median(_apart(face, own)) for face in (generic, fitted)]
        assert apart[1] < 0.8 * apart[0]
        name = "measure_upper_lip_height"
        deviations.append((fitted.attrs[name] - person.attrs[name]) / spread)
    assert np.abs(deviations).max() < 1.0


def test_noise_of_landmarks_bends_nothing():
    """Noisy landmarks of the face itself move its markers less than they miss them."""
    face = template_face(resolution="coarse")
    marks = points_of_face(face)
    rng = np.random.default_rng(1)
    noisy = {name: p + 0.8e-3 * rng.standard_normal(3) for name, p in marks.items()}
    fit = fit_face(face, noisy, noise=0.8e-3, simulated=True)
    nodes = face["marker_node"].values
    moved = _apart(fit.face, face)[nodes]
    assert np.sqrt((moved**2).mean()) < 0.7  # the noise of one landmark is 1.4 mm
    # what noise does not explain bends a face whose measures are unknown
    plain = face.copy()
    del plain.attrs["measure_mouth_width"]
    bend = {name: 1.5 * p[1] ** 2 for name, p in marks.items()}
    bent = {name: p + [0.0, 0.0, bend[name]] for name, p in marks.items()}
    fit = fit_face(plain, bent, noise=0.8e-3, simulated=True)
    assert fit.landmarks["error"].max() < 0.1 * 1e3 * (max(bend.values()) - min(bend.values()))


def test_a_fine_scan_does_not_push_nodes_of_coarse_lips_outwards():
    """Nodes of the coarse person lie on the scan, triangles between them within it."""
    own, _ = volunteer_face(1, 4, resolution="coarse")
    fine, _ = volunteer_face(1, 4, resolution="medium")
    skin = (fine["position"].values, sheets(fine)["skin"].triangles)
    fit = fit_face(
        template_face(resolution="coarse"), points_of_face(fine), simulated=True, skin=skin
    )
    markers = own["marker_node"].values
    places = fit.face["position"].values[markers]
    wanted = own["position"].values[markers]
    frame = similarity(places, wanted, scaled=False)
    apart = 1e3 * np.linalg.norm(frame(places) - wanted, axis=1)
    assert np.sqrt((apart**2).mean()) < 0.6
