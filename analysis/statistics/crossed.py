"""Restricted maximum likelihood with crossed random effects, regular at variances of zero."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import OptimizeResult, minimize

from analysis.statistics.paired import Array

LARGEST: Final = 1e3
"""Upper bound of the standard deviation of a random effect relative to the residual."""

NOTHING: Final = 1e-4  #: relative standard deviation below which a variance is regarded as zero


@dataclass(frozen=True)
class Fit:
    """A fitted model with crossed random effects."""

    beta: Array  #: (k,) fixed effects
    covariance: Array  #: (k, k) covariance of the fixed effects
    variances: dict[str, float]  #: per random effect, and ``residual``
    residuals: Array  #: (n,) about the fitted values, random effects included
    converged: bool  #: success reported by the optimiser
    criterion: float  #: -2 times the restricted log-likelihood
    #: (c, k, k) derivatives of `covariance` by the c variances above zero, the residual's last
    slopes: Array
    uncertainty: Array  #: (c, c) covariance of the estimates of those variances

    def degrees_of_freedom(self, contrast: Array) -> float:
        """Satterthwaite's degrees of freedom of a contrast c of the fixed effects, shape (k,).

        2 v^2 / (g' U g), v = c' C c, g its derivatives by the variances, U their covariance. A
        variance at zero is regarded as known. Source: Satterthwaite 1946, Biometrics Bulletin
        2:110; Fai and Cornelius 1996, Journal of Statistical Computation and Simulation 54:363.
        """
        variance = float(contrast @ self.covariance @ contrast)
        slope = np.einsum("i,cij,j->c", contrast, self.slopes, contrast)
        return 2.0 * variance**2 / float(slope @ self.uncertainty @ slope)


def fit_crossed(y: Array, X: Array, factors: Mapping[str, NDArray[np.int64]]) -> Fit:
    """Fit y = X beta + sum over factors Z_f b_f + e by restricted maximum likelihood.

    b_f ~ N(0, s_f^2 I) for every factor, e ~ N(0, s^2 I), all independent. `y` (n,) are
    observations, `X` (n, k) fixed effects, and `factors` contain the level of each observation in
    each random factor, shape (n,); without factors, the fit is that of least squares.

    The profiled criterion in terms of relative standard deviations is regular at a variance of
    zero, which occurs often with few volunteers. Source: Bates, Maechler, Bolker and Walker 2015,
    Journal of Statistical Software 67(1), sections 3.4 and 3.5.
    """
    names = list(factors)
    columns: list[Array] = [np.zeros((len(y), 0))]
    owner: list[int] = []
    for place, levels in enumerate(factors.values()):
        _, index = np.unique(levels, return_inverse=True)
        design = np.eye(int(index.max()) + 1)[index.ravel()]
        columns.append(design)
        owner += [place] * design.shape[1]
    Z = np.concatenate(columns, axis=1)
    equations = _Equations(y, X, Z, np.array(owner, dtype=np.int64))
    theta, converged = _optimum(equations, len(names)) if names else (np.zeros(0), True)
    beta, covariance, residual, residuals = equations.solution(theta)
    variances = dict(zip(names, (residual * theta**2).tolist(), strict=True))
    slopes, uncertainty = equations.uncertainty(theta, residual)
    return Fit(
        beta, covariance, variances | {"residual": residual}, residuals, converged,
        equations.criterion(theta), slopes, uncertainty,
    )  # fmt: skip


def _optimum(equations: "_Equations", count: int) -> tuple[Array, bool]:
    """Relative standard deviations that minimise the criterion, and the success of the search."""

    def gradient(theta: Array) -> Array:
        return 2.0 * theta * equations.slope(theta)

    def descended(start: Array) -> OptimizeResult:
        return minimize(
            equations.criterion, start, method="L-BFGS-B", jac=gradient,
            bounds=[(0.0, LARGEST)] * count, options={"ftol": 1e-14, "gtol": 1e-7},
        )  # fmt: skip

    # The criterion may have a second minimum near the bound; the better of two starts is kept.
    tried = [descended(np.full(count, start)) for start in (1.0, 0.1)]
    best = min(tried, key=lambda each: float(each.fun))
    # The gradient vanishes at zero even if the criterion decreases from there.
    for _ in range(count):
        stuck = (best.x == 0.0) & (equations.slope(best.x) < 0.0)
        step = 0.1 if stuck.any() else 0.0
        while step > NOTHING and equations.criterion(np.where(stuck, step, best.x)) >= best.fun:
            step /= 2.0
        if step <= NOTHING:
            break
        best = descended(np.where(stuck, step, best.x))
    # L-BFGS-B may report a failed line search although both starts agree.
    agree = abs(float(tried[0].fun) - float(tried[1].fun)) < 1e-5
    return np.asarray(best.x, dtype=np.float64), agree or bool(best.success)


class _Equations:
    """Penalised least squares of a mixed model; theta are relative standard deviations."""

    def __init__(self, y: Array, X: Array, Z: Array, owner: NDArray[np.int64]) -> None:
        self.y, self.X, self.Z, self.owner = y, X, Z, owner
        self.ZZ, self.ZX, self.Zy = Z.T @ Z, Z.T @ X, Z.T @ y
        self.XX, self.Xy, self.yy = X.T @ X, X.T @ y, float(y @ y)
        parts = [Z[:, owner == place] for place in range(int(owner.max(initial=-1)) + 1)]
        self.terms = [part @ part.T for part in parts]

    def _solve(self, theta: Array) -> tuple[Array, Array, Array, Array, Array, float]:
        scale = theta[self.owner]
        L = _cholesky(scale[:, None] * self.ZZ * scale + np.eye(len(scale)))
        c: Array = solve_triangular(L, scale * self.Zy, lower=True)
        R_ZX: Array = solve_triangular(L, scale[:, None] * self.ZX, lower=True)
        R_X = _cholesky(self.XX - R_ZX.T @ R_ZX)
        d: Array = solve_triangular(R_X, self.Xy - R_ZX.T @ c, lower=True)
        squares = self.yy - float(c @ c) - float(d @ d)
        # The logarithm of a zero residual would be infinite.
        return L, c, R_ZX, R_X, d, max(squares, 1e-12 * self.yy)

    def criterion(self, theta: Array) -> float:
        """-2 restricted log-likelihood, profiled over fixed effects and residual variance."""
        L, _, _, R_X, _, squares = self._solve(theta)
        free = len(self.y) - self.X.shape[1]
        logs = 2.0 * float(np.log(np.diag(L)).sum() + np.log(np.diag(R_X)).sum())
        return logs + free * (1.0 + math.log(2.0 * math.pi * squares / free))

    def slope(self, theta: Array) -> Array:
        """Derivatives of `criterion` by theta^2, tr P V_f - (n - k) y' P V_f P y / y' P y."""
        P = self._projection(theta)[2]
        Py = P @ self.y
        squares = max(float(self.y @ Py), 1e-12 * self.yy)
        free = len(self.y) - self.X.shape[1]
        traces = [float((P * term).sum()) for term in self.terms]
        forms = [float(Py @ term @ Py) for term in self.terms]
        return np.array(traces) - free * np.array(forms) / squares

    def solution(self, theta: Array) -> tuple[Array, Array, float, Array]:
        """Fixed effects, their covariance, residual variance and residuals."""
        L, c, R_ZX, R_X, d, squares = self._solve(theta)
        beta: Array = solve_triangular(R_X.T, d, lower=False)
        u: Array = solve_triangular(L.T, c - R_ZX @ beta, lower=False)
        residual = squares / (len(self.y) - self.X.shape[1])
        inverse: Array = solve_triangular(R_X, np.eye(len(d)), lower=True)
        fitted = self.X @ beta + self.Z @ (theta[self.owner] * u)
        return beta, residual * (inverse.T @ inverse), residual, self.y - fitted

    def uncertainty(self, theta: Array, residual: float) -> tuple[Array, Array]:
        """Derivatives of the covariance by the positive variances, and the covariance of these.

        Expected information, tr(P V_j P V_k) / 2. Source: Searle, Casella and McCulloch 1992,
        Variance Components, section 6.6.
        """
        C, VX, P = self._projection(theta)
        used = [term for term, each in zip(self.terms, theta, strict=True) if each > NOTHING]
        used.append(np.eye(len(self.y)))
        slopes = np.array([C @ VX.T @ term @ VX @ C for term in used])
        products = [P @ term for term in used]
        information = np.array([[float((a * b.T).sum()) for b in products] for a in products])
        return slopes, 2.0 * residual**2 * _inverse(information)

    def _projection(self, theta: Array) -> tuple[Array, Array, Array]:
        """(X' W X)^-1, W X and P = W - W X (X' W X)^-1 X' W, W the inverse relative covariance."""
        covariance = np.eye(len(self.y))
        for term, each in zip(self.terms, theta, strict=True):
            covariance += each**2 * term
        W = _inverse(covariance)
        WX = W @ self.X
        C = _inverse(self.X.T @ WX)
        return C, WX, W - WX @ C @ WX.T


def _cholesky(A: Array) -> Array:
    return np.linalg.cholesky(A).astype(np.float64)


def _inverse(A: Array) -> Array:
    return np.linalg.inv(A).astype(np.float64)
