"""Hierarchical bootstrap compared with loops and closed forms."""

import numpy as np
import pytest
from scipy import stats
from synthetic_scores import fail, of_differences

from analysis.errors import StatisticsError
from analysis.statistics.bootstrap import hierarchical_bootstrap, replicates, tails
from analysis.statistics.paired import compare
from analysis.statistics.simulated import simulated_scores


def test_error_of_a_mean_of_volunteers() -> None:
    """One value per volunteer: the bootstrap variance of the mean is sum (d - mean)^2 / n^2."""
    values = np.array([0.3, 0.1, 0.9, 0.4, -0.2, 0.6])
    drawn = replicates(values[:, None, None, None], "mean", 20_000, 3)
    expected = np.sqrt(((values - values.mean()) ** 2).sum()) / 6
    error = expected / np.sqrt(2 * 20_000)
    assert abs(drawn.std() - expected) < 4 * error
    assert abs(drawn.mean() - values.mean()) < 4 * expected / np.sqrt(20_000)


def test_error_of_repetitions_within_volunteers() -> None:
    """Equal volunteers with different repetitions: variance sum / (n r^2) of the draw of repetitions."""
    within = np.array([-0.3, 0.1, 0.2, 0.4])
    cells = np.tile(within, (5, 1, 1))[:, :, :, None]
    drawn = replicates(cells, "mean", 20_000, 3)
    expected = np.sqrt(((within - within.mean()) ** 2).mean() / 4 / 5)
    assert abs(drawn.std() - expected) < 4 * expected / np.sqrt(2 * 20_000)


def test_median_of_pairs_and_bounds() -> None:
    cube = fail(simulated_scores(3, effects=(0.0, 0.5, 0.5)), volunteer="v1", repetition=1)
    tested = hierarchical_bootstrap(compare(cube, scale="raw"), draws=300, seed=8)
    pairs = cube["rho"].sel(strategy="act_3") - cube["rho"].sel(strategy="act_all")
    assert float(tested["estimate"][0]) == pytest.approx(float(pairs.median()))
    cells = pairs.transpose("volunteer", "instruction", "repetition", "marker").values
    drawn = replicates(cells, "median", 300, 8)
    np.testing.assert_allclose(
        tested["interval"][0], np.quantile(drawn, tails(6, 0.95, "expanded"))
    )
    assert np.isnan(tested["p"]).all()
    again = hierarchical_bootstrap(compare(cube, scale="raw"), draws=300, seed=8)
    assert again.identical(tested)
    assert not hierarchical_bootstrap(compare(cube, scale="raw"), draws=300, seed=9)[
        "interval"
    ].equals(tested["interval"])


def test_expanded_tails() -> None:
    """sqrt(n / (n - 1)) times the t quantile as a normal quantile: 0.0024 for six."""
    low, high = tails(6, 0.95, "expanded")
    assert low == pytest.approx(stats.norm.sf(np.sqrt(6 / 5) * 2.570582), rel=1e-5)
    assert low == pytest.approx(0.0024, abs=5e-5)
    assert low + high == pytest.approx(1.0)
    assert tails(6, 0.95, "percentile") == pytest.approx((0.025, 0.975))


def test_draws_without_pairs_are_omitted() -> None:
    tested = hierarchical_bootstrap(
        compare(of_differences([0.1, 0.2, 0.4, 0.3, 0.2, np.nan]), scale="raw"), draws=500
    )
    assert int(tested["n"][0]) == 5
    assert np.isfinite(tested["interval"]).all()


def test_impossible_options() -> None:
    cube = simulated_scores(0)
    with pytest.raises(StatisticsError, match="'mode' and 'expanded'"):
        hierarchical_bootstrap(compare(cube, scale="raw"), statistic="mode")
    with pytest.raises(StatisticsError, match="10 bootstrap samples"):
        hierarchical_bootstrap(compare(cube, scale="raw"), draws=10)


@pytest.mark.parametrize("dim", ["volunteer", "instruction", "repetition"])
def test_intervals_do_not_depend_on_the_order_of_the_cube(dim: str) -> None:
    """With 2000 draws, bounds moved by up to 0.05 of rho where repetitions were listed otherwise."""
    cube = simulated_scores(volunteers=5, repetitions=3, seed=4)
    turned = cube.isel({dim: slice(None, None, -1)})
    own, other = (
        hierarchical_bootstrap(compare(c, scale="raw"), draws=200) for c in (cube, turned)
    )
    for name in ("estimate", "interval", "standard_error"):
        np.testing.assert_array_equal(own[name], other[name])
