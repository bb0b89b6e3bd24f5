"""Differences that are equal in all volunteers, undefined scores, and flagged trials."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from analysis.alignment_tables import alignment_tables
from analysis.baseline_tables import baseline_instruction_table
from analysis.baselines import BASELINE_VARIABLES, NO_ROOM, SKILL_REASONS, with_baselines
from analysis.sensitivity import sensitivity
from analysis.statistics.bootstrap import hierarchical_bootstrap
from analysis.statistics.equivalence import equivalence
from analysis.statistics.mixed_model import mixed_model
from analysis.statistics.paired import Comparison, compare
from analysis.statistics.ranks import wilcoxon
from analysis.statistics.sign_flip import sign_flip
from analysis.statistics.simulated import simulated_scores

BY_SPREAD: dict[str, Callable[[Comparison], xr.Dataset]] = {
    "equivalence": lambda data: equivalence(data, margin=0.5),
    "mixed model": lambda data: mixed_model(data, scope="these instructions"),
    "mixed model, instructions": mixed_model,
    "bootstrap": lambda data: hierarchical_bootstrap(data, draws=100, statistic="mean"),
}
"""Methods whose error is the spread of the data."""


def moved(change: float, volunteers: int = 6) -> xr.Dataset:
    """Cube in which the second strategy differs from the first by `change` in z, everywhere."""
    cube = simulated_scores(2, volunteers=volunteers, instructions=4, strategies=("a", "b"),
                            effects=(0.0, 0.0), spread=(1.0, 1.0))  # fmt: skip
    z = np.arctanh(cube["rho"])
    both = xr.concat([z.sel(strategy="a"), z.sel(strategy="a") + change], cube["strategy"])
    rho = np.tanh(both.transpose(*cube["rho"].dims)).assign_attrs(units="1")
    return cube.assign(rho=rho)


@pytest.mark.parametrize("name", BY_SPREAD)
@pytest.mark.parametrize("volunteers", [5, 12])
def test_without_spread_there_is_no_p_and_no_interval(name: str, volunteers: int) -> None:
    tested = BY_SPREAD[name](compare(moved(0.3, volunteers))).isel(contrast=0)
    assert np.isnan(tested["p"]) and np.isnan(tested["interval"]).all()
    np.testing.assert_allclose(tested["estimate"], 0.3, atol=1e-9)
    assert "no test and no interval" in str(tested["sentence"].item())


def test_exact_tests_do_not_need_spread() -> None:
    for method in (sign_flip, wilcoxon):
        np.testing.assert_allclose(method(compare(moved(0.3)))["p"][0], 2 / 64)


def test_sensitivity_tests_no_choice_that_changes_all_volunteers_equally() -> None:
    base, other = moved(0.0), moved(0.0)
    rho = np.tanh(np.arctanh(other["rho"]) + 0.2).where(other["strategy"] == "a", other["rho"])
    rho = rho.transpose(*base["rho"].dims).assign_attrs(units="1")
    axis = xr.IndexVariable("threshold", [1.0, 2.0])
    effects = sensitivity(xr.concat([base, other.assign(rho=rho)], axis).assign_attrs(base.attrs))
    assert np.isnan(effects["p"][0]) and np.isnan(effects["p_holm"][0])
    np.testing.assert_allclose(effects["p_sign_flip"][0], 2 / 64)
    assert float(effects["p"][1]) == 1.0  # no difference at all
    assert "significantly" not in effects.attrs["summary"]
    assert "no variation between them" in effects.attrs["summary"]


def test_the_table_counts_the_trials_without_room_for_skill() -> None:
    cube = moved(0.3)
    made = {
        name: xr.DataArray(
            np.full([cube.sizes[dim] for dim in dims], 0.95 if name == "template_rho" else 0.9),
            dims=dims, coords={dim: cube[dim] for dim in dims},
        )
        for name, (dims, _, _) in BASELINE_VARIABLES.items() if name in ("template_rho", "ceiling")
    }  # fmt: skip
    made["template_volunteers"] = made["ceiling"].isel(repetition=0, marker=0, drop=True) * 0 + 5
    extended = with_baselines(cube, made)
    table = baseline_instruction_table(extended)
    counted = sum(int(row[-1]) for row in table.rows)
    assert counted == int((extended["skill_reason"] == NO_ROOM).sum()) == extended["skill"].size > 0
    assert set(np.unique(extended["skill_reason"])) <= set(SKILL_REASONS)


def test_medians_are_given_with_and_without_flagged_trials() -> None:
    cube = moved(0.3)
    flag = xr.zeros_like(cube["rho"].isel(marker=0, drop=True))
    flag[0, 0, 0, 0] = 1.0
    rho = cube["rho"].copy()
    rho[0, 0, 0, 0] = -0.9
    table = alignment_tables(cube.assign(weak_match=flag, rho=rho))["flagged"]
    (_, n, every, n_clean, clean, n_flagged, flagged), second = table.rows
    assert (n, n_clean, n_flagged) == (flag[..., 0].size, flag[..., 0].size - 1, 1)
    assert flagged == -0.9 and clean == np.median(rho.values[..., 0, :].reshape(n, -1)[1:])
    assert every == np.median(rho.values[..., 0, :]) and second[5] == 0 and np.isnan(second[6])
