"""Landmarks judged by the others: closed form, dense landmarks of real faces, what is refused."""

import csv

import numpy as np
import pandas as pd
import pytest

from emgface.errors import FitError
from emgface.face.template import template_face
from emgface.fit.inputs import match, points_of_face
from emgface.fit.readers.landmarks import landmarks_of
from emgface.fit.similarity import thin_plate
from emgface.fit.strays import (
    STRAY,
    Predictions,
    check_strays,
    deviations,
    left_out,
    stretches,
    unusual_proportions,
)
from tests.fit.test_published import _published

NOISE = 1e-3
CANTHI = 0.09  #: distance of the outer corners of the eyes, by which pixels are scaled [m]


def _shape(n: int, dims: int = 3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(n)
    source = rng.uniform(-0.06, 0.06, (n, dims))
    return source, source @ (np.eye(dims) + 0.05) + 2e-3 * np.sin(40 * source)


@pytest.mark.parametrize("dims", [2, 3])
def test_errors_are_those_of_the_spline_without_the_point(dims):
    source, target = _shape(14, dims)
    errors, _ = Predictions(source, target, NOISE).errors()
    for k in range(len(source)):
        rest = np.delete(np.arange(len(source)), k)
        guess = thin_plate(source[rest], target[rest], NOISE)(source[k : k + 1])[0]
        np.testing.assert_allclose(errors[k], target[k] - guess, atol=1e-9)


def test_two_points_are_predicted_from_the_others():
    source, target = _shape(14)
    block = Predictions(source, target, NOISE)
    rest = np.delete(np.arange(14), [2, 5])
    guess = thin_plate(source[rest], target[rest], NOISE)(source[[2, 5]])
    now, then = block.exchanged(2, 5)
    for predicted, order in ((now, [2, 5]), (then, [5, 2])):
        e = target[order] - guess
        own = block.B[np.ix_([2, 5], [2, 5])]
        assert predicted == pytest.approx(float((e * (own @ e)).sum()), rel=1e-6)


def test_deviations_of_drawn_shapes_have_unit_size():
    """Shapes drawn with the assumed covariance: the mean square deviation is 1."""
    from scipy.spatial.distance import cdist

    from emgface.fit.similarity import GROWTH

    rng = np.random.default_rng(4)
    source = rng.uniform(-0.06, 0.06, (30, 3))
    near = np.concatenate([[source[0]], source])
    r = cdist(near, near)
    # increments from the first point have the variogram GROWTH h
    K = GROWTH * (r[:1, 1:] + r[1:, :1] - r[1:, 1:])
    root = np.linalg.cholesky(K + 1e-12 * np.eye(30))
    squares = []
    for _ in range(60):
        target = source + root @ rng.standard_normal((30, 3)) + NOISE * rng.standard_normal((30, 3))
        squares.append(deviations(*Predictions(source, target, NOISE).errors()) ** 2)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_the_stretch_of_one_axis_is_found_and_reported_with_that_axis(axis, factor):
    """In a frame of its own: the direction is that of the files."""
    source, _ = _shape(20)
    wrong = np.ones(3)
    wrong[axis] = factor
    turn = np.roll(np.eye(3), 1, axis=0)  # x to y, y to z, z to x
    factors, _ = stretches(source, 1.1 * (wrong * source) @ turn.T, NOISE)
    expected = np.full(3, -0.5 * np.log(factor))
    expected[axis] = np.log(factor)
    np.testing.assert_allclose(factors, expected, atol=1e-9)
    sentence = unusual_proportions(source, (wrong * source) @ turn.T, turn, "l.csv", NOISE)
    larger = "25 % larger" if factor > 1.0 else "25 % smaller"
    assert (
        sentence is not None
        and larger in sentence
        and "check the spacing of the slices" in sentence
    )
    assert f"along the axis {'yzx'[axis]} of the files" in sentence
    assert ("width", "depth", "height")[axis] in sentence
    assert unusual_proportions(source, source @ turn.T, turn, "l.csv", NOISE) is None


def test_sides_of_some_pairs_that_are_exchanged_are_named():
    """The unit was blamed, because the similarity of landmarks with two crossed pairs is smaller."""
    points = points_of_face(template_face(resolution="coarse"))
    crossed = dict(points)
    for name in ("temple", "forehead"):
        for a, b in (("left", "right"), ("right", "left")):
            crossed[f"{name}_{a}"] = points[f"{name}_{b}"]
    text = "sides of forehead_left and forehead_right, temple_left and temple_right seem to be exch"
    with pytest.raises(FitError, match=text):
        match(points, landmarks_of(crossed), None, NOISE, "face")
    assert match(points, landmarks_of(points), None, NOISE, "face").notes == []


def test_stretches_of_drawn_shapes_have_unit_size():
    """Shapes drawn with the assumed covariance, which has no affine part: mean square near 1."""
    from scipy.spatial.distance import cdist

    from emgface.fit.similarity import GROWTH

    rng = np.random.default_rng(5)
    source = rng.uniform(-0.06, 0.06, (30, 3))
    near = np.concatenate([[source[0]], source])
    r = cdist(near, near)
    root = np.linalg.cholesky(GROWTH * (r[:1, 1:] + r[1:, :1] - r[1:, 1:]) + 1e-12 * np.eye(30))
    squares = []
    for _ in range(200):
        target = source + root @ rng.standard_normal((30, 3)) + NOISE * rng.standard_normal((30, 3))
        stretch, sd = stretches(source, target, NOISE)
        squares.append((stretch / sd) ** 2)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("way", ["to the other", "back"])
def test_the_proportions_of_the_published_faces_are_not_doubted(shared, way):
    face, other, marks, _ = _published(shared / "artisynth_models")
    nodes = list(marks.values())
    source, target = face["position"].values[nodes], other[nodes]
    if way == "back":
        source, target = target, source
    assert unusual_proportions(source, target, np.eye(3), "l.csv", 0.8e-3) is None


def test_landmarks_that_decide_nothing_are_not_judged():
    source, target = _shape(12)
    source[1:, 2] = 0.0  # only the first lies outside of a plane
    errors, sd = Predictions(source, target, NOISE).errors()
    assert not np.isfinite(sd[0]) and not errors[0].any()
    assert np.isnan(left_out(source, target, NOISE)[0])


@pytest.mark.parametrize("spacing", [1, 4, 54])
@pytest.mark.parametrize("way", ["to the other", "back"])
def test_dense_correct_landmarks_of_published_faces_are_accepted(shared, way, spacing):
    face, other, marks, _ = _published(shared / "artisynth_models")
    folder = shared / "artisynth_models" / "face_reference" / "derived"
    with (folder / "lip_ring_nodes.csv").open() as stream:
        ring = [int(r["node"]) - 1 for r in csv.DictReader(stream) if int(r["ring"]) == 5]
    nodes = [*marks.values(), *ring[::spacing]]
    names = [*marks, *(f"lip_{k}" for k in range(len(ring[::spacing])))]
    source, target = face["position"].values[nodes], other[nodes]
    if way == "back":
        source, target = target, source
    check_strays(names, source, target, "landmarks", 0.8e-3)
    # one that is wrong by more than faces differ is still named
    wrong = target.copy()
    wrong[names.index("prn")] += [0.0, 0.03, 0.03]
    with pytest.raises(FitError, match="landmark prn lies"):
        check_strays(names, source, wrong, "landmarks", 0.8e-3)


@pytest.fixture(scope="module")
def smile(shared) -> np.ndarray:
    """Landmarks (frames, 68, 2) of a person who smiles [m]."""
    table = pd.read_csv(
        shared / "recordings" / "face-landmarks" / "subject1_smile_1_landmarks.csv"
    ).sort_values("Frame_number")
    x = table[[f"landmark_{k}_{axis}" for k in range(68) for axis in "xy"]].to_numpy()
    x = x.reshape(-1, 68, 2) * [1.0, -1.0]
    return x * CANTHI / np.median(np.linalg.norm(x[:, 36] - x[:, 45], axis=1))


def test_recorded_landmarks_of_a_person_are_accepted(smile):
    names = [f"landmark_{k}" for k in range(68)]
    width = np.linalg.norm(smile[:, 48] - smile[:, 54], axis=1)
    rest = smile[np.argmin(width)]
    for frame in (np.argmax(width), *range(0, len(smile), 300)):
        check_strays(names, rest, smile[frame], "smile", 0.8e-3)
    wide = smile[np.argmax(width)].copy()
    wide[[36, 48]] = wide[[48, 36]]
    with pytest.raises(FitError, match="landmark_36 and landmark_48 seem to be exchanged"):
        check_strays(names, rest, wide, "smile", 0.8e-3)
    wide = smile[np.argmax(width)].copy()
    wide[30] += [STRAY * 4e-3, STRAY * 4e-3]
    with pytest.raises(FitError, match="landmark landmark_30 lies"):
        check_strays(names, rest, wide, "smile", 0.8e-3)
