"""Jaw fitted to simulated persons, whose own jaws are known; what follows, and what is refused."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sim
from emgface.anatomy.jaw.template import template_jaw
from emgface.errors import FitError
from emgface.fit.bones import fit_jaw, moved_jaw, points_of_jaw, surface_volume, surfaces_of
from emgface.fit.registration import SmoothMap
from emgface.fit.similarity import Similarity
from tests.fit.conftest import MOTION

SEED = 8


@pytest.fixture(scope="module")
def jaw():
    return template_jaw()


@pytest.fixture(scope="module")
def own():
    return template_jaw(seed=SEED)


def _moved(points):
    return points @ MOTION[0].T + MOTION[1]


@pytest.fixture(scope="module")
def inputs(own):
    """Landmarks and surfaces of the person, in a frame of their own."""
    marks = {k: _moved(v) for k, v in points_of_jaw(own).items() if k != "head_centre"}
    scans = {
        name: (_moved(surface.points), surface.triangles)
        for name, surface in surfaces_of(own).items()
        if name in ("jaw", "hyoid")
    }
    return marks, scans


@pytest.fixture(scope="module")
def fitted(jaw, inputs):
    marks, scans = inputs
    return fit_jaw(jaw, landmarks=marks, surfaces=scans, simulated=True)


def _truth(fitted, own, name):
    """Points of the person's own jaw in the frame of the fitted one."""
    rows = np.array(json.loads(fitted.jaw.attrs["fit_frame"])).reshape(3, 4)
    points = _moved(own[name].values.reshape(-1, 3))
    return points @ rows[:, :3].T + rows[:, 3]


@pytest.mark.parametrize(
    ("name", "share"),
    [("muscle_position", 0.25), ("joint_origin", 0.15), ("surface_position", 0.15)],
)
def test_what_no_landmark_marks_is_nearer_to_the_own_jaw(fitted, jaw, own, name, share):
    truth = _truth(fitted, own, name)
    before, after = (
        np.median(np.linalg.norm(model[name].values.reshape(-1, 3) - truth, axis=1))
        for model in (jaw, fitted.jaw)
    )
    assert after < share * before, (1e3 * before, 1e3 * after)


def test_surfaces_are_reached_and_masses_follow_their_volumes(fitted, jaw, own):
    last = fitted.distance[fitted.distance["stage"] == "fitted"].set_index("body")["mean"]
    assert (last < 0.5).all()
    generic, reached, true = (surfaces_of(m) for m in (jaw, fitted.jaw, own))
    mass = fitted.jaw["body_mass"].sel(body="jaw").item()
    ratio = surface_volume(reached["jaw"]) / surface_volume(generic["jaw"])
    assert mass == pytest.approx(ratio * jaw["body_mass"].sel(body="jaw").item())
    assert surface_volume(reached["jaw"]) == pytest.approx(surface_volume(true["jaw"]), rel=0.03)
    assert surface_volume(reached["hyoid"]) == pytest.approx(
        surface_volume(true["hyoid"]), rel=0.03
    )


def test_a_similarity_carries_every_quantity_in_closed_form(jaw):
    s, R = 1.2, Rotation.from_rotvec([0.2, -0.3, 0.1]).as_matrix()
    t = np.array([0.01, -0.02, 0.03])
    displaced = moved_jaw(jaw, SmoothMap(Similarity(s, R, t)))
    for name in ("muscle_position", "joint_origin", "surface_position"):
        np.testing.assert_allclose(
            displaced[name].values, s * jaw[name].values @ R.T + t, atol=1e-12
        )
    curves = jaw["joint_kind"].values == 1
    for name, own in (("joint_normal", slice(None)), ("joint_forward", curves)):
        np.testing.assert_allclose(
            displaced[name].values[own], jaw[name].values[own] @ R.T, atol=1e-9
        )
    np.testing.assert_allclose(displaced["body_mass"], s**3 * jaw["body_mass"], rtol=1e-9)
    inertia = s**5 * np.einsum("ij,bjk,lk->bil", R, jaw["body_inertia"].values, R)
    np.testing.assert_allclose(displaced["body_inertia"].values, inertia, rtol=1e-7, atol=1e-18)
    np.testing.assert_allclose(
        displaced["spring_rest_length"], s * jaw["spring_rest_length"], rtol=1e-12
    )
    # the curve is the same shape, larger: height(s x) = s height(x)
    x = 0.7 * jaw["joint_length"].values[:, None] ** np.arange(4)
    height = (jaw["joint_curve"].values * x).sum(axis=1)
    scaled = 0.7 * displaced["joint_length"].values[:, None] ** np.arange(4)
    np.testing.assert_allclose(
        (displaced["joint_curve"].values * scaled).sum(axis=1), s * height, rtol=1e-9, atol=1e-15
    )


def test_a_squeezed_body_has_the_inertia_of_its_surface(jaw):
    """An affine map: mass, centre and inertia are those of the volume within the moved surface."""

    class Squeeze(SmoothMap):
        def __call__(self, points):
            return points * [1.1, 0.9, 1.0]

    surface = surfaces_of(jaw)["jaw"]
    solid = sim.body_of_surface("jaw", surface.points, surface.triangles, 1000.0)
    k = [str(b) for b in jaw["body"].values].index("jaw")
    given = jaw.copy(deep=True)
    given["body_mass"].values[k], given["body_inertia"].values[k] = solid.mass, solid.inertia
    given["body_centre"].values[k] = solid.centre
    displaced = moved_jaw(given, Squeeze(Similarity(1.0, np.eye(3), np.zeros(3))))
    after = surfaces_of(displaced)["jaw"]
    expected = sim.body_of_surface("jaw", after.points, after.triangles, 1000.0)
    assert displaced["body_mass"].values[k] == pytest.approx(expected.mass, rel=1e-9)
    np.testing.assert_allclose(displaced["body_centre"].values[k], expected.centre, atol=1e-9)
    np.testing.assert_allclose(displaced["body_inertia"].values[k], expected.inertia, atol=1e-11)


def test_a_fitted_jaw_runs(fitted):
    from emgface.anatomy.jaw.run import run_task
    from emgface.anatomy.jaw.tasks import JAW_TASKS

    motion = run_task(fitted.jaw, JAW_TASKS["open"])
    assert np.isfinite(motion["body_position"].values).all()


def test_bones_alone_are_found_without_landmarks(jaw, own):
    scans = {n: (s.points, s.triangles) for n, s in surfaces_of(own).items() if n == "jaw"}
    fit = fit_jaw(jaw, surfaces=scans, simulated=True)
    assert fit.distance["mean"].iloc[-1] < 0.5
    assert not len(fit.landmarks)


def test_a_surface_inside_out_is_turned(jaw, inputs):
    marks, scans = inputs
    points, triangles = scans["jaw"]
    fit = fit_jaw(jaw, landmarks=marks, surfaces={"jaw": (points, triangles[:, ::-1])})
    assert any("turned" in note for note in fit.notes)
    assert fit.distance["mean"].iloc[-1] < 0.5


def _refusals(inputs):
    marks, scans = inputs
    points, triangles = scans["jaw"]
    return {
        "mirrored": ({k: v * [-1, 1, 1] for k, v in marks.items()}, {}, "is mirrored"),
        "exchanged": (
            marks | {"lower_incisor": marks["hyoid"], "hyoid": marks["lower_incisor"]}, {},
            "lower_incisor|hyoid",
        ),
        "unnamed": (marks, {"femur": scans["jaw"]}, "no surface of femur"),
        "other bone": (marks, {"hyoid": scans["jaw"]}, "misses|is near only"),
        "large": (marks, {"jaw": (1e3 * points, triangles)}, "misses|agreeing|unit|large"),
        "nothing": (None, {}, "no landmarks and no surface"),
    }  # fmt: skip


@pytest.mark.parametrize(
    "name",
    ["mirrored", "exchanged", "unnamed", "other bone", "large", "nothing"],
)
def test_inputs_that_cannot_be_right_are_refused(jaw, inputs, name):
    marks, scans, why = _refusals(inputs)[name]
    with pytest.raises(FitError, match=why):
        fit_jaw(jaw, landmarks=marks, surfaces=scans, simulated=True)


@pytest.mark.parametrize(("forward", "warned"), [(0.0, False), (4e-3, True)])
def test_landmarks_and_surfaces_of_two_poses_are_reported(jaw, inputs, own, forward, warned):
    """The smooth map bent the jaw between them, silently."""
    marks, scans = inputs
    rng = np.random.default_rng(SEED)
    noisy = {k: p + 0.8e-3 * rng.standard_normal(3) for k, p in marks.items()}
    points, triangles = scans["jaw"]
    scan = points + forward * MOTION[0][:, 1], triangles
    notes = fit_jaw(jaw, landmarks=noisy, surfaces={"jaw": scan}, simulated=True).notes
    assert any("same person, pose and frame" in note for note in notes) == warned


def test_small_bodies_may_have_a_surface(jaw, inputs, own):
    """A cricoid of 30 mm was refused as too small for a face."""
    cricoid = surfaces_of(own)["cricoid"]
    scan = _moved(cricoid.points), cricoid.triangles
    fit = fit_jaw(jaw, landmarks=inputs[0], surfaces={"cricoid": scan}, simulated=True)
    assert fit.distance["mean"].iloc[-1] < 0.5
    with pytest.raises(FitError, match="cricoid has an extent of .* mm, expected 1. to 600 mm"):
        fit_jaw(jaw, landmarks=inputs[0], surfaces={"cricoid": (0.1 * scan[0], scan[1])})
