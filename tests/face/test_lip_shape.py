"""Measures of the mouth opening."""

import numpy as np
import pytest
import xarray as xr

from emgface.errors import FaceError
from emgface.face.lip_shape import lip_rim, lip_shape


def test_the_rim_runs_from_corner_to_corner_and_its_measures_follow_a_known_map(
    coarse: xr.Dataset,
) -> None:
    X = coarse["position"].values
    rim = lip_rim(coarse)
    assert rim.upper[0] == rim.lower[0] and rim.upper[-1] == rim.lower[-1]
    assert len(set(rim.upper) & set(rim.lower)) == 2
    assert X[rim.upper[0], 0] == X[rim.upper, 0].min() < 0 < X[rim.upper[-1], 0]
    rest = lip_shape(coarse, rim, X)
    twice = lip_shape(coarse, rim, X * [3.0, 1.0, 2.0] + [0.0, 0.004, 0.0])
    assert rest["protrusion"] == 0.0 and rest["overlap"] == 0.0
    assert twice["protrusion"] == twice["margin_protrusion"] == pytest.approx(0.004, rel=1e-12)
    for name, factor in (("width", 3), ("height", 2), ("area", 6), ("roundness", 2 / 3)):
        assert twice[name] == pytest.approx(factor * rest[name], rel=1e-9)
    crossed = X.copy()
    crossed[np.setdiff1d(rim.lower, rim.upper), 2] += 0.03
    shut = lip_shape(coarse, rim, crossed)
    assert shut["area"] == 0.0 and shut["overlap"] > rest["area"] and shut["height"] < 0
    with pytest.raises(FaceError, match="no lip_opening_node"):
        lip_rim(coarse.drop_vars("lip_opening_node"))
