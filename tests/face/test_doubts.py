"""Doubts about a motion: reported by the function and the command, and not of a face at rest."""

import warnings

import numpy as np
import pytest
import xarray as xr

import emgface as ef
from emgface.errors import MotionWarning
from emgface.face.doubts import doubts_of


def motion(**attrs: float | str) -> xr.Dataset:
    usual = {"numerical_error": 2e-4, "motion": 4e-3, "inaccurate": 0, "sigma_max": 1e5}
    return xr.Dataset(attrs=usual | attrs)


@pytest.mark.parametrize(
    ("attrs", "expected"),
    [
        ({}, ""),
        ({"numerical_error": 1e-3, "inaccurate": 1}, "the time steps is 1 mm, more than a tenth"),
        ({"numerical_error": 5e-11, "motion": 4e-12, "inaccurate": 1}, ""),
        ({"reduced": 1, "reduction_doubt": "x"}, "the reduced motion is not trusted, since x"),
        ({"reduced": 0, "reduction_doubt": "x"}, "was repeated at full order, since x"),
    ],
)
def test_doubts_in_sentences(attrs, expected):
    doubts = doubts_of(motion(**attrs))
    assert len(doubts) == bool(expected)
    assert all(expected in text for text in doubts)


@pytest.mark.parametrize(("level", "doubtful"), [(0.1, True), (0.0, False)])
def test_the_function_warns_of_an_inaccurate_motion_and_not_of_a_face_at_rest(level, doubtful):
    face = ef.face(resolution="coarse")
    names, time = face["muscle"].values, np.array([0.0, 0.01, 0.02, 0.03])
    values = np.zeros((len(names), 4))
    values[0, 1] = level  # a peak within one step of 20 ms
    given = xr.Dataset(
        {"activation": (("muscle", "time"), values, {"units": "1"})},
        {"muscle": names, "time": ("time", time, {"units": "s"})},
        {"origin": "simulated"},
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ef.simulate(given, face, solver="linearly_implicit", step=0.02, contact={"method": "none"})
    assert any(one.category is MotionWarning for one in caught) == doubtful
