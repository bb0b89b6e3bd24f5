"""Measures of the mouth opening, and lip rounding with and without stress stiffening and teeth."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib import image

from emgface.errors import ActivationError, FaceError
from emgface.face.equilibria import equilibria
from emgface.face.lip_rounding import Rounding, round_lips
from emgface.face.lip_shape import lip_rim, lip_shape
from emgface.face.show_displacement import draw_displacement
from emgface.face.simulation_parameters import SimulationParameters

LEVELS = (0.0, 0.5, 1.0)


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


@pytest.fixture(scope="module")
def rounding(coarse: xr.Dataset) -> Rounding:
    return round_lips(coarse, levels=LEVELS)


def test_stiffening_keeps_the_shape_as_activation_grows(rounding: Rounding) -> None:
    """Fig. 11.10: from half to full activation a stiffening muscle changes the lips less."""
    table = rounding.table.set_index(["support", "stiffening", "activation"])
    for support in (False, True):
        for name in ("height (mm)", "protrusion (mm)"):
            change = {
                factor: abs(
                    table.loc[(support, factor, 1.0), name]
                    - table.loc[(support, factor, 0.5), name]
                )
                for factor in (1.0, 10.0)
            }
            assert change[10.0] < 0.7 * change[1.0], (support, name)
    assert table.loc[(False, 1.0, 1.0), "overlap (mm2)"] > 10, "without, the lips pass through"
    assert table.loc[(False, 10.0, 1.0), "height (mm)"] > 0, "with it they stay open"


def test_teeth_support_protrusion(rounding: Rounding) -> None:
    """Fig. 11.12: the same activation protrudes the lips further with support behind them."""
    full = rounding.table[rounding.table.activation == 1.0].set_index(["stiffening", "support"])
    for factor in (1.0, 10.0):
        with_walls = full.loc[(factor, True), "protrusion (mm)"]
        assert with_walls > 1.2 * full.loc[(factor, False), "protrusion (mm)"] > 0


def test_picture_of_displacement(coarse: xr.Dataset, rounding: Rounding, tmp_path: Path) -> None:
    shown = {"half": rounding.motion[True, 1.0]["node_position"].values[1]}
    path = draw_displacement(
        coarse, shown, tmp_path / "new" / "lips.png", title="simulated", columns=("front",), dpi=40
    )
    pixels = image.imread(path)[..., :3]
    assert np.mean(np.ptp(pixels, axis=2) > 0.1) > 0.1, "coloured skin and a scale"


def test_what_cannot_be_held_is_refused(coarse: xr.Dataset) -> None:
    p = SimulationParameters(gravity=False)
    with pytest.raises(ActivationError, match="unknown muscle 'NOSE_L'"):
        equilibria(coarse, {"NOSE_L": 1.0}, p)
    with pytest.raises(ActivationError, match="do not ascend"):
        equilibria(coarse, {"OOP_L": 1.0}, p, levels=(0.0, 0.5, 0.5))
