"""Doubts about landmarks reach a user of the function as they reach one of the command."""

import warnings

import pytest

import emgface as ef
from emgface.errors import FitWarning
from emgface.fit.inputs import points_of_face

SIX = "corner_left", "corner_right", "forehead_left", "temple_right", "nasion", "pronasale"


def told(face, landmarks) -> str:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ef.fit(face, landmarks=landmarks)
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
        (lambda p: {k: p[k] for k in SIX}, "with 6 landmarks"),
    ],
)
def test_doubtful_landmarks_are_warned_of(face, change, expected):
    assert expected in told(face, change(points_of_face(face)))


@pytest.mark.parametrize("scale", [0.8, 1.0, 1.3])
def test_landmarks_of_children_and_adults_are_not_doubted(face, scale):
    assert told(face, {k: scale * v for k, v in points_of_face(face).items()}) == ""
