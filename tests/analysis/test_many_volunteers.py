"""Statistics of more volunteers than exact distributions and dense matrices allow."""

import numpy as np
import pytest
from scipy.stats import wilcoxon as scipy_wilcoxon

from analysis.statistics import ranks
from analysis.statistics.crossed import ZERO_SD, fit_crossed
from analysis.statistics.leave_one_out import leave_one_volunteer_out
from analysis.statistics.paired import compare
from analysis.statistics.sign_flip import sign_flip, sign_flip_p, sign_patterns
from analysis.statistics.simulated import simulated_scores
from analysis.statistics.summary import study_statistics


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_the_reduced_equations_are_those_of_dense_matrices(seed: int, swapped: bool) -> None:
    """Criterion, fixed effects and Satterthwaite's degrees of freedom by the definition of P."""
    rng = np.random.default_rng(seed)
    v, i = (each.ravel() for each in np.indices((9, 4)))
    kept = rng.random(v.size) > 0.2
    v, i = v[kept], i[kept]
    X = np.column_stack([np.ones(v.size), rng.normal(size=v.size)])
    y = rng.normal(size=9)[v] + 0.5 * rng.normal(size=4)[i] + 0.4 * rng.normal(size=v.size)
    names = ("i", "v") if swapped else ("v", "i")
    fit = fit_crossed(y, X, {name: {"v": v, "i": i}[name] for name in names})
    residual = fit.variances["residual"]
    terms = {"v": np.equal.outer(v, v) * 1.0, "i": np.equal.outer(i, i) * 1.0}
    V = residual * np.eye(v.size) + sum(fit.variances[name] * terms[name] for name in names)
    W = np.linalg.inv(V)
    C = np.linalg.inv(X.T @ W @ X)
    P = W - W @ X @ C @ X.T @ W
    free = v.size - X.shape[1]
    logs = np.linalg.slogdet(V)[1] + np.linalg.slogdet(X.T @ W @ X)[1]
    assert fit.criterion == pytest.approx(logs + y @ P @ y + free * np.log(2 * np.pi), rel=1e-9)
    np.testing.assert_allclose(fit.beta, C @ X.T @ W @ y, rtol=1e-9)
    np.testing.assert_allclose(fit.covariance, C, rtol=1e-9)
    np.testing.assert_allclose(fit.residuals, residual * P @ y, rtol=1e-8, atol=1e-10)
    used = [terms[name] for name in names if fit.variances[name] > ZERO_SD**2 * residual]
    used.append(np.eye(v.size))
    information = np.array([[0.5 * np.trace(P @ a @ P @ b) for b in used] for a in used])
    slopes = np.array([C @ X.T @ W @ term @ W @ X @ C for term in used])
    for contrast in (np.array([1.0, 0.0]), np.array([0.3, 1.0])):
        slope = np.einsum("i,cij,j->c", contrast, slopes, contrast)
        spread = slope @ np.linalg.inv(information) @ slope
        expected = 2.0 * (contrast @ C @ contrast) ** 2 / spread
        assert fit.degrees_of_freedom(contrast) == pytest.approx(expected, rel=1e-7)


def test_over_a_thousand_volunteers_have_all_tests() -> None:
    """2 / 2^n is no float with more than 1024 volunteers, and dense matrices are large."""
    cube = simulated_scores(
        3, volunteers=1100, instructions=4, repetitions=1, markers=1, effects=(0.0, 0.0, 0.1),
        sd_interaction=0.1, sd_error=0.2,
    )  # fmt: skip
    statistics = study_statistics(cube, draws=100, margin=0.1)
    for name, each in statistics.items():
        assert np.isfinite(each["estimate"].values).all(), name
        p = each["p"].values
        assert name == "bootstrap" or ((p >= 0) & (p <= 1)).all(), name
    effects = {"act_3 - act_all": 0.0, "act_rel - act_all": 0.1, "act_rel - act_3": 0.1}
    for name in ("sign_flip", "mixed_model_these_instructions", "wilcoxon", "leave_one_out"):
        each = statistics[name]
        by = dict(zip(each["contrast"].values, each["estimate"].values, strict=True))
        assert by == pytest.approx(effects, abs=0.03), name
    assert statistics["sign_flip"]["p"].values[1:].max() < 1e-3


def test_signed_ranks_of_many_tend_to_those_of_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Normal limit against the exact distribution and scipy; order statistics without all pairs."""
    values = np.random.default_rng(5).normal(0.12, 1.0, 150)
    values[40:60] = np.round(values[40:60], 1)
    exact_p, exact = ranks.wilcoxon_p(values), ranks.hodges_lehmann(values, 0.95)
    monkeypatch.setattr(ranks, "MOST_EXACT_RANKS", 100)
    limit_p, limit = ranks.wilcoxon_p(values), ranks.hodges_lehmann(values, 0.95)
    assert limit_p[0] == exact_p[0]
    assert limit_p[1] == pytest.approx(exact_p[1], abs=2e-3)
    scipy_p = scipy_wilcoxon(values, zero_method="wilcox", correction=False, method="approx")
    assert limit_p[1] == pytest.approx(float(scipy_p.pvalue), rel=1e-9)
    averages = np.sort(((values[:, None] + values) / 2.0)[np.triu_indices(150)])
    assert limit[0] == pytest.approx(np.median(averages), abs=1e-12)
    # The limit may choose a neighbouring order statistic, 0.4 % of the spread of averages away.
    for bound, other in zip(limit[1:3], exact[1:3], strict=True):
        assert np.abs(averages - bound).min() < 1e-12
        assert abs(np.searchsorted(averages, bound) - np.searchsorted(averages, other)) < 45
    assert limit[3] == pytest.approx(exact[3], abs=2e-3)


def test_leaving_one_of_many_out_is_the_test_of_the_others() -> None:
    """Above 17 volunteers random patterns are shared; p agrees within Monte Carlo errors."""
    cube = simulated_scores(2, volunteers=30, effects=(0.0, 0.1, 0.2))
    effects = leave_one_volunteer_out(compare(cube))
    for volunteer in ("v1", "v30"):
        rest = sign_flip(compare(cube.drop_sel(volunteer=volunteer)))
        ours = effects.sel(volunteer=volunteer)
        np.testing.assert_allclose(ours["estimate_without"], rest["estimate"], rtol=1e-12)
        p = rest["p"].values
        error = 4.0 * np.sqrt(2.0 * p * (1.0 - p) / 20_000) + 1e-4
        assert (np.abs(ours["p_without"].values - p) <= error).all()


def test_random_patterns_have_no_preferred_sign() -> None:
    patterns = sign_patterns(40)
    assert (patterns[0] == 1).all() and set(np.unique(patterns)) == {-1, 1}
    assert np.abs(patterns[1:].mean(axis=0)).max() < 5.0 / np.sqrt(19_999)
    # A p of values without effect is uniform: its mean over studies is one half.
    p = [sign_flip_p(np.random.default_rng(k).normal(size=40), patterns) for k in range(200)]
    assert abs(np.mean(p) - 0.5) < 4.0 / np.sqrt(12 * 200)
