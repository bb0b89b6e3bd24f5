"""Densities and errors that are assumed before a recording is fitted."""

from dataclasses import dataclass

import numpy as np

from analysis.arguments import magnitude
from emgface.errors import ConfigurationError
from sim.inverse import PointTarget, Quadratic, Splines, ends_of_steps
from sim.state import Array

FIRST_ERROR = 0.2
"""Error of the model over the motion before it is estimated."""
PRESCRIBED = 0.01
"""Standard deviation of a prescribed activation [1]."""


@dataclass(frozen=True)
class Assumptions:
    """Errors that determine the intervals.

    Attributes
    ----------
    spacing : float
        Distance of the splines of the activations [s].
    model_error : float, optional
        Standard deviation of the difference between the face and the person, over the root mean square
        displacement of the markers [1]; by default estimated from the misfit of the recording.
    strength : float
        Standard deviation of the logarithm of the strength of a muscle of the person over that of the
        face, which the motion does not determine [1]. 0.35 represents half the range of
        simulated volunteers (80 to 150 kPa) about the value of the face, and unequal muscles.
    model_memory, emg_memory : float
        Times within which this difference, and the error of the sEMG, are correlated [s].
    mean, size : float
        Constants of the density exp(-a/mean - (a/size)^2/2) of an activation before anything is
        measured [1]; most muscles are nearly silent.
    change : float
        Standard deviation of its change over 1 s, as of a random walk [1].
    """

    spacing: float = 0.06
    model_error: float | None = None
    strength: float = 0.35
    model_memory: float = 0.3
    emg_memory: float = 0.2
    mean: float = 0.3
    size: float = 0.5
    change: float = 2.0

    def __post_init__(self) -> None:
        """Raise ConfigurationError for numbers that are not finite or too small."""
        for name in ("spacing", "mean", "size", "change"):
            magnitude(name, getattr(self, name), error=ConfigurationError)
        for name in ("strength", "model_memory", "emg_memory"):
            magnitude(name, getattr(self, name), zero=True, error=ConfigurationError)
        if self.model_error is not None:
            magnitude("model_error", self.model_error, zero=True, error=ConfigurationError)

    def splines(self, n_steps: int, h: float) -> tuple[Splines, Array]:
        """Splines over steps of length h [s], and the times (n_steps,) of their ends."""
        time = ends_of_steps(n_steps, h)
        return Splines(float(time[-1]), self.spacing), time

    def density(
        self, emg: Array, emg_weight: Array, h: float, mixing: Array | None = None
    ) -> "Density":
        """Density that `sim.inverse.prior` states, of activations from sEMG (n_steps, n_muscles).

        Parameters
        ----------
        emg_weight : (n_muscles,) of `emg_precision`.
        h : step [s].
        mixing : (n_muscles, n_muscles), optional
            Cross-talk of the sEMG, as of `sim.inverse.MeasuredActivation`.
        """
        splines, time = self.splines(len(emg), h)
        smooth = prior(splines, time, self.size, self.mean, self.change, emg, emg_weight, mixing)
        free = np.where(emg_weight < PRESCRIBED**-2.0, self.strength, 0.0)
        return Density(smooth, free)


@dataclass(frozen=True)
class Density:
    """Density of the activations of a trial before its motion is known.

    ``quadratic`` is the negative logarithm of the density of the coefficients, ``spread``
    (n_muscles,) the standard deviation of the logarithm of the strength of the person's muscles
    over those of the face, which the motion does not determine [1].
    """

    quadratic: Quadratic
    spread: Array


def marker_precision(
    assumed: Assumptions, target: PointTarget, rest: Array, noise: float, h: float
) -> float:
    """Inverse variance of a coordinate of a marker at one step, in units of the target's size.

    The variance is noise^2 + (model_error rms)^2 memory/h: the error of the model is equal in all steps
    within its memory, so that these count as one.
    """
    moved = float(np.sqrt(np.nanmean((target.position - rest) ** 2)))
    lasting = max(assumed.model_memory / h, 1.0)
    share = FIRST_ERROR if assumed.model_error is None else assumed.model_error
    variance = noise**2 + (share * moved) ** 2 * lasting
    return target.size**2 / max(variance, (1e-3 * target.size) ** 2)


def emg_precision(assumed: Assumptions, error: Array, trust: Array, h: float) -> Array:
    """Inverse variances (n_muscles,) of the sEMG at one step; 0 without trust.

    `error` is its standard deviation [1], and `trust` a factor on the inverse variance, infinite for a
    muscle that is prescribed.
    """
    fixed = np.isinf(trust)
    weight = np.where(fixed, 0.0, trust) / (error**2 * max(assumed.emg_memory / h, 1.0))
    return np.where(fixed, PRESCRIBED**-2.0, weight)


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
