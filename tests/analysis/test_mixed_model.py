"""The mixed model against published fits, analysis of variance and statsmodels."""

import numpy as np
import pytest
from scipy import stats
from statsmodels.regression.mixed_linear_model import MixedLM, VCSpec
from synthetic_scores import fail

from analysis.statistics.calibration import simulated_scores
from analysis.statistics.crossed import fit_crossed
from analysis.statistics.mixed_model import RANDOM, mixed_model

PENICILLIN = """
27 23 26 23 23 21  27 23 26 23 23 21  25 21 25 24 24 20  26 23 25 23 23 20
25 22 26 22 23 20  24 22 25 23 22 19  24 20 23 21 22 19  26 22 26 24 24 21
24 21 24 22 22 20  24 21 24 23 22 19  26 23 26 24 24 21  25 22 26 24 24 20
26 24 26 24 25 22  26 23 26 23 23 20  26 23 25 24 24 22  25 22 25 23 23 20
25 21 24 23 23 20  25 22 24 23 23 19  24 21 23 21 21 19  26 23 26 24 24 21
25 21 24 22 22 18  25 22 25 22 22 20  24 21 24 22 24 19  24 21 24 22 21 18
"""
"""Diameters [mm] of growth inhibition, 24 plates by 6 samples (Davies and Goldsmith 1972)."""


def table(cube) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    mean = np.arctanh(cube["rho"]).mean("repetition")
    mean = mean.transpose("volunteer", "instruction", "strategy", "marker").values
    cells = np.nonzero(np.isfinite(mean))
    return mean[cells], list(cells), mean


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


def test_complete_data_agree_with_analysis_of_variance() -> None:
    """With all variances above zero the estimates are those of the mean squares."""
    cube = simulated_scores(2)
    found = mixed_model(cube)
    z = table(cube)[2]
    v, i, s, m = z.shape
    cell = z.mean((1, 3))
    rest = cell - cell.mean(0) - cell.mean(1)[:, None] + cell.mean()
    interaction = i * m * (rest**2).sum() / ((v - 1) * (s - 1))

    def squares(axes: tuple[int, ...]) -> float:
        return float(z.size / z.mean(axes).size * ((z.mean(axes) - z.mean()) ** 2).sum())

    rests = {"v": (1, 2, 3), "i": (0, 2, 3), "s": (0, 1, 3), "m": (0, 1, 2)}
    main = {name: squares(axes) for name, axes in rests.items()}
    explained = sum(main.values()) + interaction * (v - 1) * (s - 1)
    free = z.size - 1 - (v - 1) - (i - 1) - (m - 1) - (s - 1) - (v - 1) * (s - 1)
    error = (((z - z.mean()) ** 2).sum() - explained) / free
    variances = [
        (main["v"] / (v - 1) - interaction) / (i * m * s),
        (main["i"] / (i - 1) - error) / (v * m * s),
        (main["m"] / (m - 1) - error) / (v * i * s),
        (interaction - error) / (i * m),
        error,
    ]
    assert min(variances) > 0
    np.testing.assert_allclose(found["variance"], variances, rtol=2e-4)
    np.testing.assert_allclose(found["mean"], z.mean((0, 1, 3)), rtol=1e-9)
    wide = np.sqrt(2 * interaction / (v * i * m))
    np.testing.assert_allclose(found["standard_error"], wide, rtol=1e-4)
    difference = cell[:, 1].mean() - cell[:, 0].mean()
    assert float(found["estimate"][0]) == pytest.approx(difference)
    p = 2 * stats.t.sf(abs(difference) / wide, (v - 1) * (s - 1))
    assert float(found["p"][0]) == pytest.approx(p, rel=1e-3)


def test_incomplete_data_agree_with_statsmodels() -> None:
    cube = fail(simulated_scores(2), volunteer="v2", instruction="i1", strategy="act_3")
    y, (v, i, s, m), _ = table(cube)
    X = np.eye(3)[s]
    designs = [np.eye(n)[x] for n, x in ((6, v), (2, i), (3, m), (18, 3 * v + s))]
    names = [[[str(k) for k in range(d.shape[1])]] for d in designs]
    spec = VCSpec(list(RANDOM), names, [[d] for d in designs])
    peer = MixedLM(y, X, groups=np.ones(len(y)), exog_vc=spec).fit(method="powell", ftol=1e-12)
    fit = fit_crossed(y, X, dict(zip(RANDOM, (v, i, m, 3 * v + s), strict=True)))
    np.testing.assert_allclose(fit.beta, peer.fe_params, rtol=1e-5)
    np.testing.assert_allclose(list(fit.variances.values())[:4], peer.vcomp, rtol=2e-3)
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), np.asarray(peer.bse_fe), rtol=1e-3)
    assert fit.criterion == pytest.approx(-2 * peer.llf, abs=1e-5)
    np.testing.assert_allclose(fit.residuals, peer.resid, atol=1e-3)


def test_a_variance_at_zero_is_said() -> None:
    found = mixed_model(simulated_scores(0, sd_interaction=0.0))
    assert float(found["variance"].sel(random="volunteer x strategy")) < 1e-9
    verdict = found["verdict"].sel(assumption="variances lie above zero")
    assert (verdict == "doubtful").all()
    assert "At zero: volunteer x strategy." in found["check"].values.ravel()


def test_wald_is_called_too_small_for_few_only() -> None:
    few, many = mixed_model(simulated_scores(1)), mixed_model(simulated_scores(1, volunteers=30))
    assert "too small for so few" in few.attrs["sentence"]
    assert "too small for so few" not in many.attrs["sentence"]
    assert (few["p_wald"] < few["p"]).all()


def test_a_strategy_without_scores_is_left_out() -> None:
    found = mixed_model(fail(simulated_scores(1), strategy="act_3"))
    assert list(np.isnan(found["p"].values)) == [True, False, True]
    assert np.isnan(float(found["mean"].sel(strategy="act_3")))
    assert "one of the two has no scored trial" in str(found["sentence"].values[0])
    assert list(found["degrees_of_freedom"].values[1:2]) == [5.0]
