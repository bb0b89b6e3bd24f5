"""Estimation of gain, delay and error of the sEMG from calibration trials with markers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import xarray as xr

from emgface.errors import DataError
from emgface.face.motion import settle_face
from emgface.face.recipe import named_elements
from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.calibration import Calibration, over_session
from emgface.inverse.refine import emg_precision, marker_precision, refine
from emgface.inverse.run import InverseParameters, Problem, pose_problem
from emgface.inverse.variants import RECORDED
from emgface.muscles import LIP_MARKERS, MUSCLES
from emgface.signals.activation import feature_range
from emgface.signals.parameters import SignalChain
from sim import Activation
from sim.inverse import (
    Linearised,
    MeasuredActivation,
    Quadratic,
    Splines,
    Weights,
    minimise_in_box,
    track,
)
from sim.state import Array

ROUNDS = 8
"""Iterations of expectation and maximisation."""
GAIN = 0.5, 0.5
"""Mean and standard deviation of the gain before the trials are known [1]."""
DELAYS = np.arange(0.0, 0.1201, 0.005)
"""Delays compared [s]."""
DELAY = 0.04, 0.02
"""Mean and standard deviation of the delay before the trials are known [s]."""
ERROR, COUNTS = 0.25, 4.0
"""Error of the sEMG before the trials are known [1], and the samples for which it counts."""
SMALLEST = 0.02


@dataclass(frozen=True)
class _Trial:
    problem: Problem
    linearised: Linearised
    splines: Splines
    time: Array
    marker_weight: float


def calibrate(
    recordings: Sequence[xr.Dataset],
    face: xr.Dataset,
    simulation: SimulationParameters | None = None,
    chain: SignalChain | None = None,
    parameters: InverseParameters | None = None,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Calibration:
    """Estimate gain, delay and error of every muscle with electrodes, from markers and sEMG.

    The model is a_m(t) = gain_m e_m(t - delay_m) + error, where e is the sEMG normalised over all
    trials and a the activation by which the face follows the markers. Expectation-maximisation on
    the linearised trials alternates between the posterior of a, from markers and sEMG, and the
    regression of a on e with the posterior variance of a in its error, so that a muscle that the
    motion does not determine keeps the values assumed before. Source of the idea: Pizzolato et al.
    2015, J Biomech 48:3929-3936 (calibration on separate trials); Dempster, Laird and Rubin 1977.

    Returns
    -------
    Calibration
        Muscles without electrodes have the mean gain, and the error assumed before. ``model_error`` is
        the error of the face at markers that were left out of the linearised fit, in pairs, over their
        displacement.

    Raises
    ------
    DataError
        There is no trial, or they are of several volunteers.
    Others as `emgface.inverse.run.invert`.
    """
    p, chain = parameters or InverseParameters(), chain or SignalChain()
    simulation = simulation or SimulationParameters()
    if not recordings:
        raise DataError("found no calibration trial, expected at least one recording")
    volunteers = sorted({str(r.attrs.get("volunteer", "")) for r in recordings})
    if len(volunteers) > 1:
        raise DataError(
            f"calibration trials are of volunteers {', '.join(volunteers)}: calibrate each separately"
        )
    chain = over_session(chain)
    session = feature_range(recordings, chain)
    settled = settle_face(face, simulation)
    n = len(MUSCLES)
    gain, delay, error = (np.full(n, x) for x in (GAIN[0], DELAY[0], ERROR))
    trials: list[_Trial] = []
    for k, recording in enumerate(recordings):
        if progress is not None:
            progress(k, len(recordings))
        problem = pose_problem(
            recording, face, simulation, chain, p, settled=settled, session=session
        )
        with named_elements(face):
            trials.append(_linearised(problem, p, gain, delay, error))
    muscles = trials[0].problem.system.muscles
    recorded = np.array([m.rpartition("_")[0] in RECORDED for m in muscles])
    active = [
        np.array([t.problem.delayed(m, DELAY[0]).max() > 0.0 for m in muscles]) for t in trials
    ]
    estimated = recorded & np.any(active, axis=0)
    starts = [t.linearised.coefficients.ravel() for t in trials]
    for _ in range(ROUNDS):
        found = [
            _expected(trial, p, gain, delay, error, estimated, start)
            for trial, start in zip(trials, starts, strict=True)
        ]
        starts = [x for x, _, _ in found]
        for i in np.flatnonzero(estimated).tolist():
            a = np.concatenate([mean[:, i] for _, mean, _ in found])
            variance = np.concatenate([v[:, i] for _, _, v in found])
            per = max(p.assumed.emg_memory / trials[0].problem.h, 1.0)
            e = partial(_delayed, trials, muscles[i])
            gain[i], delay[i], error[i] = regressed(e, a, variance, error[i], per)
    gain[~estimated] = gain[estimated].mean() if estimated.any() else GAIN[0]
    if progress is not None:
        progress(len(recordings), len(recordings))
    data = xr.Dataset(
        {
            "gain": ("muscle", gain, {"units": "1"}),
            "delay": ("muscle", delay, {"units": "s"}),
            "error": ("muscle", error, {"units": "1"}),
            "estimated": ("muscle", estimated.astype(np.int64), {"units": "1"}),
        },
        coords={"muscle": list(muscles)},
    ).sel(muscle=list(MUSCLES))
    bounds = session[["minimum", "maximum"]]
    if "muscle" in bounds.dims:
        bounds = bounds.reindex(muscle=list(MUSCLES))
    return Calibration(
        data.merge(bounds).assign_attrs(
            volunteer=volunteers[0],
            trials=len(recordings),
            sigma_max=simulation.sigma_max,
            model_error=_left_out_error(trials, p, gain, delay, error, estimated),
            range_parameters=session.attrs["parameters"],
            origin=str(recordings[0].attrs.get("origin", "measured")),
        )
    )


def _delayed(trials: Sequence[_Trial], muscle: str, delay: float) -> Array:
    """Normalised sEMG of one muscle at the ends of the steps of all trials."""
    return np.concatenate([trial.problem.delayed(muscle, delay)[1:] for trial in trials])


def _emg(trial: _Trial, gain: Array, delay: Array) -> Array:
    """Activation from sEMG (n_steps, n_muscles) at the ends of the steps."""
    each = zip(trial.problem.system.muscles, gain, delay, strict=True)
    values = [g * trial.problem.delayed(m, d)[1:] for m, g, d in each]
    return np.array(values).T.clip(0.0, 1.0)


def _linearised(
    problem: Problem, p: InverseParameters, gain: Array, delay: Array, error: Array
) -> _Trial:
    """Trial linearised at its most probable activations for the values assumed before."""
    each = zip(problem.system.muscles, gain, delay, strict=True)
    emg = np.array([g * problem.delayed(m, d) for m, g, d in each]).T.clip(0.0, 1.0)
    recorded = np.array([m.rpartition("_")[0] in RECORDED for m in problem.system.muscles])
    trust = np.where(recorded, 1.0, 0.0)
    found, _ = track(
        problem.system,
        [problem.target],
        duration=problem.duration,
        h=problem.h,
        weights=Weights(size=p.size, change=p.change, jump=p.jump, chase=max(p.chase, problem.h)),
        measured=MeasuredActivation(Activation(problem.target.time, emg), trust),
        initial=problem.state,
        work=problem.work,
    )
    rest = problem.state.q[problem.target.nodes]
    weight = marker_precision(p.assumed, problem.target, rest, problem.noise, problem.h)
    refined = refine(
        problem.system, problem.target, found["activation"].values.T, emg[1:],
        emg_precision(p.assumed, error, trust, problem.h), weight, p.assumed,
        h=problem.h, initial=problem.state, work=problem.work, iterations=p.iterations, draws=0,
    )  # fmt: skip
    return _Trial(problem, refined.linearised, refined.splines, refined.time, weight)


def _prior(
    trial: _Trial, p: InverseParameters, gain: Array, delay: Array, error: Array, use: Array
) -> Quadratic:
    weight = emg_precision(p.assumed, error, np.where(use, 1.0, 0.0), trial.problem.h)
    emg, assumed = _emg(trial, gain, delay), p.assumed
    return assumed.prior(trial.splines, trial.time, emg, weight)


def _expected(
    trial: _Trial,
    p: InverseParameters,
    gain: Array,
    delay: Array,
    error: Array,
    use: Array,
    start: Array,
) -> tuple[Array, Array, Array]:
    """Most probable coefficients, and mean and variance (n_steps, n_muscles) of the activations."""
    problem = trial.linearised.normal(trial.marker_weight)
    problem = problem + _prior(trial, p, gain, delay, error, use)
    x = minimise_in_box(problem.Q, problem.c, 0.0 * start, 0.0 * start + 1.0, start).x
    n, B = len(gain), trial.splines.basis(trial.time)
    covariance = np.linalg.inv(problem.Q).reshape(len(x) // n, n, len(x) // n, n)
    variance = np.array([np.einsum("tk,kl,tl->t", B, covariance[:, i, :, i], B) for i in range(n)])
    return x, B @ x.reshape(-1, n), variance.T


def regressed(
    e: Callable[[float], Array], a: Array, variance: Array, error: float, per: float
) -> tuple[float, float, float]:
    """Gain, delay [s] and error of one muscle given its activation a, with its posterior variance.

    They maximise the likelihood of a = gain e(t - delay) + error times the densities of `GAIN` and
    `DELAY`; the error has `COUNTS` samples of `ERROR` more.

    Parameters
    ----------
    e : callable
        Normalised sEMG, with a given delay, at the times of a.
    error : float
        Of the previous iteration.
    per : float
        Number of samples that count as one, because the error is correlated.
    """
    best: tuple[float, float, float, float] | None = None
    for d in DELAYS.tolist():
        one = e(d)
        hold = per * error**2 / GAIN[1] ** 2
        gain = max(float((a @ one + hold * GAIN[0]) / (one @ one + hold)), 0.0)
        squares = float(((a - gain * one) ** 2).sum() + variance.sum())
        cost = squares / (per * error**2) + ((d - DELAY[0]) / DELAY[1]) ** 2
        cost += ((gain - GAIN[0]) / GAIN[1]) ** 2
        if best is None or cost < best[0]:
            best = cost, gain, d, squares
    assert best is not None  # delays are compared
    counted = (best[3] / per + COUNTS * ERROR**2) / (len(a) / per + COUNTS)
    return best[1], best[2], max(float(np.sqrt(counted)), SMALLEST)


def _left_out_error(
    trials: Sequence[_Trial],
    p: InverseParameters,
    gain: Array,
    delay: Array,
    error: Array,
    use: Array,
) -> float:
    """Relative error of linearised predictions of pairs of markers that are left out."""
    squares, moved, noise = 0.0, 0.0, 0.0
    used = [name for name in LIP_MARKERS if name not in p.left_out]
    pairs = {name.rsplit("_", 1)[0] for name in used}
    for trial in trials:
        whole = trial.linearised
        before = _prior(trial, p, gain, delay, error, use)
        start, target = whole.coefficients.ravel(), trial.problem.target
        rest = trial.problem.state.q[target.nodes]
        away = np.repeat(
            np.array([[name.rsplit("_", 1)[0] == pair for name in used] for pair in sorted(pairs)]),
            3,
            axis=1,
        )
        for out in away:
            kept = replace(whole, residual=np.where(out, np.nan, whole.residual))
            problem = kept.normal(trial.marker_weight) + before
            x = minimise_in_box(problem.Q, problem.c, 0.0 * start, 0.0 * start + 1.0, start).x
            left = whole.residual[:, out] - whole.J[:, out] @ (x - start)
            squares += float(np.nansum((target.size * left) ** 2))
            displaced = (target.position - rest).reshape(len(target.time), -1)[1:, out]
            moved += float(np.nansum(displaced**2))
            noise += float(np.isfinite(left).sum()) * trial.problem.noise**2
    return float(np.sqrt(max(squares - noise, 0.0) / max(moved, 1e-300)))
