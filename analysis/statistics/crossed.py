"""Restricted maximum likelihood with crossed random effects, safe at variances of zero."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

from analysis.statistics.paired import Array

LARGEST: Final = 1e3
"""Bound of a random effect's standard deviation over the residual's, where digits still hold."""


@dataclass(frozen=True)
class Fit:
    """A fitted model with crossed random effects.

    Attributes
    ----------
    beta, covariance : ndarray, shapes (k,) and (k, k)
        Fixed effects and their covariance.
    variances : dict of str to float
        Per random effect, and ``residual``.
    residuals : ndarray, shape (n,)
        About the fitted values, random effects included.
    converged : bool
        Whether the optimiser says so.
    criterion : float
        -2 times the restricted log-likelihood.
    """

    beta: Array
    covariance: Array
    variances: dict[str, float]
    residuals: Array
    converged: bool
    criterion: float


def fit_crossed(y: Array, X: Array, factors: Mapping[str, NDArray[np.int64]]) -> Fit:
    """Fit y = X beta + sum over factors Z_f b_f + e by restricted maximum likelihood.

    b_f ~ N(0, s_f^2 I) for every factor, e ~ N(0, s^2 I), all independent.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Observations.
    X : ndarray, shape (n, k)
        Fixed effects.
    factors : mapping of str to int ndarray, shape (n,)
        Level of each observation in each random factor.

    Returns
    -------
    Fit
        Variances may lie at their bound of zero.

    Notes
    -----
    The profiled criterion in terms of relative standard deviations is regular at that bound,
    which a few volunteers often reach. Source: Bates, Maechler, Bolker and Walker 2015, Journal
    of Statistical Software 67(1), sections 3.4 and 3.5.
    """
    names = list(factors)
    columns: list[Array] = []
    owner: list[int] = []
    for place, levels in enumerate(factors.values()):
        _, index = np.unique(levels, return_inverse=True)
        design = np.eye(int(index.max()) + 1)[index.ravel()]
        columns.append(design)
        owner += [place] * design.shape[1]
    Z = np.concatenate(columns, axis=1)
    equations = _Equations(y, X, Z, np.array(owner, dtype=np.int64))
    # The criterion may have a second valley near the bound; the better of two starts is kept.
    tried = [
        minimize(
            equations.criterion, np.full(len(names), start), method="L-BFGS-B", jac="3-point",
            bounds=[(0.0, LARGEST)] * len(names), options={"ftol": 1e-14, "gtol": 1e-7},
        )
        for start in (1.0, 0.1)
    ]  # fmt: skip
    best = min(tried, key=lambda each: float(each.fun))
    theta = np.asarray(best.x, dtype=np.float64)
    beta, covariance, residual, residuals = equations.solution(theta)
    variances = dict(zip(names, (residual * theta**2).tolist(), strict=True))
    # A flat end of the line search is reported as failure although both starts agree.
    agree = abs(float(tried[0].fun) - float(tried[1].fun)) < 1e-5
    converged = agree or any(bool(each.success) for each in tried)
    return Fit(
        beta, covariance, variances | {"residual": residual}, residuals, converged,
        float(best.fun),
    )  # fmt: skip


class _Equations:
    """Penalised least squares of a mixed model; theta are standard deviations over residual's."""

    def __init__(self, y: Array, X: Array, Z: Array, owner: NDArray[np.int64]) -> None:
        self.y, self.X, self.Z, self.owner = y, X, Z, owner
        self.ZZ, self.ZX, self.Zy = Z.T @ Z, Z.T @ X, Z.T @ y
        self.XX, self.Xy, self.yy = X.T @ X, X.T @ y, float(y @ y)

    def _solve(self, theta: Array) -> tuple[Array, Array, Array, Array, Array, float]:
        scale = theta[self.owner]
        L = _cholesky(scale[:, None] * self.ZZ * scale + np.eye(len(scale)))
        c: Array = solve_triangular(L, scale * self.Zy, lower=True)
        R_ZX: Array = solve_triangular(L, scale[:, None] * self.ZX, lower=True)
        R_X = _cholesky(self.XX - R_ZX.T @ R_ZX)
        d: Array = solve_triangular(R_X, self.Xy - R_ZX.T @ c, lower=True)
        squares = self.yy - float(c @ c) - float(d @ d)
        # Without any residual the logarithm would have no bound.
        return L, c, R_ZX, R_X, d, max(squares, 1e-12 * self.yy)

    def criterion(self, theta: Array) -> float:
        """-2 restricted log-likelihood, with fixed effects and residual variance at their best."""
        L, _, _, R_X, _, squares = self._solve(theta)
        free = len(self.y) - self.X.shape[1]
        logs = 2.0 * float(np.log(np.diag(L)).sum() + np.log(np.diag(R_X)).sum())
        return logs + free * (1.0 + math.log(2.0 * math.pi * squares / free))

    def solution(self, theta: Array) -> tuple[Array, Array, float, Array]:
        """Fixed effects, their covariance, residual variance and residuals."""
        L, c, R_ZX, R_X, d, squares = self._solve(theta)
        beta: Array = solve_triangular(R_X.T, d, lower=False)
        u: Array = solve_triangular(L.T, c - R_ZX @ beta, lower=False)
        residual = squares / (len(self.y) - self.X.shape[1])
        inverse: Array = solve_triangular(R_X, np.eye(len(d)), lower=True)
        fitted = self.X @ beta + self.Z @ (theta[self.owner] * u)
        return beta, residual * (inverse.T @ inverse), residual, self.y - fitted


def _cholesky(A: Array) -> Array:
    return np.linalg.cholesky(A).astype(np.float64)
