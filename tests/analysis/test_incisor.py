"""Scores of the lower incisor in a cube: tests and tables apply to them as to those of the lips."""

import numpy as np
import pytest
import xarray as xr

from analysis.cube import OF_INCISOR, build_cube
from analysis.errors import CubeError
from analysis.incisor import INCISOR, incisor_table, of_incisor
from analysis.listing import trials
from analysis.statistics.summary import study_statistics
from analysis.trial import Trial

LIPS = ("corner_left", "corner_right")


def results() -> list[Trial]:
    """Six persons: rho of the incisor is higher with the second strategy, of the lips with the first."""
    trials = list[Trial]()
    for k in range(6):
        for strategy, lips, own in (("act_all", 0.9, 0.3), ("act_3", 0.5, 0.8)):
            scores = xr.Dataset(
                {name: ("marker", [lips - 0.01 * k] * 2) for name in ("rho", "amplitude_ratio", "rmse")}
                | {"incisor_rho": own + 0.01 * k, "incisor_amplitude_ratio": 1.5, "incisor_rmse": 2e-3},
                coords={"marker": list(LIPS)},
            )  # fmt: skip
            if k == 5:  # the incisor was not recorded in this person
                scores = scores.drop_vars(list(OF_INCISOR))
            trials.append(Trial(f"v{k}", "A", 1, strategy, scores, origin="simulated"))
    return trials


def test_statistics_of_the_incisor_are_its_own() -> None:
    cube = build_cube(results(), incisor=True)
    own = of_incisor(cube)
    assert own["marker"].values.tolist() == [INCISOR] and own["rho"].dims == cube["rho"].dims
    assert own["rho"].attrs["units"] == "1" and own["rmse"].attrs["units"] == "m"
    contrast = [("act_3", "act_all")]
    estimates = []
    for one in (own, cube):
        statistics = study_statistics(one, draws=100)["sign_flip"]
        assert [tuple(str(c).split(" - ")) for c in statistics["contrast"].values] in (
            contrast,
            [("act_all", "act_3")],
        )
        estimates.append(
            (
                str(statistics["contrast"].values[0]),
                float(statistics["estimate"][0]),
                int(statistics["n"][0]),
            )
        )
    assert estimates[0][0] == estimates[1][0] and estimates[0][1] * estimates[1][1] < 0.0
    assert [n for *_, n in estimates] == [5, 6]
    table = incisor_table(cube)
    assert table is not None and table.origin == "simulated"
    rows = {row[1]: row[2:] for row in table.rows}
    assert rows["act_3"] == pytest.approx((5, 0.82, 0.81, 0.83, 1.5, 2e-3))
    assert trials(cube)["incisor_rho"].notna().sum() == 10


def test_cubes_of_faces_have_no_incisor() -> None:
    cube = build_cube(results())  # their statistics and files are as before
    assert not set(OF_INCISOR) & set(cube.data_vars)
    with pytest.raises(CubeError, match=r"no scores of the incisor.*study on a head"):
        of_incisor(cube)
    assert incisor_table(cube) is None
    silent = build_cube(results()[-2:], incisor=True)
    assert np.isnan(silent["incisor_rho"].values).all() and incisor_table(silent) is None
