"""Targets over a trial as linear functions of the coefficients of splines, and a prior density."""

from dataclasses import dataclass

import numpy as np

from sim.inverse.splines import Splines
from sim.state import Array, State


@dataclass(frozen=True)
class LinearTargets:
    """Linear function of the coefficients of the activations, for targets over a trial.

    Attributes
    ----------
    coefficients : (n_splines, n_muscles) of the linearisation.
    residual : (n_steps, m) wanted minus reached targets over their sizes; NaN where not measured.
    J : (n_steps, m, n_splines n_muscles) derivatives of the reached targets over their sizes; empty
        without derivatives.
    """

    coefficients: Array
    residual: Array
    J: Array

    @property
    def misfit(self) -> float:
        """Half of the sum of squared residuals."""
        return 0.5 * float(np.nansum(self.residual**2))

    def normal(self, precision: Array | float = 1.0) -> "Quadratic":
        """Normal equations of the residuals with precisions (m,) of the targets."""
        weight = np.sqrt(np.broadcast_to(precision, self.residual.shape))
        seen = np.isfinite(self.residual)
        r = np.where(seen, self.residual, 0.0) * weight
        J = (self.J * (weight * seen)[:, :, None]).reshape(-1, self.J.shape[2])
        Q = J.T @ J
        return Quadratic(Q, J.T @ r.ravel() + Q @ self.coefficients.ravel())


@dataclass(frozen=True)
class Linearised(LinearTargets):
    """Targets over a trial as a function of the coefficients, with the end of the trial.

    Attributes
    ----------
    final : State
    exact : bool
        False if J is that at the coefficients of an earlier iteration.
    """

    final: State
    exact: bool = True


@dataclass(frozen=True)
class Quadratic:
    """Function x'Qx/2 - c'x of all coefficients; sums of these are objectives."""

    Q: Array
    c: Array

    def __add__(self, other: "Quadratic") -> "Quadratic":
        """Sum of two functions."""
        return Quadratic(self.Q + other.Q, self.c + other.c)

    def value(self, x: Array) -> float:
        """Value at coefficients of any shape."""
        flat = x.ravel()
        return float(0.5 * flat @ self.Q @ flat - self.c @ flat)


def prior(
    splines: Splines,
    t: Array,
    size: float,
    mean: float,
    change: float,
    measured: Array,
    precision: Array,
    mixing: Array | None = None,
) -> Quadratic:
    """Negative logarithm of a density of the activations before the motion is known.

    The density is proportional to exp(-a/mean - (a/size)^2/2) for every spline, so that few muscles
    are active, times a random walk of changes and a normal density about the sEMG.

    Parameters
    ----------
    splines : Splines
    t : (n_steps,) [s].
    size, mean : float
        Constants of the density [1].
    change : float
        Standard deviation of the change of an activation over 1 s, of a random walk [1].
    measured : (n_steps, n_signals) activation from sEMG.
    precision : (n_signals,) inverse variance of its error over the number of steps within which the
        error is correlated; 0 for a signal that is not measured.
    mixing : (n_signals, n_muscles), optional
        Share of the activation of every muscle in every signal (cross-talk), by default the identity.
    """
    B = splines.basis(t)
    rise = np.diff(np.eye(splines.n), axis=0)
    step = splines.knots[1] - splines.knots[0]
    one = np.eye(splines.n) / size**2 + rise.T @ rise / (change**2 * step)
    X = np.eye(len(precision)) if mixing is None else mixing
    of_size = np.asarray(np.kron(one, np.eye(X.shape[1])), dtype=np.float64)
    Q = of_size + np.asarray(np.kron(B.T @ B, X.T @ (precision[:, None] * X)), dtype=np.float64)
    return Quadratic(Q, (B.T @ (measured * precision) @ X).ravel() - 1.0 / mean)
