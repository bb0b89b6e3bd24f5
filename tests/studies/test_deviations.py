"""Deviations of persons from the mean of others: closed forms, nulls and controls."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import nct, t

from emgface.muscles import MUSCLES
from studies.science.deviations import (
    Trials,
    agreement,
    correlation,
    deviation_agreement,
    deviations,
    explained,
    of_other_volunteers,
    random_activations,
    spread_of_deviations,
    with_known_agreement,
)
from studies.science.inverse import convergence, increments, scores, text
from studies.science.verdict import (
    DIFFERENCES,
    SEMG,
    controls,
    controls_of_difference,
    differences,
    smallest_difference,
    verdict,
)

PERSONS, SHAPE = 6, (12, 20, 40)
TRIALS = Trials(
    tuple(f"S{k}" for k in range(PERSONS) for _ in "AD"), tuple("AD" * PERSONS)
)  # fmt: skip


@pytest.fixture
def truth() -> np.ndarray:
    """A pattern of each instruction, shared by all, and a part of every person."""
    rng = np.random.default_rng(3)
    pattern = random_activations((2, *SHAPE[1:]), rng)
    return pattern[[0, 1] * PERSONS] + 0.2 * random_activations(SHAPE, rng)


def test_deviations_are_those_from_the_mean_of_the_others(truth: np.ndarray) -> None:
    """d_v = x_v - mean of others = n / (n - 1) (x_v - mean of all)."""
    d = deviations(truth, TRIALS)
    all_mean = truth[::2].mean(axis=0)
    assert np.allclose(d[::2], PERSONS / (PERSONS - 1) * (truth[::2] - all_mean))
    assert TRIALS.others(0) == [2, 4, 6, 8, 10]


def test_what_all_persons_share_has_a_high_correlation_and_no_deviations(truth: np.ndarray) -> None:
    shared = np.tile(truth[:2], (PERSONS, 1, 1))
    assert agreement(shared, truth, TRIALS).mean() > 0.8
    assert np.allclose(deviation_agreement(shared, truth, TRIALS), 0.0)
    assert correlation(truth, truth) == pytest.approx(1.0)


@pytest.mark.parametrize("rho", [0.1, 0.5, 0.9])
def test_a_known_agreement_is_measured(truth: np.ndarray, rho: float) -> None:
    made = with_known_agreement(truth, TRIALS, rho, np.random.default_rng(1))
    # the mean of the others of the made estimate is not exactly that of the truth
    assert deviation_agreement(made, truth, TRIALS).mean() == pytest.approx(rho, abs=0.06)


def test_deviations_make_persons_alike_by_the_stated_ratio() -> None:
    """Independent parts of equal size: measured = (n - 2) / (n - 1) own + 1 / (n - 1) mean."""
    rng = np.random.default_rng(2)
    trials = Trials(tuple(f"S{k}" for k in range(PERSONS)), ("A",) * PERSONS)
    own = np.linspace(0.2, 0.9, PERSONS)
    parts = rng.standard_normal((2, PERSONS, 20, 20000))
    truth, noise = parts
    made = own[:, None, None] * truth + np.sqrt(1.0 - own**2)[:, None, None] * noise
    measured = deviation_agreement(made, truth, trials)
    assert measured.mean() == pytest.approx(own.mean(), abs=0.01)
    assert own.std() / measured.std() == pytest.approx(spread_of_deviations(PERSONS), rel=0.03)


def test_activations_of_another_person_do_not_agree_beyond_the_pattern(truth: np.ndarray) -> None:
    """Mean over all others: deviations sum to zero, so the expected correlation is about -1/(n - 1)."""
    each = [of_other_volunteers(truth, TRIALS, k) for k in range(PERSONS - 1)]
    assert np.mean([agreement(e, truth, TRIALS) for e in each]) > 0.7
    beyond = np.mean([deviation_agreement(e, truth, TRIALS) for e in each])
    assert beyond == pytest.approx(-1.0 / (PERSONS - 1), abs=0.05)


def test_shares_are_those_of_independent_parts(truth: np.ndarray) -> None:
    """Two estimates, each with one of two independent parts: shares add up, and both give all."""
    common = np.tile(np.stack([truth[k::2].mean(axis=0) for k in (0, 1)]), (PERSONS, 1, 1))
    even = np.arange(SHAPE[1])[:, None] % 2 == 0
    first, second = np.where(even, truth, common), np.where(even, common, truth)
    d = deviations(truth, TRIALS)
    part = (d[:, ::2] ** 2).sum() / (d**2).sum()
    one = explained({"a": truth}, truth, TRIALS)
    assert np.allclose(one, 1.0)
    assert explained({"a": first}, truth, TRIALS).mean() == pytest.approx(part, abs=0.15)
    assert explained({"a": first, "b": second}, truth, TRIALS).mean() > 0.9
    noise = random_activations(SHAPE, np.random.default_rng(5))
    assert abs(explained({"a": noise}, truth, TRIALS).mean()) < 0.02


def test_the_negative_control_is_rarely_and_the_positive_often_found(truth: np.ndarray) -> None:
    table = controls(truth, TRIALS).set_index("true")
    assert table.loc[0.0, "found"] < 0.08 and abs(table.loc[0.0, "measured"]) < 0.02
    assert table.loc[0.5, "found"] > 0.95 and table.loc[0.8, "measured"] > 0.7


@pytest.mark.parametrize(("better", "said"), [(True, "better than"), (False, "not shown")])
def test_the_verdict_follows_from_the_deviations(
    truth: np.ndarray, better: bool, said: str
) -> None:
    rng = np.random.default_rng(8)
    semg = with_known_agreement(truth, TRIALS, 0.3, rng)
    assisted = with_known_agreement(truth, TRIALS, 0.8 if better else 0.3, rng)
    estimates = {
        "step:motion": truth, "step:assisted": truth, "trajectory:motion": assisted,
        "trajectory:assisted": assisted, SEMG: semg,
    }  # fmt: skip
    table = scores(estimates, truth, TRIALS, MUSCLES)
    assert said in verdict(table)
    nulls = table[table["estimate"].str.startswith("null: true mean")]
    assert nulls["of deviations"].isna().all() and (nulls["correlation"] > 0.7).all()
    assert ("can remain undetected" in verdict(table)) is not better
    gains = increments(estimates, truth, TRIALS, MUSCLES)
    power = pd.DataFrame({"true": [0.0, 0.5], "measured": [0.0, 0.5], "found": [0.02, 1.0]})
    whole = text(table, (power, power), gains, fits("converged"))
    assert whole.count("0.5 in 100%") == 2 and "not defined" in whole
    assert "6 volunteers" in whole and "(12 trials)" in whole


def test_a_known_difference_is_found_with_the_stated_power(truth: np.ndarray) -> None:
    """The smallest detectable difference has a power near 0.8 in draws that pass through the scores."""
    rng = np.random.default_rng(11)
    own = 0.2 * rng.standard_normal(PERSONS)
    rows = [
        {"estimate": name, "volunteer": f"S{k}", "of deviations": 0.3 + sign * value}
        for name, sign in (("trajectory:assisted", 0.5), (SEMG, -0.5))
        for k, value in enumerate(own)
    ]
    table = pd.DataFrame(rows)
    assert np.allclose(differences(table), own)
    rates = controls_of_difference(truth, TRIALS, table).set_index("true")
    assert rates.loc[0.0, "found"] < 0.045 and abs(rates.loc[0.0, "measured"]) < 0.03
    assert rates["found"].is_monotonic_increasing
    at = np.interp(smallest_difference(own), [0.0, *DIFFERENCES], rates["found"])
    assert at == pytest.approx(0.8, abs=0.12)  # 500 draws, and the correlations of made estimates


def test_the_smallest_difference_is_that_of_the_power_of_students_t() -> None:
    """Power of the two-sided t test by the noncentral distribution."""
    difference = np.array([0.1, -0.2, 0.3, 0.05, 0.4, -0.1])
    n = difference.size
    spread = spread_of_deviations(n) * difference.std(ddof=1)
    shift = smallest_difference(difference) / spread * np.sqrt(n)
    edge = t.ppf(0.975, n - 1)
    assert nct.sf(edge, n - 1, shift) + nct.cdf(-edge, n - 1, shift) == pytest.approx(0.8, abs=0.03)


def fits(last: str) -> pd.DataFrame:
    """Converged fits of all trials, with another state of the last one."""
    rows = [
        {"setting": s, "volunteer": v, "instruction": i, "state": "converged", "misfit ratio": 0.25}
        for s in ("trajectory:motion", "trajectory:assisted")
        for v, i in zip(TRIALS.volunteer, TRIALS.instruction, strict=True)
    ]
    rows[-1]["state"] = last
    return pd.DataFrame(rows)


def test_fits_that_did_not_converge_are_counted_and_named() -> None:
    assert "12 of 12 fits of trajectory:assisted converged;" in convergence(fits("converged"))
    said = convergence(fits("not converged"))
    assert "11 of 12 fits of trajectory:assisted converged (not converged: S5 D)" in said
    assert "12 of 12 fits of trajectory:motion converged" in said and "left out" not in said
    assert "1 recordings were not inverted" in convergence(fits("failed"))
