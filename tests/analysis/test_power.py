"""Power against closed forms."""

from itertools import combinations

import numpy as np
import pytest
from scipy.stats import norm
from statsmodels.stats.power import TTestPower
from synthetic_scores import of_differences

from analysis.errors import StatisticsError
from analysis.statistics.paired import compare
from analysis.statistics.power import detectable, power, simulated_power
from analysis.statistics.sign_flip import joint_p
from analysis.statistics.simulated import simulated_scores


def within(estimated, expected) -> None:
    """Within four Monte Carlo errors of the truth."""
    error = np.sqrt(
        np.asarray(expected) * (1 - np.asarray(expected)) / estimated.attrs["simulations"]
    )
    assert (np.abs(estimated["power"].values - expected) <= 4 * error).all()


def test_t_test_has_the_noncentral_power() -> None:
    estimate = simulated_power(0.5, 0.6, volunteers=(4, 6, 12, 20), test="t", simulations=4000)
    exact = [TTestPower().power(0.5 / 0.6, n, 0.05) for n in (4, 6, 12, 20)]
    within(estimate, exact)


@pytest.mark.parametrize("test", ["sign_flip", "wilcoxon"])
def test_six_volunteers_must_all_agree(test: str) -> None:
    """Only the two patterns of one sign reach 2/64, so power is P(all +) + P(all -)."""
    estimate = simulated_power(0.5, 0.6, volunteers=(5, 6), test=test, simulations=4000)
    plus = norm.cdf(0.5 / 0.6)
    within(estimate, [0.0, plus**6 + (1 - plus) ** 6])
    np.testing.assert_allclose(estimate["smallest_p"], [2 / 32, 2 / 64])


def test_without_an_effect_power_is_size() -> None:
    estimate = simulated_power(0.0, 1.0, volunteers=(6, 16), simulations=4000)
    within(estimate, [2 / 64, 0.05])


def test_volunteers_needed() -> None:
    estimate = simulated_power(0.5, 0.6, volunteers=(20, 6, 12))
    assert float(estimate["volunteers_needed"]) == 20
    assert "requires 20 volunteers" in estimate.attrs["sentence"]
    never = simulated_power(0.01, 0.6, volunteers=(6, 12))
    assert np.isnan(float(never["volunteers_needed"]))
    assert "requires more than 12" in never.attrs["sentence"]


@pytest.mark.parametrize("test", ["sign_flip", "t"])
def test_smallest_difference_that_six_volunteers_show(test: str) -> None:
    """Equal signs with probability 0.8, or the noncentral t; the simulation has an error of 3 %."""
    exact = norm.ppf(0.8 ** (1 / 6))
    if test == "t":
        exact = TTestPower().solve_power(nobs=6, alpha=0.05, power=0.8)
    assert detectable(6, test=test) == pytest.approx(exact, rel=0.03)
    assert np.isinf(detectable(5, test="sign_flip"))


@pytest.mark.parametrize("strategies", [2, 3, 4])
def test_the_smallest_difference_is_detected_by_the_test_of_the_report(strategies: int) -> None:
    """The report judges a contrast by its p over all contrasts jointly: 62 % with that of one alone."""
    pairs = list(combinations(range(strategies), 2))
    size = detectable(6, test="sign_flip", contrasts=len(pairs))
    values = np.random.default_rng(8).standard_normal((600, strategies, 6))
    values[:, -1] += np.sqrt(2) * size  # the standard deviation of a difference
    smallest = [joint_p([one[b] - one[a] for a, b in pairs], 999, 0)[-1] for one in values]
    error = np.sqrt(0.8 * 0.2 / len(smallest))
    assert np.mean(np.array(smallest) <= 0.05) == pytest.approx(0.8, abs=4 * error)


def test_the_strictest_step_of_holm() -> None:
    exact = TTestPower().solve_power(nobs=8, alpha=0.05 / 5, power=0.8)
    assert detectable(8, test="t", contrasts=5) == pytest.approx(exact, rel=0.03)


def test_power_of_a_cube() -> None:
    cube = simulated_scores(3, effects=(0.0, 0.6, 0.6))
    planned = power(compare(cube), effect=0.4, volunteers=(6, 20), simulations=300)
    spread = planned["standard_deviation"]
    assert (spread.diff("spread") > 0).all()
    # Power decreases with the variance and increases with the number of volunteers.
    assert (planned["power"].diff("spread") <= 0).all()
    assert (planned["power"].diff("volunteers") >= 0).all()
    assert "to detect a difference of +0.40 in z with power 0.8" in str(
        planned["sentence"].values[0]
    )


def test_cubes_without_variance_are_refused() -> None:
    for values in ([0.4], [0.4, 0.4, 0.4]):
        planned = power(compare(of_differences(values)), simulations=10)
        assert np.isnan(planned["power"]).all()
        assert "no variation, which planning requires" in planned.attrs["sentence"]


@pytest.mark.parametrize(
    "options",
    [
        {"standard_deviation": 0.0},
        {"effect": np.nan},
        {"test": "z"},
        {"volunteers": (1, 6)},
        {"volunteers": ()},
        {"alpha": 5},
        {"target": 80},
    ],
)
def test_impossible_options(options: dict) -> None:
    with pytest.raises(StatisticsError):
        simulated_power(**{"effect": 0.5, "standard_deviation": 1.0, **options})
