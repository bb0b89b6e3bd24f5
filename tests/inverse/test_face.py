"""Inversion of recordings on the face: variants, lost markers, missing channels, refusals."""

import numpy as np
import pytest
import xarray as xr

from emgface.errors import ConfigurationError, MarkerError
from emgface.inverse.run import InverseParameters, _wanted, invert
from emgface.inverse.variants import VARIANTS, trust_of
from emgface.muscles import LIP_MARKERS, MUSCLES
from emgface.study.measured import _check_sides


def test_the_variants_are_one_family_of_trust():
    trust = {
        v: dict(zip(MUSCLES, trust_of(v, MUSCLES, 3.0, ["ZYG_L"]), strict=True)) for v in VARIANTS
    }
    assert set(trust["motion"].values()) == {0.0}
    assert set(trust["driven"].values()) == {np.inf}
    for muscle in ("BUC_L", "LAO_R", "DLI_L", "OOM_R", "ZYG_L"):
        assert trust["hybrid"][muscle] == trust["assisted"][muscle] == 0.0
    assert trust["hybrid"]["ZYG_R"] == np.inf and trust["assisted"]["ZYG_R"] == 3.0
    with pytest.raises(ConfigurationError, match="variant 'both' is unknown"):
        trust_of("both", MUSCLES, 1.0)
    with pytest.raises(ConfigurationError, match="expected a number >= 0"):
        trust_of("assisted", MUSCLES, -1.0)


def test_targets_are_displacements_scaled_to_the_mouth_of_the_face():
    rng = np.random.default_rng(0)
    rest = rng.standard_normal((10, 3)) * 0.02
    person = 1.25 * rest + 0.3
    move = 1e-3 * np.arange(30)[:, None, None] * np.array([0.0, 0.0, 1.0])
    move[:12] = 0.0
    position = xr.DataArray(
        person + move, dims=("time", "marker", "axis"),
        coords={"time": 0.01 * np.arange(30), "marker": list(LIP_MARKERS)},
    )  # fmt: skip
    wanted, scale = _wanted(position, rest)
    assert scale == pytest.approx(0.8)
    assert np.abs(wanted - (rest + 0.8 * move)).max() < 1e-12
    with pytest.raises(MarkerError, match="marker corner_left is not visible in the first 0.1 s"):
        _wanted(position.where(position["marker"] != "corner_left"), rest)


def test_an_unknown_marker_to_leave_out_is_refused():
    with pytest.raises(MarkerError, match="left_out contains 'chin'"):
        invert(xr.Dataset(), xr.Dataset(), parameters=InverseParameters(left_out=("chin",)))


def test_lip_markers_on_the_wrong_side_are_refused():
    position = xr.DataArray(
        np.zeros((10, 3, 5)), dims=("marker", "axis", "time_marker"),
        coords={"marker": list(LIP_MARKERS), "axis": list("xyz")},
    )  # fmt: skip
    position.loc[{"axis": "x"}] = 0.01
    for name in LIP_MARKERS:
        if name.endswith("left"):
            position.loc[{"axis": "x", "marker": name}] = -0.01
    _check_sides(position)
    exchanged = position * xr.where(position["axis"] == "x", -1.0, 1.0)
    with pytest.raises(MarkerError, match="corner_right is 20 mm to the left of corner_left"):
        _check_sides(exchanged)
