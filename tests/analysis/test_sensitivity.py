"""Significance of axes with and without effect on the scores."""

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from statsmodels.stats.multitest import multipletests
from synthetic_scores import fail

from analysis.errors import StatisticsError
from analysis.sensitivity import sensitivity
from analysis.statistics.paired import volunteer_means
from analysis.statistics.sign_flip import sign_flip_p, sign_patterns
from analysis.statistics.simulated import simulated_scores

CHANGE = {"signal": 0.0, "feature": 0.3, "activation": 0.2}


def factorial(**options: object) -> xr.Dataset:
    """mapping_stage moves z by `CHANGE`, not quite the same in all volunteers; phase only adds noise."""
    base = simulated_scores(3, **options)
    rng = np.random.default_rng(1)
    stages: list[xr.Dataset] = []
    persons = xr.DataArray(rng.normal(size=base.sizes["volunteer"]), dims="volunteer")
    persons -= persons.mean()
    for change in CHANGE.values():
        own = (change * (1.0 + 0.01 * persons)).broadcast_like(base["rho"])
        own = own.transpose(*base["rho"].dims).values
        phases: list[xr.Dataset] = []
        for phase in ("zero", "causal"):
            noise = 0.02 * rng.normal(size=base["rho"].shape) * (phase != "zero")
            rho = np.tanh(np.arctanh(base["rho"]) + own + noise)
            phases.append(base.assign(rho=rho.assign_attrs(units="1")))
        stages.append(xr.concat(phases, xr.IndexVariable("phase", ["zero", "causal"])))
    cube = xr.concat(stages, xr.IndexVariable("mapping_stage", list(CHANGE)))
    return cube.assign_attrs(base.attrs)


def one_strategy_moved(seed: int = 5, volunteers: int = 6) -> xr.Dataset:
    """act_all increases in all volunteers, the others decrease in some; their mean hardly changes."""
    base = simulated_scores(seed, volunteers=volunteers, instructions=6)
    rng = np.random.default_rng(seed)
    own = rng.normal(size=(volunteers, 3)) * [0.06, 0.15, 0.15] + [0.25, -0.05, -0.08]
    change = xr.DataArray(own, dims=("volunteer", "strategy"))
    rho = np.tanh(np.arctanh(base["rho"]) + change).transpose(*base["rho"].dims)
    moved = base.assign(rho=rho.assign_attrs(units="1"))
    axis = xr.IndexVariable("normalisation_reach", ["trial", "session"])
    return xr.concat([base, moved], axis).assign_attrs(base.attrs)


def test_planted_axis_is_found() -> None:
    effects = sensitivity(factorial())
    assert list(effects["choice"].values[:4]) == [
        "mapping_stage = feature, act_all",
        "mapping_stage = feature, act_3",
        "mapping_stage = feature, act_rel",
        "mapping_stage = activation, act_all",
    ]
    np.testing.assert_allclose(effects["estimate"], [0.3] * 3 + [0.2] * 3 + [0.0] * 3, atol=0.03)
    assert (effects["p_holm"][:6] < 1e-6).all()
    assert (effects["p_holm"][6:] > 0.05).all()
    np.testing.assert_allclose(effects["reach"][0], 0.3, atol=1e-9)
    text = effects.attrs["summary"]
    assert text.startswith(
        "rho changes significantly, after Holm's correction over 9 tests, with mapping_stage"
    )
    assert "phase" not in text.partition("Of the same sign")[0].partition("The other")[0]
    assert "are not significant, but may exist" in text
    assert effects.attrs["reference"] == "mapping_stage = signal, phase = zero"


def test_an_effect_on_one_strategy_is_found_although_the_mean_hardly_changes() -> None:
    cube = one_strategy_moved()
    effects = sensitivity(cube)
    by_strategy = {
        str(label): effects.sel(choice=effects["strategy"] == label)
        for label in cube["strategy"].values
    }
    assert int(by_strategy["act_all"]["rises"][0]) == 6
    assert float(by_strategy["act_all"]["p_holm"][0]) < 0.05
    assert (effects["p_holm"][1:] > 0.05).all()
    assert (
        "normalisation_reach = session, act_all (+0.23 in z, rises in 6 of 6)"
        in (effects.attrs["summary"])
    )
    # A pooled test of raw rho would not be significant.
    raw = cube["rho"].sel(normalisation_reach="session", drop=True) - cube["rho"].sel(
        normalisation_reach="trial", drop=True
    )
    pooled = volunteer_means(raw).values
    assert sign_flip_p(pooled, sign_patterns(6)) > 0.05


def test_p_and_interval_are_those_of_the_paired_t_test() -> None:
    cube = one_strategy_moved()
    effects = sensitivity(cube)
    z = np.arctanh(cube["rho"])
    change = z.sel(normalisation_reach="session", drop=True) - z.sel(
        normalisation_reach="trial", drop=True
    )
    for k, strategy in enumerate(cube["strategy"].values):
        values = volunteer_means(change.sel(strategy=strategy)).values
        peer = stats.ttest_1samp(values, 0.0)
        assert float(effects["p"][k]) == pytest.approx(peer.pvalue)
        np.testing.assert_allclose(effects["interval"][k], peer.confidence_interval())
        assert float(effects["p_sign_flip"][k]) == sign_flip_p(values, sign_patterns(6))
    np.testing.assert_allclose(effects["p_holm"], multipletests(effects["p"], method="holm")[1])


def test_too_few_volunteers_for_a_test_of_choices() -> None:
    effects = sensitivity(one_strategy_moved(volunteers=4))
    assert np.isnan(effects["p"]).all() and np.isnan(effects["interval"]).all()
    assert np.isfinite(effects["estimate"]).all()
    assert effects.attrs["summary"].startswith("No test is performed: 4 volunteers with pairs")


def test_a_choice_without_effect_is_reported_as_such() -> None:
    cube = one_strategy_moved()
    same = cube["rho"].sel(normalisation_reach="trial", strategy="act_3", drop=True)
    rho = xr.where(cube["strategy"] == "act_3", same, cube["rho"], keep_attrs=True)
    effects = sensitivity(cube.assign(rho=rho.transpose(*cube["rho"].dims).assign_attrs(units="1")))
    assert list(effects["p"].values == 1.0) == [False, True, False]
    assert "1 of the tests show no change in any volunteer" in effects.attrs["summary"]


def test_raw_change_by_hand() -> None:
    cube = factorial()
    effects = sensitivity(cube, scale="raw")
    at = {"phase": "zero", "strategy": "act_all"}
    change = cube["rho"].sel(mapping_stage="feature", **at) - cube["rho"].sel(
        mapping_stage="signal", **at
    )
    expected = float(volunteer_means(change.drop_vars(["phase"])).mean())
    assert float(effects["estimate"][0]) == pytest.approx(expected)


def test_reference_may_be_another_level_and_corners_may_be_missing() -> None:
    cube = factorial()
    cube = fail(cube, mapping_stage=["signal", "activation"], phase="causal")
    effects = sensitivity(cube, reference={"mapping_stage": "feature"})
    assert list(effects["level"].values[::3]) == ["signal", "activation", "causal"]
    np.testing.assert_allclose(effects["estimate"][:6], [-0.3] * 3 + [-0.1] * 3, atol=1e-9)
    assert int(effects["lost_failed"].sum()) == 0
    other = sensitivity(cube, axes=["phase"])
    assert other.sizes["choice"] == 3
    assert int(other["lost_failed"].sum()) == cube["rho"][0, 0].size
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
