"""Corners of the mouth after a treatment or a fit: the nodes of the face before it."""

import numpy as np
import pytest
import xarray as xr

import emgface as ef
from emgface.errors import FaceError
from emgface.face.lip_shape import lip_rim
from emgface.face.template import template_face
from emgface.fit.carry import carry
from emgface.treatment.outcomes import OUTCOMES
from tests.treatment.plans import wedge


@pytest.fixture(scope="module")
def medium():
    return template_face(resolution="medium")


def corners(face):
    return face["node_id"].values[lip_rim(face).upper[[0, -1]]].tolist()


@pytest.mark.parametrize(
    "step",
    [
        {"width": 14.0, "height": 12.0, "place": 0.5},
        {"width": 14.0, "height": 12.0, "place": 0.3, "shape": "shield"},
        {"width": 14.0, "height": 12.0, "place": 0.5, "method": "elements"},
        {"width": 14.0, "height": 9.0, "place": 0.5, "lip": "upper"},
    ],
    ids=["V", "shield", "whole elements", "upper lip"],
)
def test_the_margins_end_at_the_corners_of_the_face_before(medium, step):
    once = ef.treat(medium, wedge(**step))
    assert corners(once) == corners(medium)
    other = "upper" if step.get("lip", "lower") == "lower" else "lower"
    assert len(getattr(lip_rim(once), other)) == len(getattr(lip_rim(medium), other))
    twice = ef.treat(once, {"step": [{"kind": "palsy", "side": "left", "degree": 0.5}]})
    assert corners(twice) == corners(medium)


def test_a_fit_keeps_the_corners_wherever_the_lips_move(coarse):
    rim, q = lip_rim(coarse), coarse["position"].values.copy()
    q[rim.upper[1], 0] = q[rim.upper[0], 0] - 1e-4  # the leftmost node is no longer the corner
    assert corners(carry(coarse, q).face) == corners(coarse)


def test_corners_that_are_not_at_the_mouth_are_refused(coarse):
    wrong = coarse["marker_node"].values[:2].astype(np.int32)
    with pytest.raises(FaceError, match="mouth_corner_node"):
        lip_rim(coarse.assign(mouth_corner_node=("mouth_corner", wrong)))


def test_exchanged_corners_are_refused(coarse):
    exchanged = lip_rim(coarse).upper[[-1, 0]].astype(np.int32)
    with pytest.raises(FaceError, match="exchange them"):
        lip_rim(coarse.assign(mouth_corner_node=("mouth_corner", exchanged)))


def test_lips_that_are_drawn_backwards_have_a_negative_protrusion(coarse):
    protrusion = next(one for one in OUTCOMES if one.name == "pursing, protrusion")
    names = ["corner_left", "corner_right"]
    position = np.zeros((2, 3, 3))
    position[1, 0] = 0.05, 0.04, 0.045
    motion = xr.Dataset(
        {
            "position": (("marker", "axis", "time"), position),
            "lip_protrusion": ("time", [0.001, -0.001, 0.004]),
        },
        coords={"marker": names},
    )
    assert protrusion.value(coarse, motion) == pytest.approx(-0.002)
