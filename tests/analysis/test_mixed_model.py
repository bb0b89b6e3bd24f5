"""The mixed model against lme4, published fits, analysis of variance and statsmodels."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from statsmodels.regression.mixed_linear_model import MixedLM, VCSpec
from synthetic_scores import fail

from analysis.errors import StatisticsError
from analysis.statistics.crossed import fit_crossed
from analysis.statistics.mixed_model import RANDOM_EFFECTS, fit_differences, mixed_model
from analysis.statistics.paired import compare, paired
from analysis.statistics.simulated import simulated_scores
from tests.analysis.shares import calibration, interval_coverage

PENICILLIN = """
27 23 26 23 23 21  27 23 26 23 23 21  25 21 25 24 24 20  26 23 25 23 23 20
25 22 26 22 23 20  24 22 25 23 22 19  24 20 23 21 22 19  26 22 26 24 24 21
24 21 24 22 22 20  24 21 24 23 22 19  26 23 26 24 24 21  25 22 26 24 24 20
26 24 26 24 25 22  26 23 26 23 23 20  26 23 25 24 24 22  25 22 25 23 23 20
25 21 24 23 23 20  25 22 24 23 23 19  24 21 23 21 21 19  26 23 26 24 24 21
25 21 24 22 22 18  25 22 25 22 22 20  24 21 24 22 24 19  24 21 24 22 21 18
"""
"""Diameters [mm] of growth inhibition, 24 plates by 6 samples (Davies and Goldsmith 1972)."""


LME4 = {
    ("complete", "instructions"): (
        (0.11385252, 0.073146452, 0.13978469), -0.04496725, 0.19561237, 42.43929, 7.11368, 0.824656,
    ),
    ("complete", "these instructions"): (
        (0.11385252, 0.13978469), -0.04496725, 0.15373649, 38.833519, 5, 0.781657,
    ),
    ("gaps", "instructions"): (
        (0.26657347, 0.18643941, 0.17670607), -0.033443929, 0.29793647, 48.253334, 7.66394, 0.913508,
    ),
    ("gaps", "these instructions"): (
        (0.26844686, 0.17662136), -0.035970493, 0.22758762, 41.338739, 4.95641, 0.880654,
    ),
    ("no_interaction", "instructions"): (
        (0, 0, 0.1673587), 0.18773025, 0.074690182, 33.858772, 29, 0.0177638,
    ),
    ("no_interaction", "these instructions"): (
        (0, 0.18216509), 0.18773025, 0.077924127, 37.334676, 25, 0.0236832,
    ),
}  # fmt: skip
"""Variances, estimate, its error, criterion, degrees of freedom and p, printed by R 4.2.2, lme4
1.1.31, lmerTest 3.1.3 and pbkrtest 0.5.2 for ``differences_simulated.csv``, with

    x <- subset(read.csv("differences_simulated.csv"), case == "gaps")
    d <- aggregate(I(act_rel - act_3) ~ instruction + volunteer, x, mean)
    names(d)[3] <- "d"
    m <- lmer(d ~ 1 + (1 | volunteer) + (1 | instruction), d)   # instructions in general
    m <- lmer(d ~ 0 + instruction + (1 | volunteer), d)         # these instructions
    VarCorr(m); fixef(m); vcov(m); REMLcrit(m)
    contest1D(m, w, ddf = "Kenward-Roger")                      # w = 1, or 1/5 each

and bobyqa to rhoend 1e-12. Degrees of freedom are Kenward and Roger's of ``gaps``, whose error
they widen by 4e-4; lmerTest's, which take the observed information for the expected one, are
7.786 and 5.107 there. Where a variance is zero they are lmerTest's Satterthwaite ones.
"""

LME4_LONG = (-0.04496725, 0.19561238)
"""Estimate and error of case "complete" by lme4 with every interaction, z in long form:
z ~ S + (1|v) + (1|i) + (1|m) + (1|v:i) + (1|v:m) + (1|i:m) + (1|v:i:m) + (1|v:S) + (1|i:S)
+ (1|m:S) + (1|v:i:S)."""


def of_case(case: str) -> np.ndarray:
    """Mean differences act_rel - act_3, shape (volunteers, instructions)."""
    path = Path(__file__).with_name("differences_simulated.csv")
    with path.open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["case"] == case]
    cells: dict[tuple[str, str], list[float]] = {}
    for row in rows:
        both = (row["act_rel"], row["act_3"])
        here = cells.setdefault((row["volunteer"], row["instruction"]), [])
        here += [float(both[0]) - float(both[1])] if all(both) else []
    volunteers, instructions = (sorted({key[k] for key in cells}) for k in (0, 1))
    table = [[cells.get((v, i), []) for i in instructions] for v in volunteers]
    return np.array([[np.mean(each) if each else np.nan for each in row] for row in table])


def test_published_fit_of_crossed_effects() -> None:
    """Standard deviations 0.8467, 1.9316, 0.5499; intercept 22.9722 (0.8086); criterion 330.86.

    Source: Bates 2010, lme4: Mixed-effects modeling with R, section 2.1.
    """
    y = np.array(PENICILLIN.split(), dtype=float)
    plate, sample = np.repeat(np.arange(24), 6), np.tile(np.arange(6), 24)
    fit = fit_crossed(y, np.ones((144, 1)), {"plate": plate, "sample": sample})
    deviations = {name: np.sqrt(value) for name, value in fit.variances.items()}
    assert deviations["plate"] == pytest.approx(0.8467, abs=1e-4)
    assert deviations["sample"] == pytest.approx(1.9316, abs=1e-4)
    assert deviations["residual"] == pytest.approx(0.5499, abs=1e-4)
    assert fit.beta[0] == pytest.approx(22.9722, abs=1e-4)
    assert np.sqrt(fit.covariance[0, 0]) == pytest.approx(0.8086, abs=1e-4)
    assert fit.criterion == pytest.approx(330.8606, abs=1e-3)


@pytest.mark.parametrize(("case", "scope"), LME4)
def test_crossed_slopes_agree_with_lme4(case: str, scope: str) -> None:
    variances, estimate, error, criterion, freedom, p = LME4[case, scope]
    fit = fit_differences(of_case(case), scope)
    np.testing.assert_allclose(list(fit.fit.variances.values()), variances, rtol=1e-6, atol=1e-9)
    assert fit.estimate == pytest.approx(estimate, rel=1e-6)
    assert fit.error == pytest.approx(error, rel=1e-6)
    assert fit.fit.criterion == pytest.approx(criterion, abs=1e-5)
    assert fit.freedom == pytest.approx(freedom, rel=1e-5)
    t = abs(fit.estimate) / fit.error
    assert 2 * stats.t.sf(t, fit.freedom) == pytest.approx(p, rel=2e-5)


def test_shared_terms_cancel_in_the_difference() -> None:
    """lme4 with all intercepts and interactions finds the same estimate and error."""
    fit = fit_differences(of_case("complete"), "instructions")
    assert (fit.estimate, fit.error) == pytest.approx(LME4_LONG, rel=1e-6)


def by_mean_squares(d: np.ndarray) -> tuple[float, float]:
    """Error and degrees of freedom of the mean of a complete two-way table, variances >= 0."""
    n, m = d.shape
    free = np.array([n - 1, m - 1, (n - 1) * (m - 1)])
    rows, columns = d.mean(1) - d.mean(), d.mean(0) - d.mean()
    rest = d - d.mean() - rows[:, None] - columns[None, :]
    squares = np.array([m * (rows**2).sum(), n * (columns**2).sum(), (rest**2).sum()])
    v, i, e = squares / free
    if min(v, i) >= e:
        error = v + i - e
        return np.sqrt(error / d.size), error**2 / ((np.array([v, i, e]) ** 2 / free).sum())
    # The mean square of a variance of zero is pooled with that of the residual.
    for zero, other in ((0, 1), (1, 0)):
        pooled = (squares[zero] + squares[2]) / (free[zero] + free[2])
        if (v, i)[zero] < e and (v, i)[other] >= pooled:
            return np.sqrt((v, i)[other] / d.size), free[other]
    return np.sqrt(squares.sum() / free.sum() / d.size), free.sum()


@pytest.mark.parametrize("seed", range(12))
def test_complete_tables_agree_with_analysis_of_variance(seed: int) -> None:
    """Restricted maximum likelihood and Satterthwaite in closed form, also at zero variances."""
    rng = np.random.default_rng(seed)
    n, m = ((6, 6), (5, 4), (12, 6))[seed % 3]
    volunteer, instruction = ((0.0, 0.0), (0.4, 0.0), (0.0, 0.4), (0.4, 0.4))[seed // 3]
    d = 0.4 * rng.normal(size=(n, m)) + volunteer * rng.normal(size=(n, 1))
    d = d + instruction * rng.normal(size=(1, m))
    error, freedom = by_mean_squares(d)
    fit = fit_differences(d, "instructions")
    assert fit.estimate == pytest.approx(d.mean())
    assert fit.error == pytest.approx(error, rel=1e-5)
    assert fit.freedom == pytest.approx(freedom, rel=1e-4)


def test_a_criterion_that_falls_from_zero_is_followed() -> None:
    """The derivative by a standard deviation is zero at zero, where the criterion decreases."""
    rest = np.random.default_rng(3).normal(size=(12, 6))
    rest -= rest.mean(axis=0)  # instructions alike
    for spread in np.linspace(0.2, 0.6, 9):
        table = rest + spread * np.linspace(-1, 1, 6)
        fit = fit_differences(table, "instructions")
        assert fit.error == pytest.approx(by_mean_squares(table)[0], rel=1e-5), spread


def test_these_instructions_are_the_paired_t_test() -> None:
    """On complete data it is the paired t test of the volunteers' means."""
    cube = simulated_scores(2, instructions=6, sd_interaction=0.4)
    fitted = mixed_model(compare(cube), scope="these instructions")
    for index, pair in enumerate((("act_3", "act_all"), ("act_rel", "act_all"))):
        peer = stats.ttest_1samp(paired(cube, *pair).values, 0.0)
        assert float(fitted["p"][index]) == pytest.approx(peer.pvalue, rel=1e-4)
        assert float(fitted["degrees_of_freedom"][index]) == pytest.approx(5.0, rel=1e-4)
        np.testing.assert_allclose(fitted["interval"][index], peer.confidence_interval(), rtol=1e-4)


def test_effects_common_to_both_strategies_cancel() -> None:
    """Any effect of volunteer, instruction, repetition and marker cancels."""
    cube = simulated_scores(4, instructions=5, centre=0.0, sd_error=0.1)
    shared = np.random.default_rng(0).normal(size=(6, 5, 2, 1, 3))
    moved = cube.assign(rho=(cube["rho"].dims, np.tanh(np.arctanh(cube["rho"].values) + shared)))
    one, other = mixed_model(compare(cube)), mixed_model(compare(moved))
    for name in ("estimate", "interval", "p"):
        np.testing.assert_allclose(one[name], other[name], rtol=1e-5)


def test_incomplete_data_agree_with_statsmodels() -> None:
    table = of_case("gaps")
    v, i = np.nonzero(np.isfinite(table))
    y = table[v, i]
    designs = [np.eye(n)[x] for n, x in zip(table.shape, (v, i), strict=True)]
    names = [[[str(k) for k in range(d.shape[1])]] for d in designs]
    spec = VCSpec(list(RANDOM_EFFECTS), names, [[d] for d in designs])
    X, groups = np.ones((len(y), 1)), np.ones(len(y))
    peer = MixedLM(y, X, groups=groups, exog_vc=spec).fit(method="powell", ftol=1e-12)
    fit = fit_crossed(y, X, dict(zip(RANDOM_EFFECTS, (v, i), strict=True)))
    np.testing.assert_allclose(fit.beta, peer.fe_params, rtol=1e-5)
    np.testing.assert_allclose(list(fit.variances.values())[:2], peer.vcomp, rtol=2e-3)
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), np.asarray(peer.bse_fe), rtol=1e-3)
    assert fit.criterion == pytest.approx(-2 * peer.llf, abs=1e-5)
    np.testing.assert_allclose(fit.residuals, peer.resid, atol=1e-3)


def test_a_variance_of_zero_is_reported() -> None:
    fitted = mixed_model(
        compare(simulated_scores(0, instructions=6, sd_interaction=0.0, sd_error=1.0))
    )
    zero = fitted["variance"].sel(random="volunteer x strategy") < 1e-9
    assert zero.any()
    checks = fitted["check"].sel(assumption="variances lie above zero")
    verdicts = fitted["verdict"].sel(assumption="variances lie above zero")
    for there, check, verdict in zip(zero.values, checks.values, verdicts.values, strict=True):
        assert ("volunteer x strategy" in str(check)) == there
        assert not there or verdict == "doubtful"


def test_wald_is_called_too_small_only_for_few_volunteers() -> None:
    few, many = (
        mixed_model(compare(simulated_scores(1, instructions=4, volunteers=n))) for n in (6, 30)
    )
    assert "too small for so few" in few.attrs["sentence"]
    assert "too small for so few" not in many.attrs["sentence"]
    assert (few["p_wald"] < few["p"]).all()


def test_each_scope_is_stated_with_its_own_estimate() -> None:
    cube = simulated_scores(1, instructions=6, sd_instruction_strategy=0.5)
    general, these = (
        mixed_model(compare(cube)),
        mixed_model(compare(cube), scope="these instructions"),
    )
    assert general.attrs["sentence"].endswith("Scope: volunteers and instructions in general.")
    assert these.attrs["sentence"].endswith("Scope: volunteers in general, these 6 instructions.")
    np.testing.assert_allclose(general["estimate"], these["estimate"], rtol=1e-6)
    assert (general["standard_error"] > these["standard_error"]).all()
    assert np.isnan(these["variance"].sel(random="instruction x strategy")).all()
    with pytest.raises(StatisticsError, match="the scope is 'all'"):
        mixed_model(compare(cube), scope="all")


@pytest.mark.parametrize(
    ("sizes", "words"),
    [
        ({"volunteers": 4, "instructions": 6}, "the model requires 5 or more volunteers"),
        (
            {"volunteers": 6, "instructions": 3},
            "3 instructions do not allow a statement about instructions in general",
        ),
    ],
)
def test_too_few_give_no_interval_and_no_p(sizes: dict, words: str) -> None:
    fitted = mixed_model(compare(simulated_scores(1, **sizes)))
    assert np.isnan(fitted["interval"]).all()
    assert np.isnan(fitted["p"]).all()
    assert np.isfinite(fitted["estimate"]).all()
    assert words in fitted.attrs["sentence"]


def test_one_instruction_leaves_the_paired_t_test() -> None:
    cube = simulated_scores(1, instructions=1)
    fitted = mixed_model(
        compare(cube, contrasts=[("act_rel", "act_3")]), scope="these instructions"
    )
    peer = stats.ttest_1samp(paired(cube, "act_rel", "act_3").values, 0.0)
    assert float(fitted["p"][0]) == pytest.approx(peer.pvalue, rel=1e-6)


def test_many_missing_pairs_are_reported() -> None:
    table = np.full((5, 5), np.nan)
    table[np.arange(5), np.arange(5)] = [0.1, 0.4, -0.2, 0.3, 0.5]
    assert "too many pairs are missing" in fit_differences(table, "instructions")


def test_a_strategy_without_scores_is_left_out() -> None:
    fitted = mixed_model(compare(fail(simulated_scores(1, instructions=4), strategy="act_3")))
    assert list(np.isnan(fitted["p"].values)) == [True, False, True]
    assert "no pair of scored trials" in str(fitted["sentence"].values[0])


@pytest.mark.slow
def test_instructions_taken_as_fixed_reject_too_often_of_instructions_in_general() -> None:
    """SD 0.3 of instruction x strategy: only the test with this term has its nominal size."""
    model = {"instructions": 6, "sd_instruction_strategy": 0.3, "repetitions": 1, "markers": 1}
    rates = calibration(methods=["mixed_model_in_general"], simulations=40, seed=7, **model)
    size = {str(test): float(rates["size"].sel(test=test)) for test in rates["test"].values}
    # Four Monte Carlo errors about 0.05 of 40 cubes.
    assert size["mixed model, instructions"] < 0.05 + 4 * 0.034
    assert size["mixed model, misread"] > 0.05 + 4 * 0.034


def test_two_volunteers_would_not_be_covered() -> None:
    """Coverage of 40 cubes is four Monte Carlo errors below the nominal 0.95."""
    coverage = interval_coverage(simulations=40, seed=3, volunteers=2, instructions=3)
    assert float(coverage["coverage"].sel(test="bootstrap, expanded")) < 0.95 - 4 * 0.034
