"""Restricted maximum likelihood with crossed random effects, regular at variances of zero."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve
from scipy.optimize import OptimizeResult, minimize
from scipy.sparse import csc_array, csr_array

from analysis.errors import StatisticsError
from analysis.statistics.paired import Array

LARGEST_EFFECT_SD: Final = 1e3
"""Upper bound of the standard deviation of a random effect relative to the residual."""

ZERO_SD: Final = 1e-4  #: relative standard deviation below which a variance is regarded as zero


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
    for name, levels in factors.items():
        if np.shape(levels) != np.shape(y):
            raise StatisticsError(
                f"factor {name} has levels of shape {np.shape(levels)}, expected {np.shape(y)}, one per "
                "observation"
            )
    equations = _Equations(y, X, list(factors.values()))
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
            bounds=[(0.0, LARGEST_EFFECT_SD)] * count, options={"ftol": 1e-14, "gtol": 1e-7},
        )  # fmt: skip

    # The criterion may have a second minimum near the bound; the better of two starts is kept.
    tried = [descended(np.full(count, start)) for start in (1.0, 0.1)]
    best = min(tried, key=lambda each: float(each.fun))
    # The gradient vanishes at zero even if the criterion decreases from there.
    for _ in range(count):
        stuck = (best.x == 0.0) & (equations.slope(best.x) < 0.0)
        step = 0.1 if stuck.any() else 0.0
        while step > ZERO_SD and equations.criterion(np.where(stuck, step, best.x)) >= best.fun:
            step /= 2.0
        if step <= ZERO_SD:
            break
        best = descended(np.where(stuck, step, best.x))
    # L-BFGS-B may report a failed line search although both starts agree.
    agree = abs(float(tried[0].fun) - float(tried[1].fun)) < 1e-5
    return np.asarray(best.x, dtype=np.float64), agree or bool(best.success)


class _Equations:
    """Equations of a mixed model; theta are relative standard deviations.

    With the relative covariance V = I + sum over factors theta_f^2 Z_f Z_f', everything follows from

        P = V^-1 - V^-1 X (X' V^-1 X)^-1 X' V^-1 = D - D F A^-1 F' D,
        D = (I + theta_1^2 Z_1 Z_1')^-1,  F = [theta_2 Z_2, ..., X],  A = F' D F + diag(I, 0).

    Z_1 is the factor with most levels. Its levels share no observation, so that D requires sums
    over levels only, and A has the size of the other factors and fixed effects: effort and memory
    grow linearly with the levels of the first factor (volunteers). Source: Searle, Casella and
    McCulloch 1992, Variance Components, sections 6.6 and 7.6.
    """

    def __init__(self, y: Array, X: Array, factors: Sequence[NDArray[np.int64]]) -> None:
        self.y, self.X, self.yy = y, X, float(y @ y)
        self.Z = [_indicators(levels) for levels in factors]
        self.first = int(np.argmax([Z.shape[1] for Z in self.Z])) if self.Z else -1
        self.Z_1 = self.Z[self.first] if self.Z else csr_array((len(y), 0))
        self.counts = np.asarray(self.Z_1.sum(axis=0), dtype=np.float64)
        others = [place for place in range(len(self.Z)) if place != self.first]
        self.others = np.hstack([np.zeros((len(y), 0)), *(self.Z[k].toarray() for k in others)])
        self.owner = np.repeat(others, [self.Z[k].shape[1] for k in others]).astype(np.int64)

    def _reduced(self, theta: Array) -> "_Reduced":
        relative = float(theta[self.first]) ** 2 if self.Z else 0.0
        shrink = relative / (1.0 + relative * self.counts)
        F = np.hstack([self.others * theta[self.owner], self.X])
        DF = F - _product(self.Z_1, shrink[:, None] * _product(self.Z_1.T, F))
        A = F.T @ DF
        A[np.arange(len(self.owner)), np.arange(len(self.owner))] += 1.0
        L = np.linalg.cholesky(A).astype(np.float64)
        inverse: Array = cho_solve((L, True), np.eye(len(A)))
        logs = float(np.log1p(relative * self.counts).sum() + 2.0 * np.log(np.diag(L)).sum())
        Dy = self.y - _product(self.Z_1, shrink * _product(self.Z_1.T, self.y))
        return _Reduced(shrink, DF, inverse, logs, Dy - DF @ (inverse @ (DF.T @ self.y)))

    def _squares(self, at: "_Reduced") -> float:
        """Return y' P y; the logarithm of a zero residual would be infinite."""
        return max(float(self.y @ at.Py), 1e-12 * self.yy)

    def criterion(self, theta: Array) -> float:
        """-2 restricted log-likelihood, profiled over fixed effects and residual variance."""
        at = self._reduced(theta)
        free = len(self.y) - self.X.shape[1]
        return at.logarithm + free * (1.0 + math.log(2.0 * math.pi * self._squares(at) / free))

    def slope(self, theta: Array) -> Array:
        """Derivatives of `criterion` by theta^2, tr P V_f - (n - k) y' P V_f P y / y' P y."""
        at = self._reduced(theta)
        free = len(self.y) - self.X.shape[1]
        forms = np.array([float((_product(Z.T, at.Py) ** 2).sum()) for Z in self.Z])
        return self._traces(at)[0] - free * forms / self._squares(at)

    def solution(self, theta: Array) -> tuple[Array, Array, float, Array]:
        """Fixed effects, their covariance, residual variance and residuals P y."""
        at = self._reduced(theta)
        residual = self._squares(at) / (len(self.y) - self.X.shape[1])
        fixed = slice(len(self.owner), None)
        beta = (at.inverse @ (at.DF.T @ self.y))[fixed]
        return beta, residual * at.inverse[fixed, fixed], residual, at.Py

    def uncertainty(self, theta: Array, residual: float) -> tuple[Array, Array]:
        """Derivatives of the covariance by the positive variances, and the covariance of these.

        Expected information, tr(P V_j P V_k) / 2. Those with the identity, the term of the residual,
        follow from tr P V = n - k and P V P = P.
        """
        at = self._reduced(theta)
        squared, n, count = theta**2, len(self.y) - self.X.shape[1], len(theta)
        traces, products = self._traces(at)
        information = np.zeros((count + 1, count + 1))
        information[:-1, :-1] = products
        information[:-1, -1] = information[-1, :-1] = traces - products @ squared
        information[-1, -1] = n - traces @ squared - information[-1, :-1] @ squared
        used = np.append(theta > ZERO_SD, True)
        VX = (at.DF @ at.inverse)[:, len(self.owner) :]
        parts = [_product(Z.T, VX) for Z in self.Z] + [VX]
        slopes = np.array([part.T @ part for part in parts])[used]
        return slopes, 2.0 * residual**2 * np.linalg.inv(information[np.ix_(used, used)]).astype(
            np.float64
        )

    def _traces(self, at: "_Reduced") -> tuple[Array, Array]:
        """Return tr P V_f and tr P V_f P V_g = |Z_f' P Z_g|^2, of the factors."""
        count = len(self.Z)
        traces, products = np.zeros(count), np.zeros((count, count))
        E = [_product(Z.T, at.DF) for Z in self.Z]
        for f in range(count):
            for g in range(f, count):
                if f == g == self.first:
                    # Diagonal minus a matrix of low rank, which is not formed.
                    diagonal = self.counts - self.counts**2 * at.shrink
                    low = np.einsum("ij,jk,ik->i", E[f], at.inverse, E[f])
                    small = at.inverse @ (E[f].T @ E[f])
                    traces[f] = float((diagonal - low).sum())
                    products[f, f] = float(
                        (diagonal * (diagonal - 2.0 * low)).sum() + (small * small.T).sum()
                    )
                    continue
                wide, narrow = (f, g) if g != self.first else (g, f)
                Z = self.Z[narrow].toarray()
                over = at.shrink[:, None] * _product(self.Z_1.T, Z)
                here = _product(self.Z[wide].T, Z - _product(self.Z_1, over))
                here -= E[wide] @ at.inverse @ E[narrow].T
                traces[f] = float(np.trace(here)) if f == g else traces[f]
                products[f, g] = products[g, f] = float((here**2).sum())
        return traces, products


class _Reduced(NamedTuple):
    """Products and inverse of the equations at given relative standard deviations.

    DF, A and Py are those of the formulas of `_Equations`.
    """

    shrink: Array  #: theta_1^2 / (1 + theta_1^2 n) per level of the first factor
    DF: Array
    inverse: Array  #: A^-1
    logarithm: float  #: log det V + log det X' V^-1 X
    Py: Array


def _indicators(levels: NDArray[np.int64]) -> csr_array:
    """Matrix of ones, (observations, levels)."""
    _, index = np.unique(levels, return_inverse=True)
    index = index.ravel()
    return csr_array((np.ones(len(index)), (np.arange(len(index)), index)))


def _product(matrix: csr_array | csc_array, values: Array) -> Array:
    return np.asarray(matrix @ values, dtype=np.float64)
