"""Sign-flip test compared with enumeration, SciPy and Fisher's example."""

import itertools

import numpy as np
import pytest
from scipy.stats import permutation_test
from synthetic_scores import fail, of_differences

from analysis.errors import StatisticsError
from analysis.statistics.paired import compare, fisher_z, paired
from analysis.statistics.sign_flip import (
    sign_flip,
    sign_flip_interval,
    sign_flip_p,
    sign_patterns,
)
from analysis.statistics.simulated import simulated_scores

MAIZE = [49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48]
"""Darwin's fifteen differences in height of maize, in eighths of an inch (Fisher 1935)."""


def brute(values: np.ndarray) -> float:
    sums = [abs(np.dot(s, values)) for s in itertools.product((1, -1), repeat=len(values))]
    return float(np.mean(np.array(sums) >= abs(values.sum()) - 1e-9))


def test_fishers_example() -> None:
    """Section 21: 1726 of 32768 patterns reach the observed sum, 5.267 %."""
    p = sign_flip_p(np.array(MAIZE, dtype=float), sign_patterns(15))
    assert p == 1726 / 32768


@pytest.mark.parametrize("n", range(2, 9))
def test_against_enumeration_and_scipy(n: int) -> None:
    rng = np.random.default_rng(n)
    for values in (rng.normal(0.5, 1, n), rng.integers(-3, 4, n).astype(float)):
        p = sign_flip_p(values, sign_patterns(n))
        assert p == pytest.approx(brute(values), abs=1e-12)
        if n > 2 and len(np.unique(np.abs(values))) == n:
            peer = permutation_test(
                (values,), np.mean, permutation_type="samples", n_resamples=np.inf
            )
            assert p == pytest.approx(peer.pvalue, abs=1e-12)


@pytest.mark.parametrize(("n", "level"), [(6, 0.95), (7, 0.9), (8, 0.95), (6, 0.6)])
def test_interval_holds_exactly_the_shifts_not_rejected(n: int, level: float) -> None:
    values = np.random.default_rng(3 * n).normal(0.4, 1, n)
    patterns = sign_patterns(n)
    low, high, coverage = sign_flip_interval(values, patterns, level)
    assert coverage >= level
    for bound, outside in ((low, -1e-6), (high, 1e-6)):
        assert brute(values - bound - outside) <= 1 - level + 1e-12
        assert brute(values - bound + outside) > 1 - level
    middle = np.linspace(low, high, 7)[1:-1]
    assert all(brute(values - shift) > 1 - level for shift in middle)


def test_six_volunteers_reach_one_in_thirty_two() -> None:
    tested = sign_flip(compare(of_differences([0.2, 0.5, 0.4, 0.9, 0.1, 0.3])))
    assert float(tested["p"][0]) == float(tested["smallest_p"][0]) == 2 / 64
    assert float(tested["estimate"][0]) == pytest.approx(0.4)
    np.testing.assert_allclose(tested["interval"][0], [0.1, 0.9])
    assert float(tested["coverage"][0]) == 1 - 2 / 64
    assert "smallest p possible 0.031" in str(tested["sentence"].values[0])


def test_five_volunteers_allow_no_95_percent_interval() -> None:
    tested = sign_flip(compare(of_differences([0.2, 0.5, 0.4, 0.9, 0.1])))
    assert np.isinf(tested["interval"]).all()
    assert "no bounded 95 % interval" in tested.attrs["sentence"]


def test_random_patterns_beyond_sixteen() -> None:
    """17 volunteers: within four Monte Carlo errors of all 2^16 patterns."""
    values = np.random.default_rng(1).normal(0.2, 1, 17)
    exact = np.abs(np.array([1 - 2 * ((k >> np.arange(17)) & 1) for k in range(2**16)]) @ values)
    p = float(np.mean(exact >= abs(values.sum()) - 1e-9))
    drawn = sign_flip_p(values, sign_patterns(17, 20_000, 5))
    assert 0.01 < p < 0.5
    assert abs(drawn - p) < 4 * np.sqrt(p * (1 - p) / 20_000)


def test_joint_p_by_enumeration() -> None:
    cube = simulated_scores(4, effects=(0.0, 0.5, 0.4))
    tested = sign_flip(compare(cube))
    labels = [("act_3", "act_all"), ("act_rel", "act_all"), ("act_rel", "act_3")]
    table = np.array([paired(cube, *pair).values for pair in labels])
    t = np.abs(table.sum(axis=1)) / np.sqrt((table**2).sum(axis=1))
    largest = [
        max(np.abs(table @ s) / np.sqrt((table**2).sum(axis=1)))
        for s in itertools.product((1, -1), repeat=6)
    ]
    expected = [np.mean(np.array(largest) >= each - 1e-12) for each in t]
    np.testing.assert_allclose(tested["p_joint"], expected)
    assert (tested["p_joint"] >= tested["p"] - 1e-12).all()


def test_pairs_by_hand() -> None:
    """Differences within trial and marker, averaged over repetitions, then over the others."""
    cube = fail(simulated_scores(2), volunteer="v2", instruction="i1", repetition=1)
    cube = fail(cube, volunteer="v3", instruction="i2", strategy="act_3")
    cube["rho"].loc[{"volunteer": "v4", "marker": "marker_1", "strategy": "act_all"}] = np.nan
    pairs = paired(cube, "act_3", "act_all")
    z = np.arctanh(cube["rho"])
    for volunteer in cube["volunteer"].values:
        cells = []
        for instruction in cube["instruction"].values:
            for marker in cube["marker"].values:
                both = [
                    float(z.sel(strategy="act_3", **at) - z.sel(strategy="act_all", **at))
                    for repetition in cube["repetition"].values
                    for at in [
                        {
                            "volunteer": volunteer,
                            "instruction": instruction,
                            "repetition": repetition,
                            "marker": marker,
                        }
                    ]
                ]
                both = [value for value in both if np.isfinite(value)]
                if both:
                    cells.append(np.mean(both))
        assert float(pairs.means.sel(volunteer=volunteer)) == pytest.approx(np.mean(cells))
    assert pairs.counts == {
        "pairs": 72 - 3 - 6 - 4,
        "lost_failed": 9,
        "lost_excluded": 0,
        "lost_missing": 0,
        "lost_undefined": 4,
        "clipped": 0,
    }


def test_missing_and_failed_trials_are_distinguished() -> None:
    cube = simulated_scores(2)
    at = {"volunteer": "v1", "repetition": 2, "strategy": "act_rel"}
    cube["status"].loc[at] = "missing"
    cube["rho"].loc[at] = np.nan
    tested = sign_flip(compare(cube))
    assert list(tested["lost_missing"].values) == [0, 6, 6]
    assert "6 of 72 pairs are missing (6 missing)" in str(tested["sentence"].values[1])
    assert list(tested["verdict"].values[:, 2]) == ["met", "doubtful", "doubtful"]
    cube["status"].loc[at] = "excluded"
    tested = sign_flip(compare(cube))
    assert list(tested["lost_excluded"].values) == [0, 6, 6]
    assert "6 of 72 pairs are missing (6 excluded)" in str(tested["sentence"].values[1])


def test_fisher_z_is_clipped_and_counted() -> None:
    cube = simulated_scores(2)
    cube["rho"][0, 0, 0, 0, 0] = 1.0
    tested = sign_flip(compare(cube))
    assert list(tested["clipped"].values) == [1, 1, 0]
    assert np.isfinite(tested["estimate"]).all()
    z = fisher_z(cube["rho"], limit=0.9)
    assert float(z.max()) == pytest.approx(np.arctanh(0.9))
    inside = abs(cube["rho"]) < 0.9
    np.testing.assert_allclose(z.where(inside), np.arctanh(cube["rho"].where(inside)))


def test_other_variables_keep_their_unit() -> None:
    tested = sign_flip(compare(simulated_scores(2), variable="rmse"))
    assert tested["estimate"].attrs["units"] == "m"
    assert " mm over 6 volunteers" in tested.attrs["sentence"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"contrasts": [("act_3", "act_4")]}, "cannot compare 'act_3' with 'act_4'"),
        ({"contrasts": [("act_3", "act_3")]}, "cannot compare"),
        ({"variable": "status"}, "cannot test 'status', expected one of rho"),
        ({"variable": "rmse", "scale": "log"}, "the scale is 'log'"),
        ({"limit": 1.0}, "limit of Fisher's z is 1.0"),
    ],
)
def test_impossible_options(options: dict, words: str) -> None:
    with pytest.raises(StatisticsError, match=words):
        compare(simulated_scores(0), **options)


def test_wrong_cubes() -> None:
    cube = simulated_scores(0)
    with pytest.raises(StatisticsError, match="further dims threshold"):
        sign_flip(compare(cube.expand_dims(threshold=[1, 2])))
    with pytest.raises(StatisticsError, match="lacks the dim repetition"):
        sign_flip(compare(cube.isel(repetition=0)))
    cube["rho"][0] = 2.0
    with pytest.raises(StatisticsError, match="found a correlation of 2"):
        sign_flip(compare(cube))


def test_a_level_is_a_probability() -> None:
    with pytest.raises(StatisticsError, match="the level is 95"):
        sign_flip(compare(simulated_scores(0)), level=95)
