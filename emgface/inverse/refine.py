"""Most probable activations over a whole recording, with intervals and undetermined directions."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from emgface.inverse.assumptions import Assumptions, Density, marker_precision
from emgface.inverse.posterior import Posterior, in_words
from sim import State, System, Workspace
from sim.inverse import (
    Fit,
    Linearised,
    PointTarget,
    Quadratic,
    Splines,
    fit,
)
from sim.state import Array

INTERVAL_PROBABILITY = 0.9
"""Probability of the intervals."""
REFINE_ITERATIONS = 3
"""Iterations before the error of the model is estimated."""
DRAWS, REFINE_BURN, APART = 640, 100, 10
"""Draws from the posterior, and sweeps before the first of a chain and between its draws."""
ONE_SIDED = 0.2
"""Ratio of its bounds below which an interval begins at 0."""
MOST_ERROR = 0.4
"""Largest error that is estimated: beyond it the sEMG would replace the markers and add misfit."""
NAMED = 5
"""Largest number of undetermined directions that are named."""


@dataclass(frozen=True)
class Begun:
    """State of a fit after ``done`` iterations: coefficients (n_splines, n_muscles) and model error.

    ``model_error`` is assumed or was found; it is None before it is found.
    """

    coefficients: Array
    done: int
    model_error: float | None


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
    marker_weight : float
        Of `marker_precision`, with the error of the model that was assumed or found.
    model_error : float
        The latter [1].
    converged : bool
        As of `sim.inverse.Fit`.
    """

    activation: Array
    low: Array
    high: Array
    undetermined: list[str]
    linearised: Linearised
    splines: Splines
    time: Array
    marker_weight: float
    model_error: float
    converged: bool


def refine(
    system: System,
    target: PointTarget,
    density: Density,
    noise: float,
    assumed: Assumptions,
    *,
    h: float,
    initial: State,
    work: Workspace,
    iterations: int = 12,
    draws: int = DRAWS,
    begun: Begun | None = None,
    after: Callable[[Begun], None] | None = None,
) -> Refined:
    """Fit the activations to a whole recording and determine their intervals.

    The posterior is normal about the linearisation at the most probable activations, within 0-1
    (Laplace); its intervals are those of `intervals` from `draws` draws, NaN without any. If the error
    of the model is to be estimated, the residual after `REFINE_ITERATIONS` iterations is that of
    the model and the noise, and at least one more follows.

    Parameters
    ----------
    target : PointTarget
        Its times are those of the steps, the first at the start.
    density : Density
        Of the activations before the motion is known.
    noise : float
        Standard deviation of a coordinate of a marker [m].
    iterations : int
        Largest number of Gauss-Newton iterations.
    begun : Begun, optional
        Of an interrupted fit, which continues; zero activations by default.
    after : callable, optional
        Called with the state after every iteration.

    Raises
    ------
    SimulationError
        As of `sim.inverse.linearise`.
    """
    splines, time = assumed.splines(len(target.time) - 1, h)
    n, rest = len(system.muscles), initial.q[target.nodes]
    before = density.quadratic
    state = begun or Begun(np.zeros((splines.n, n)), 0, assumed.model_error)

    def fitted(begin: Array | Linearised, most: int) -> Fit:
        at, error = state.done, state.model_error

        def passed(one: Linearised, k: int) -> None:
            if after is not None:
                after(Begun(one.coefficients, at + k, error))

        return fit(
            system, [target], splines, begin, before, precision=weight, h=h, initial=initial,
            work=work, iterations=most, after=passed,
        )  # fmt: skip

    known = replace(assumed, model_error=state.model_error)
    weight, begin = marker_precision(known, target, rest, noise, h), state.coefficients
    if state.model_error is None:
        begin = fitted(begin, max(min(REFINE_ITERATIONS, iterations) - state.done, 0)).linearised
        relative_error = min(model_error(begin, target, rest, noise), MOST_ERROR)
        state = Begun(begin.coefficients, REFINE_ITERATIONS, relative_error)
        known = replace(assumed, model_error=relative_error)
        weight = marker_precision(known, target, rest, noise, h)
        iterations = max(iterations, REFINE_ITERATIONS + 1)
    last = fitted(begin, max(iterations - state.done, 0))
    final = last.linearised
    problem = final.normal(weight) + before
    posterior, B = _posterior(problem), splines.basis(time)
    low = high = np.full((len(time), n), np.nan)
    if draws:
        centre = final.coefficients.ravel()
        drawn = posterior.draws(draws, burn=REFINE_BURN, apart=APART, centre=centre)
        strengths = np.random.default_rng(1).standard_normal((draws, 1, n))
        drawn = drawn.reshape(draws, splines.n, n) * np.exp(density.spread * strengths)
        low, high = intervals(np.einsum("tk,dkn->dtn", B, drawn).clip(0.0, 1.0))
    unresolved = _undetermined(posterior, _posterior(before), B, target, initial, system.muscles)
    activation, error = B @ final.coefficients, float(known.model_error or 0.0)
    return Refined(
        activation, low, high, unresolved, final, splines, time, weight, error, last.converged
    )


def model_error(linearised: Linearised, target: PointTarget, rest: Array, noise: float) -> float:
    """Residual beyond the noise over the root mean square displacement of the markers [1]."""
    residual = float(np.nanmean((target.size * linearised.residual) ** 2))
    moved = float(np.nanmean((target.position - rest) ** 2))
    return float(np.sqrt(max(residual - noise**2, 0.0) / max(moved, 1e-300)))


def intervals(draws: Array, level: float = INTERVAL_PROBABILITY) -> tuple[Array, Array]:
    """Bounds of intervals that contain a share of draws (n, ...) of activations.

    They are the shortest, which contain the densest values. One that begins below `ONE_SIDED` of its
    end begins at 0 and ends at the quantile of the level: a muscle may be silent, which a sample of a
    continuous density excludes.
    """
    x = np.sort(draws, axis=0)
    n = len(x)
    k = min(int(np.ceil(level * n)), n - 1)
    first = np.argmin(x[k:] - x[: n - k], axis=0)[None]
    low = np.take_along_axis(x, first, axis=0)[0]
    high = np.take_along_axis(x, first + k, axis=0)[0]
    one_sided = (low <= ONE_SIDED * high) | (first[0] == 0)
    high = np.where(one_sided, x[k], high)
    return np.where(one_sided, 0.0, low), np.where(first[0] + k == n - 1, 1.0, high)


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
