"""Analyses of variance and mixed models as papers print them, against formulas and our own fit."""

import numpy as np
import pytest
from scipy import stats

from analysis.errors import StatisticsError
from analysis.statistics.as_published import cross_check, repeated_measures
from analysis.statistics.mixed_model import mixed_model
from analysis.statistics.paired import compare, fisher_z
from analysis.statistics.simulated import simulated_scores


def test_two_strategies_have_the_f_of_the_paired_t_test() -> None:
    cube = simulated_scores(3, volunteers=8, instructions=4)
    cube = cube.isel(strategy=[0, 1])
    table = repeated_measures(cube)
    z = fisher_z(cube["rho"]).mean(["repetition", "marker", "instruction"])
    t = stats.ttest_rel(*z.transpose("strategy", "volunteer").values)
    assert table.loc["strategy", "F"] == pytest.approx(t.statistic**2)
    assert table.loc["strategy", "p"] == pytest.approx(t.pvalue)
    assert table["df"].tolist() == [1, 3, 3] and table["df_error"].tolist() == [7, 21, 21]
    assert (table["p_holm"] >= table["p"]).all()


def test_volunteers_without_a_cell_are_left_out() -> None:
    cube = simulated_scores(3, volunteers=6, instructions=3)
    cube["rho"][dict(volunteer=0, instruction=0, strategy=0)] = np.nan
    assert (repeated_measures(cube)["volunteers"] == 5).all()
    with pytest.raises(StatisticsError, match="expected 2 volunteers and one factor"):
        repeated_measures(cube.isel(volunteer=[0, 1]))


def test_a_marker_that_one_strategy_lacks_is_no_effect_of_the_strategy() -> None:
    """Of 100 cubes without effect, in which the means of markers differ, 34 had p < 0.05."""
    cube = simulated_scores(3, volunteers=6, instructions=3, sd_marker=1.0)
    cube["rho"][dict(volunteer=[0, 2], strategy=2, marker=1)] = np.nan
    without = cube.copy(deep=True)
    without["rho"][dict(volunteer=[0, 2], marker=1)] = np.nan
    np.testing.assert_allclose(repeated_measures(cube), repeated_measures(without))


def test_mixed_lm_agrees_with_our_fit_where_it_converges() -> None:
    agreed = 0
    for seed in range(4):
        data = compare(simulated_scores(seed, volunteers=12, instructions=6))
        ours, theirs = mixed_model(data), cross_check(data)
        for contrast in ours["contrast"].values:
            row = theirs.loc[str(contrast)]
            if not row["converged"]:
                assert np.isnan(row["estimate"])
                continue
            agreed += 1
            one = ours.sel(contrast=contrast)
            assert row["estimate"] == pytest.approx(float(one["estimate"]), abs=1e-4)
            assert row["standard_error"] == pytest.approx(float(one["standard_error"]), rel=0.01)
    assert agreed >= 3
