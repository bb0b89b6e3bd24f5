"""The gestures of the six instructions, simulated and drawn."""

import numpy as np
import pytest
import xarray as xr

from emgface.errors import DataError
from emgface.face.template.gestures import (
    GESTURES,
    gesture_activation,
    gesture_positions,
)
from emgface.muscles import INSTRUCTIONS, LIP_MARKERS, RELEVANT


def test_gestures_use_the_relevant_muscles() -> None:
    assert list(GESTURES) == list(INSTRUCTIONS)
    for instruction, (_, left, right) in GESTURES.items():
        assert {*left, *right} <= set(RELEVANT[instruction])
    assert gesture_activation("B") == {"LLSAN_L": 0.5, "LLSAN_R": 0.5}
    aside = gesture_activation("E")
    assert aside["ZYG_L"] > 0 and "ZYG_R" not in aside
    with pytest.raises(DataError, match="unknown instruction 'G', expected one of"):
        gesture_activation("G")


@pytest.fixture(scope="module")
def positions(coarse: xr.Dataset) -> dict[str, np.ndarray]:
    return gesture_positions(coarse)


def test_gestures_are_what_they_are_called(
    coarse: xr.Dataset, positions: dict[str, np.ndarray]
) -> None:
    rest, node = coarse["position"].values, coarse["marker_node"].values

    def moved(instruction: str, marker: str) -> np.ndarray:
        k = node[LIP_MARKERS.index(marker)]
        return 1e3 * (positions[instruction][k] - rest[k])

    purse = moved("A", "corner_left")
    assert purse[0] > 2.0, "pursing narrows the mouth"
    for marker in ("corner_left", "upper_paramedian_left", "lower_paramedian_left"):
        assert moved("A", marker)[1] > 0.2, "pursing protrudes the lips"
    assert moved("B", "upper_paramedian_left")[2] > 2.0, "raising lifts the upper lip"
    assert abs(moved("B", "lower_paramedian_left")[2]) < 1.0
    assert moved("C", "corner_left")[2] < -2.0, "depressing lowers the corners"
    for smile in "DF":
        corner = moved(smile, "corner_left")
        assert corner[0] < -1.5 and corner[2] > 1.5, "smiling widens and lifts the corners"
    upper, lower = coarse["lip_opening_node"].values
    gap = {name: 1e3 * (p[upper, 2] - p[lower, 2]) for name, p in positions.items()}
    rest_gap = 1e3 * (rest[upper, 2] - rest[lower, 2])
    assert gap["F"] < rest_gap < gap["D"], (
        "the smile of F keeps the mouth closed, that of D does not"
    )
    for marker in LIP_MARKERS:
        assert moved("E", marker)[0] < 0.0, "the whole mouth goes to the left"
