"""Targets over a trial as linear functions of the coefficients of splines."""

from dataclasses import dataclass

import numpy as np

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
