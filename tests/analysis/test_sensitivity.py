"""Axes that move the scores are told from those that do not."""

import numpy as np
import pytest
import xarray as xr
from synthetic_scores import fail

from analysis.errors import StatisticsError
from analysis.sensitivity import sensitivity
from analysis.statistics.calibration import simulated_scores
from analysis.statistics.paired import volunteer_means

CHANGE = {"signal": 0.0, "feature": 0.3, "activation": 0.2}


def factorial(**options: object) -> xr.Dataset:
    """mapping_stage moves z by `CHANGE`, phase only adds noise."""
    base = simulated_scores(3, **options)
    rng = np.random.default_rng(1)
    stages: list[xr.Dataset] = []
    for change in CHANGE.values():
        phases: list[xr.Dataset] = []
        for phase in ("zero", "causal"):
            noise = 0.02 * rng.normal(size=base["rho"].shape) * (phase != "zero")
            rho = np.tanh(np.arctanh(base["rho"]) + change + noise)
            phases.append(base.assign(rho=rho.assign_attrs(units="1")))
        stages.append(xr.concat(phases, xr.IndexVariable("phase", ["zero", "causal"])))
    cube = xr.concat(stages, xr.IndexVariable("mapping_stage", list(CHANGE)))
    return cube.assign_attrs(base.attrs)


def test_planted_axis_is_found() -> None:
    cube = factorial()
    found = sensitivity(cube, scale="z")
    assert list(found["choice"].values) == [
        "mapping_stage = feature",
        "mapping_stage = activation",
        "phase = causal",
    ]
    np.testing.assert_allclose(found["estimate"][:2], [0.3, 0.2], atol=1e-9)
    assert abs(float(found["estimate"][2])) < 0.02
    np.testing.assert_allclose(found["by_strategy"][:2], [[0.3] * 3, [0.2] * 3], atol=1e-9)
    np.testing.assert_allclose(found["p"][:2], 2 / 64)
    np.testing.assert_allclose(found["reach"][0], 0.3, atol=1e-9)
    text = found.attrs["summary"]
    assert text.startswith("rho moves with mapping_stage (up to 0.30). No change of rho is shown")
    assert found.attrs["reference"] == "mapping_stage = signal, phase = zero"


def test_raw_change_by_hand() -> None:
    cube = factorial()
    found = sensitivity(cube)
    at = {"phase": "zero"}
    change = cube["rho"].sel(mapping_stage="feature", **at) - cube["rho"].sel(
        mapping_stage="signal", **at
    )
    expected = float(volunteer_means(change.drop_vars(["phase"])).mean())
    assert float(found["estimate"][0]) == pytest.approx(expected)


def test_reference_may_be_another_level_and_corners_may_be_missing() -> None:
    cube = factorial()
    cube = fail(cube, mapping_stage=["signal", "activation"], phase="causal")
    found = sensitivity(cube, reference={"mapping_stage": "feature"}, scale="z")
    assert list(found["level"].values) == ["signal", "activation", "causal"]
    np.testing.assert_allclose(found["estimate"][:2], [-0.3, -0.1], atol=1e-9)
    assert int(found["lost_failed"].sum()) == 0
    other = sensitivity(cube, axes=["phase"])
    assert other.sizes["choice"] == 1
    assert int(other["lost_failed"][0]) == cube["rho"][0, 0].size
    assert np.isnan(float(other["estimate"][0]))


def test_impossible_options() -> None:
    cube = factorial()
    with pytest.raises(StatisticsError, match="along nothing: the cube has the further dims none"):
        sensitivity(simulated_scores(0))
    with pytest.raises(StatisticsError, match="along threshold"):
        sensitivity(cube, axes=["threshold"])
    with pytest.raises(StatisticsError, match="phase = late is not in the cube"):
        sensitivity(cube, reference={"phase": "late"})
    with pytest.raises(StatisticsError, match="no variable 'speed'"):
        sensitivity(cube, variable="speed")
