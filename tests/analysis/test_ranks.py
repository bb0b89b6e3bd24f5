"""Rank tests against SciPy, enumeration and published examples."""

import itertools

import numpy as np
import pytest
from scipy import stats
from synthetic_scores import fail, of_differences, of_rho

from analysis.statistics.paired import compare
from analysis.statistics.ranks import (
    friedman,
    friedman_p,
    hodges_lehmann,
    wilcoxon,
    wilcoxon_p,
)
from analysis.statistics.simulated import simulated_scores

BEFORE = [1.83, 0.50, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.30]
AFTER = [0.878, 0.647, 0.598, 2.05, 1.06, 1.29, 1.06, 3.14, 1.29]
"""Hamilton depression scale factor IV of nine patients (Hollander and Wolfe, Table 3.1)."""


def test_published_signed_ranks() -> None:
    """Sum of ranks 40, one-sided p 0.0195; estimate 0.46 with 96.1 % interval 0.010 to 0.786."""
    values = np.array(BEFORE) - np.array(AFTER)
    assert wilcoxon_p(values) == (40.0, pytest.approx(2 * 0.01953125))
    middle, low, high, level = hodges_lehmann(values, 0.95)
    assert (middle, low, high) == pytest.approx((0.46, 0.010, 0.786), abs=1e-9)
    assert level == pytest.approx(0.961, abs=5e-4)


@pytest.mark.parametrize("n", [3, 6, 11])
def test_signed_ranks_against_scipy(n: int) -> None:
    values = np.random.default_rng(n).normal(0.3, 1, n)
    peer = stats.wilcoxon(values, method="exact")
    assert wilcoxon_p(values)[1] == pytest.approx(peer.pvalue, abs=1e-14)


def test_signed_ranks_with_ties_and_zeros_by_enumeration() -> None:
    values = np.array([0.0, 1.0, 1.0, -1.0, 2.0, 2.0, 3.0, -3.0])
    moved = values[values != 0]
    ranks = stats.rankdata(np.abs(moved))
    sums = np.array([
        sum(r for r, s in zip(ranks, signs, strict=True) if s)
        for signs in itertools.product((0, 1), repeat=len(moved))
    ])  # fmt: skip
    statistic = ranks[moved > 0].sum()
    expected = min(1.0, 2 * min(np.mean(sums <= statistic), np.mean(sums >= statistic)))
    assert wilcoxon_p(values) == (statistic, pytest.approx(expected, abs=1e-14))


def test_interval_is_the_inverted_test() -> None:
    values = np.random.default_rng(8).normal(0.2, 1, 9)
    _, low, high, _ = hodges_lehmann(values, 0.95)
    for bound, outside in ((low, -1e-6), (high, 1e-6)):
        assert wilcoxon_p(values - bound - outside)[1] <= 0.05
        assert wilcoxon_p(values - bound + outside)[1] > 0.05


def test_six_volunteers_cannot_reach_five_percent_after_holm() -> None:
    z = np.zeros((6, 1, 1, 3, 1))
    z[:, 0, 0, 1, 0] = np.arange(1, 7) / 10
    z[:, 0, 0, 2, 0] = np.arange(1, 7) / 4
    tested = wilcoxon(compare(of_rho(np.tanh(z))))
    assert (tested["p"] == 2 / 64).all()
    np.testing.assert_allclose(tested["p_holm"], 6 / 64)
    np.testing.assert_allclose(tested["smallest_p_holm"], 6 / 64)
    assert "cannot reach 0.05, whatever" in tested.attrs["sentence"]
    two = wilcoxon(compare(of_differences([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])))
    assert "cannot reach" not in two.attrs["sentence"]


@pytest.mark.parametrize("ties", [False, True])
def test_friedman_statistic_against_scipy(ties: bool) -> None:
    rng = np.random.default_rng(5)
    table = rng.integers(0, 4, (7, 4)).astype(float) if ties else rng.normal(size=(7, 4))
    statistic, _, p_chi2, exact = friedman_p(table)
    peer = stats.friedmanchisquare(*table.T)
    assert exact
    assert (statistic, p_chi2) == pytest.approx((peer.statistic, peer.pvalue), rel=1e-12)


@pytest.mark.parametrize("ties", [False, True])
def test_friedman_p_by_enumeration(ties: bool) -> None:
    rng = np.random.default_rng(11)
    table = rng.integers(0, 3, (4, 3)).astype(float) if ties else rng.normal(size=(4, 3))
    statistic, p, _, _ = friedman_p(table)
    reached = []
    for orders in itertools.product(itertools.permutations(range(3)), repeat=4):
        shuffled = np.array([row[list(order)] for row, order in zip(table, orders, strict=True)])
        reached.append(stats.friedmanchisquare(*shuffled.T).statistic)
    assert p == pytest.approx(np.mean(np.array(reached) >= statistic - 1e-9), abs=1e-12)


@pytest.mark.parametrize(
    ("sums", "statistic", "published"),
    [((8, 11, 17), 7.0, 0.029), ((7, 13, 16), 7.0, 0.029), ((6, 14, 16), 9.33, 0.006)],
)
def test_friedman_published_table(
    sums: tuple[int, ...], statistic: float, published: float
) -> None:
    """Three treatments, six blocks: P(chi-square >= 7.00) = 0.029, P(>= 9.33) = 0.006."""
    orders = itertools.product(itertools.permutations((1.0, 2.0, 3.0)), repeat=6)
    table = next(np.array(t) for t in orders if tuple(np.sum(t, axis=0)) == tuple(map(float, sums)))
    p = friedman_p(table)
    assert p[0] == pytest.approx(statistic, abs=5e-3)
    assert p[1] == pytest.approx(published, abs=5e-4)


def test_friedman_of_a_cube() -> None:
    cube = simulated_scores(3, effects=(0.0, 0.8, 0.9))
    tested = friedman(compare(cube))
    means = np.arctanh(cube["rho"]).mean(["repetition", "instruction", "marker"])
    peer = stats.friedmanchisquare(*means.transpose("strategy", "volunteer").values)
    assert float(tested["statistic"][0]) == pytest.approx(peer.statistic)
    assert float(tested["estimate"][0]) == pytest.approx(peer.statistic / 12)
    assert float(tested["smallest_p"][0]) == pytest.approx(6.0**-5)
    assert float(tested["mean_rank"].sel(strategy="act_all")) == 1.0


def test_friedman_uses_only_values_that_all_strategies_have() -> None:
    cube = fail(simulated_scores(3), volunteer="v1", instruction="i1", strategy="act_3")
    cut = cube.copy(deep=True)
    cut["rho"].loc[{"volunteer": "v1", "instruction": "i1"}] = np.nan
    tested = friedman(compare(cube))
    assert float(tested["statistic"][0]) == float(friedman(compare(cut))["statistic"][0])
    assert int(tested["pairs"][0]) == 66
    assert "6 of 72 values are omitted" in tested.attrs["sentence"]


def test_rounding_breaks_no_tie() -> None:
    """Tenths, in another unit or as differences of other tenths, are the same ranks as whole numbers."""
    whole = np.array([1.0, 2.0, 3.0, -1.0, 2.0, -3.0, 4.0, 0.0])
    table = np.array([[1, 1, 2], [3, 3, 1], [2, 2, 2], [1, 1, 5], [4, 3, 3]], dtype=float)
    for change in (lambda x: x * 0.1, lambda x: x / 1e3 * 0.3, lambda x: (0.7 + 0.1 * x) - 0.7):
        assert wilcoxon_p(change(whole)) == wilcoxon_p(whole)
        assert friedman_p(change(table)) == friedman_p(table)
    mixed = np.stack(
        [table[:, 0] * 0.1, (table[:, 1:] * 0.1 + 0.7).T[0] - 0.7, table[:, 2] / 10], 1
    )
    assert friedman_p(mixed) == friedman_p(table)
    assert wilcoxon_p(np.zeros(4)) == (0.0, 1.0)
