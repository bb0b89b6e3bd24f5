"""Lip rounding with and without stress stiffening and teeth."""

import pytest
import xarray as xr

from emgface.errors import ActivationError
from emgface.face.simulation_parameters import SimulationParameters
from studies.mechanics.equilibria import equilibria
from studies.mechanics.lip_rounding import Rounding, round_lips

LEVELS = (0.0, 0.5, 1.0)


@pytest.fixture(scope="module")
def rounding(coarse: xr.Dataset) -> Rounding:
    return round_lips(coarse, levels=LEVELS)


def test_stiffening_keeps_the_shape_as_activation_grows(rounding: Rounding) -> None:
    """Fig. 11.10: from half to full activation, stiffening reduces the change of the lips."""
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
    """Fig. 11.12: at the same activation, support increases the protrusion of the lips."""
    full = rounding.table[rounding.table.activation == 1.0].set_index(["stiffening", "support"])
    for factor in (1.0, 10.0):
        with_walls = full.loc[(factor, True), "protrusion (mm)"]
        assert with_walls > 1.2 * full.loc[(factor, False), "protrusion (mm)"] > 0


def test_impossible_equilibria_are_refused(coarse: xr.Dataset) -> None:
    p = SimulationParameters(gravity=False)
    with pytest.raises(ActivationError, match="unknown muscle 'NOSE_L'"):
        equilibria(coarse, {"NOSE_L": 1.0}, p)
    with pytest.raises(ActivationError, match="do not ascend"):
        equilibria(coarse, {"OOP_L": 1.0}, p, levels=(0.0, 0.5, 0.5))
