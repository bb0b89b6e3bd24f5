"""Stiffness measured by a small probe along and perpendicular to the tension lines."""

import numpy as np
import pytest
import xarray as xr

from emgface.errors import FaceError
from emgface.face.simulation_parameters import SimulationParameters
from studies.mechanics.skin_probe import probe_skin


def test_tension_raises_the_measured_stiffness_along_the_lines(
    coarse: xr.Dataset,
) -> None:
    def along(**prestress: object) -> np.ndarray:
        p = SimulationParameters.model_validate(
            {"gravity": False, "sigma_max": 100e3, "skin": {"kappa": 250e3}, "prestress": prestress}
        )
        return probe_skin(coarse, p, places=4)["along (N/m)"].to_numpy()

    none = along()
    least, most = (along(method="stretch", along=stress) for stress in (15.9e3, 89.4e3))
    assert (none > 0).all()
    assert (least > 1.02 * none).all() and (most > 1.1 * least).all()
    inner = np.flatnonzero(coarse["layer"].values == 0)[:1]
    with pytest.raises(FaceError, match="is not on the skin"):
        probe_skin(coarse, SimulationParameters(gravity=False), elements=[int(inner[0])])
