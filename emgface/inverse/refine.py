"""Most probable activations over a whole recording, with intervals and undetermined directions."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim import State, System, Workspace
from sim.inverse import (
    Linearised,
    PointTarget,
    Posterior,
    Quadratic,
    Splines,
    ends_of_steps,
    fit,
    in_words,
    prior,
)
from sim.state import Array

LEVEL = 0.9
"""Probability of the intervals."""
DRAWS, BURN = 640, 300
"""Draws from the posterior, and sweeps before the first."""
NAMED = 5
"""Largest number of undetermined directions that are named."""
PRESCRIBED = 0.01
"""Standard deviation of a prescribed activation [1]."""


@dataclass(frozen=True)
class Assumptions:
    """Errors that determine the intervals.

    Attributes
    ----------
    spacing : float
        Distance of the splines of the activations [s].
    model_error : float
        Standard deviation of the difference between the face and the person, over the root mean square
        displacement of the markers [1].
    model_memory, emg_memory : float
        Times within which this difference, and the error of the sEMG, are correlated [s].
    mean, size : float
        Constants of the density exp(-a/mean - (a/size)^2/2) of an activation before anything is
        measured [1]; most muscles are nearly silent.
    change : float
        Standard deviation of its change over 1 s, as of a random walk [1].
    """

    spacing: float = 0.06
    model_error: float = 0.2
    model_memory: float = 0.3
    emg_memory: float = 0.2
    mean: float = 0.3
    size: float = 0.5
    change: float = 2.0

    def prior(self, splines: Splines, time: Array, emg: Array, emg_weight: Array) -> Quadratic:
        """Density of the coefficients before the motion is known, as `sim.inverse.prior`."""
        return prior(splines, time, self.size, self.mean, self.change, emg, emg_weight)


@dataclass(frozen=True)
class Refined:
    """Most probable activations of one recording.

    Attributes
    ----------
    activation, low, high : (n_steps, n_muscles)
    undetermined : list of str
        Sentences on directions that the data leave near their prior deviation, at the largest motion.
    linearised : Linearised
    splines : Splines
    time : (n_steps,) [s].
    """

    activation: Array
    low: Array
    high: Array
    undetermined: list[str]
    linearised: Linearised
    splines: Splines
    time: Array


def marker_precision(
    assumed: Assumptions, target: PointTarget, rest: Array, noise: float, h: float
) -> float:
    """Inverse variance of a coordinate of a marker at one step, in units of the target's size.

    The variance is noise^2 + (model_error rms)^2 memory/h: the error of the model is equal in all steps
    within its memory, so that these count as one.
    """
    moved = float(np.sqrt(np.nanmean((target.position - rest) ** 2)))
    lasting = max(assumed.model_memory / h, 1.0)
    variance = noise**2 + (assumed.model_error * moved) ** 2 * lasting
    return target.size**2 / max(variance, (1e-3 * target.size) ** 2)


def emg_precision(assumed: Assumptions, error: Array, trust: Array, h: float) -> Array:
    """Inverse variances (n_muscles,) of the sEMG at one step; 0 without trust.

    `error` is its standard deviation [1], and `trust` a factor on the inverse variance, infinite for a
    muscle that is prescribed.
    """
    fixed = np.isinf(trust)
    weight = np.where(fixed, 0.0, trust) / (error**2 * max(assumed.emg_memory / h, 1.0))
    return np.where(fixed, PRESCRIBED**-2.0, weight)


def refine(
    system: System,
    target: PointTarget,
    start: Array,
    emg: Array,
    emg_weight: Array,
    marker_weight: float,
    assumed: Assumptions,
    *,
    h: float,
    initial: State,
    work: Workspace,
    iterations: int = 3,
    draws: int = DRAWS,
    progress: Callable[[int, int], None] | None = None,
) -> Refined:
    """Fit the activations to a whole recording and determine their intervals.

    The posterior is normal about the linearisation at the most probable activations, within 0-1
    (Laplace); its intervals are the shortest with 90 % of `draws` draws, NaN without any.

    Parameters
    ----------
    start, emg : (n_steps, n_muscles) initial activations, and those estimated from sEMG.
    emg_weight : (n_muscles,) of `emg_precision`.
    marker_weight : float
        Of `marker_precision`.

    Raises
    ------
    SimulationError
        As of `sim.inverse.linearise`.
    """
    time = ends_of_steps(len(start), h)
    splines = Splines(float(time[-1]), assumed.spacing)
    before = assumed.prior(splines, time, emg, emg_weight)
    found = fit(
        system, [target], splines, splines.fitted(time, start), before, precision=marker_weight,
        h=h, initial=initial, work=work, iterations=iterations, progress=progress,
    ).linearised  # fmt: skip
    problem, n = found.normal(marker_weight) + before, len(system.muscles)
    posterior, B = _posterior(problem), splines.basis(time)
    low = high = np.full((len(time), n), np.nan)
    if draws:
        drawn = posterior.draws(draws, burn=BURN, start=found.coefficients.ravel()).reshape(
            draws, splines.n, n
        )
        low, high = shortest(np.einsum("tk,dkn->dtn", B, drawn))
    told = _undetermined(posterior, _posterior(before), B, target, initial, system.muscles)
    return Refined(B @ found.coefficients, low, high, told, found, splines, time)


def shortest(draws: Array, level: float = LEVEL) -> tuple[Array, Array]:
    """Bounds of the shortest intervals that contain a share of draws (n, ...) of activations.

    An interval that begins with the smallest draw begins at 0, and one that ends with the largest
    ends at 1: a muscle may be silent, which a central interval would exclude.
    """
    x = np.sort(draws, axis=0)
    n = len(x)
    k = min(int(np.ceil(level * n)), n - 1)
    first = np.argmin(x[k:] - x[: n - k], axis=0)[None]
    low = np.take_along_axis(x, first, axis=0)[0]
    high = np.take_along_axis(x, first + k, axis=0)[0]
    return np.where(first[0] == 0, 0.0, low), np.where(first[0] + k == n - 1, 1.0, high)


def _posterior(problem: Quadratic) -> Posterior:
    covariance = np.linalg.inv(problem.Q)
    return Posterior(covariance @ problem.c, 0.5 * (covariance + covariance.T))


def _undetermined(
    posterior: Posterior,
    before: Posterior,
    B: Array,
    target: PointTarget,
    initial: State,
    muscles: tuple[str, ...],
) -> list[str]:
    """Name the directions that the motion does not determine at the time of the largest motion."""
    moved = np.nansum((target.position - initial.q[target.nodes]) ** 2, axis=(1, 2))
    row = B[max(int(np.argmax(moved)) - 1, 0)]
    now = np.kron(row, np.eye(len(muscles)))
    one = Posterior(now @ posterior.mean, now @ posterior.covariance @ now.T)
    sd = np.sqrt(np.diag(now @ before.covariance @ now.T))
    return in_words(one.unresolved(sd)[:NAMED], muscles, 0.5)
