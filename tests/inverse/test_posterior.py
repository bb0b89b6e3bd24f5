"""Posterior of activations: coverage of its intervals, and directions without information."""

import numpy as np
import pytest

from emgface.inverse.posterior import Posterior, in_words


def linear(J, residual, activation, prior, prior_precision):
    """Posterior of a linear model with unit noise: precision J'J + diag(prior_precision)."""
    seen = np.isfinite(residual)
    J, residual = J[seen], residual[seen]
    covariance = np.linalg.inv(J.T @ J + np.diag(prior_precision))
    right = J.T @ (residual + J @ activation) + prior_precision * prior
    return Posterior(covariance @ right, covariance)


def drawn(rng, n=6, m=8):
    """A truth within the box from the prior, and the regression of its noisy motion."""
    prior, precision = np.full(n, 0.3), np.full(n, 1.0 / 0.25**2)
    while True:
        truth = prior + 0.25 * rng.standard_normal(n)
        if truth.min() >= 0.0 and truth.max() <= 1.0:
            break
    J = 3.0 * rng.standard_normal((m, n))
    J[:, 1] = 0.9 * J[:, 0] + 0.1 * J[:, 1]
    y = J @ truth + rng.standard_normal(m)
    a = np.full(n, 0.5)
    return truth, linear(J, y - J @ a, a, prior, precision)


def test_ninety_per_cent_intervals_cover_ninety_per_cent():
    rng = np.random.default_rng(3)
    inside = []
    for k in range(300):
        truth, posterior = drawn(rng)
        low, high = posterior.intervals(0.9, 400, seed=k)
        inside.append((low <= truth) & (truth <= high))
    assert 0.88 <= np.mean(inside) <= 0.92


def test_without_bounds_the_mean_is_that_of_linear_regression():
    rng = np.random.default_rng(0)
    J, truth = rng.standard_normal((30, 4)), np.array([0.2, 0.5, 0.7, 0.4])
    response = linear(1e4 * J, 1e4 * (J @ truth), np.zeros(4), np.zeros(4), np.full(4, 1e-6))
    assert response.mean == pytest.approx(truth, abs=1e-6)
    assert response.intervals(0.9, 200) == pytest.approx(np.tile(truth, (2, 1)), abs=1e-3)


def test_muscles_with_equal_effects_are_named():
    J = np.random.default_rng(1).standard_normal((12, 4))
    J[:, 1], J[:, 3] = J[:, 0], 0.0
    prior_sd = np.full(4, 0.3)
    lost = np.append(np.zeros(12), np.nan)  # a marker without a position
    response = linear(10.0 * np.vstack([J, J[:1]]), lost, np.zeros(4), np.zeros(4), prior_sd**-2.0)
    words = in_words(response.unresolved(prior_sd), ["OOP_L", "OOM_L", "ZYG_L", "BUC_L"])
    assert len(words) == 2
    assert "BUC_L is not determined by the motion" in words
    assert {
        "OOP_L cannot be distinguished from OOM_L",
        "OOM_L cannot be distinguished from OOP_L",
    } & set(words)
