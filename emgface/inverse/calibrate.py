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
from emgface.inverse.kept import Kept
from emgface.inverse.mixing import estimated_row, in_order_of
from emgface.inverse.parameters import InverseParameters
from emgface.inverse.problem import Problem, pose_problem
from emgface.inverse.refine import emg_precision
from emgface.inverse.run import fitted
from emgface.inverse.variants import RECORDED
from emgface.muscles import LIP_MARKERS, MUSCLES
from emgface.signals.activation import feature_range
from emgface.signals.parameters import SignalChain
from sim.inverse import Linearised, Quadratic, Splines, minimise_in_box
from sim.state import Array

ROUNDS = 8
"""Iterations of expectation and maximisation."""
GAIN = 0.5, 0.5
"""Mean and standard deviation of the gain before the trials are known [1]."""
DELAYS = np.arange(0.0, 0.1201, 0.005)
"""Delays compared [s]."""
DELAY = 0.04, 0.02
"""Mean and standard deviation of the delay of a person before the trials are known [s]."""
OWN_DELAY = 0.01
"""Standard deviation of the delay of a muscle from that of the person [s]."""
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
    mixing: Array | None = None,
    cross_talk: bool = False,
    kept: Sequence[Kept] = (),
    progress: Callable[[int, int], None] | None = None,
) -> Calibration:
    """Estimate gain, delay and error of every muscle with electrodes, from markers and sEMG.

    The model is sum_j mixing_mj a_j(t) = gain_m e_m(t - delay_m) + error, where e is the sEMG
    normalised over all trials and a the activation by which the face follows the markers. The delay of
    the person is that of the activation from markers alone. Expectation-maximisation on
    the linearised trials alternates between the posterior of a, from markers and sEMG, and the
    regression of a on e with the posterior variance of a in its error, so that a muscle that the
    motion does not determine keeps the values assumed before. The fits of trials are stored in `kept`,
    one for each, from which an interrupted calibration continues. Source of the idea: Pizzolato et al.
    2015, J Biomech 48:3929-3936 (calibration on separate trials); Dempster, Laird and Rubin 1977.

    Parameters
    ----------
    mixing : (n_muscles, n_muscles), optional
        Cross-talk that is known, in the order of `emgface.muscles.MUSCLES`.
    cross_talk : bool
        Estimate the share of the other muscles of the same side in every signal, too.

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
    volunteer = _one_volunteer(recordings)
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
            one = kept[k] if kept else None
            trials.append(_linearised(problem, p, gain, delay, error, one))
    muscles = trials[0].problem.system.muscles
    recorded = np.array([m.rpartition("_")[0] in RECORDED for m in muscles])
    active = [
        np.array([t.problem.delayed(m, DELAY[0]).max() > 0.0 for m in muscles]) for t in trials
    ]
    estimated = recorded & np.any(active, axis=0)
    starts = [t.linearised.coefficients.ravel() for t in trials]
    per = max(p.assumed.emg_memory / trials[0].problem.h, 1.0)
    X = np.eye(n) if mixing is None else in_order_of(mixing, muscles)
    sides = np.array([m.rpartition("_")[2] for m in muscles])

    def expected(use: Array) -> tuple[list[Array], Array, Array]:
        found = [
            _expected(trial, p, (gain, delay, error), X, use, start)
            for trial, start in zip(trials, starts, strict=True)
        ]
        starts_, means, variances = zip(*found, strict=True)
        return list(starts_), np.concatenate(means), np.concatenate(variances)

    signals = {i: partial(_delayed, trials, muscles[i]) for i in np.flatnonzero(estimated).tolist()}
    _, a, variance = expected(0.0 * estimated)  # by the markers alone
    profiles = [profile(e, a[:, i], variance[:, i], ERROR, per) for i, e in signals.items()]
    person = common_delay([one.cost for one in profiles])
    delay[:] = person
    for _ in range(ROUNDS):
        starts, a, variance = expected(estimated)
        mixed, spread = a @ X.T, variance @ (X**2).T
        for i, e in signals.items():
            one = profile(e, mixed[:, i], spread[:, i], float(error[i]), per)
            gain[i], delay[i], error[i] = regressed(one, (person, OWN_DELAY), len(a), per)
            if cross_talk:
                other = np.flatnonzero((sides == sides[i]) & (np.arange(n) != i))
                signal = gain[i] * e(float(delay[i]))
                X[i] = estimated_row(signal, a, variance, i, other, 1.0 / (per * error[i] ** 2))
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
    if cross_talk or mixing is not None:
        names = {"signal": list(muscles), "muscle": list(muscles)}
        share = xr.DataArray(X, dims=("signal", "muscle"), coords=names, attrs={"units": "1"})
        data["mixing"] = share.sel(signal=list(MUSCLES), muscle=list(MUSCLES))
    bounds = session[["minimum", "maximum"]]
    if "muscle" in bounds.dims:
        bounds = bounds.reindex(muscle=list(MUSCLES))
    return Calibration(
        data.merge(bounds).assign_attrs(
            volunteer=volunteer,
            trials=len(recordings),
            sigma_max=simulation.sigma_max,
            model_error=_left_out_error(trials, p, (gain, delay, error), X, estimated),
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
    problem: Problem,
    p: InverseParameters,
    gain: Array,
    delay: Array,
    error: Array,
    kept: Kept | None,
) -> _Trial:
    """Trial linearised at its most probable activations for the values assumed before."""
    each = zip(problem.system.muscles, gain, delay, strict=True)
    emg = np.array([g * problem.delayed(m, d) for m, g, d in each]).T.clip(0.0, 1.0)
    recorded = np.array([m.rpartition("_")[0] in RECORDED for m in problem.system.muscles])
    trust = np.where(recorded, 1.0, 0.0)
    weight = emg_precision(p.assumed, error, trust, problem.h)
    density = p.assumed.density(emg[1:], weight, problem.h)
    refined = fitted(problem, p, density, kept=kept, draws=0)
    return _Trial(problem, refined.linearised, refined.splines, refined.time, refined.marker_weight)


Scales = tuple[Array, Array, Array]
"""Gain, delay and error of all muscles."""


def _prior(
    trial: _Trial, p: InverseParameters, scales: Scales, mixing: Array, use: Array
) -> Quadratic:
    gain, delay, error = scales
    weight = emg_precision(p.assumed, error, np.where(use, 1.0, 0.0), trial.problem.h)
    emg = _emg(trial, gain, delay)
    return p.assumed.density(emg, weight, trial.problem.h, mixing).quadratic


def _expected(
    trial: _Trial, p: InverseParameters, scales: Scales, mixing: Array, use: Array, start: Array
) -> tuple[Array, Array, Array]:
    """Most probable coefficients, and mean and variance (n_steps, n_muscles) of the activations."""
    problem = trial.linearised.normal(trial.marker_weight)
    problem = problem + _prior(trial, p, scales, mixing, use)
    x = minimise_in_box(problem.Q, problem.c, 0.0 * start, 0.0 * start + 1.0, start).x
    n, B = len(use), trial.splines.basis(trial.time)
    covariance = np.linalg.inv(problem.Q).reshape(len(x) // n, n, len(x) // n, n)
    variance = np.array([np.einsum("tk,kl,tl->t", B, covariance[:, i, :, i], B) for i in range(n)])
    return x, B @ x.reshape(-1, n), variance.T


@dataclass(frozen=True)
class Profile:
    """Regression of an activation on the sEMG of one muscle, for each of `DELAYS`.

    Attributes
    ----------
    cost : (n,) twice the negative logarithm of the likelihood times the density of the gain.
    gain, squares : (n,) gain, and sum of squared differences in the mean over the posterior.
    """

    cost: Array
    gain: Array
    squares: Array


def profile(
    e: Callable[[float], Array], a: Array, variance: Array, error: float, per: float
) -> Profile:
    """Most probable gain for every delay, given the activation and its posterior variance.

    Parameters
    ----------
    e : callable
        Normalised sEMG, with a given delay, at the times of a.
    error : float
        Of the previous iteration.
    per : float
        Number of samples that count as one, because the error is correlated.
    """
    shifted = np.array([e(d) for d in DELAYS.tolist()])
    hold = per * error**2 / GAIN[1] ** 2
    gain = np.maximum((shifted @ a + hold * GAIN[0]) / ((shifted**2).sum(axis=1) + hold), 0.0)
    squares = ((a - gain[:, None] * shifted) ** 2).sum(axis=1) + variance.sum()
    cost = squares / (per * error**2) + ((gain - GAIN[0]) / GAIN[1]) ** 2
    return Profile(cost, gain, squares)


def common_delay(costs: Sequence[Array]) -> float:
    """Most probable delay of a person [s], from the costs of all muscles with electrodes."""
    total = ((DELAYS - DELAY[0]) / DELAY[1]) ** 2 + sum(costs, 0.0 * DELAYS)
    return float(DELAYS[int(np.argmin(total))])


def regressed(
    one: Profile, about: tuple[float, float], n: int, per: float
) -> tuple[float, float, float]:
    """Gain, delay [s] and error of one muscle, from `n` samples.

    They maximise the likelihood times the density of the delay, normal with mean and standard deviation
    `about`; the error has `COUNTS` samples of `ERROR` more.
    """
    k = int(np.argmin(one.cost + ((DELAYS - about[0]) / about[1]) ** 2))
    counted = (one.squares[k] / per + COUNTS * ERROR**2) / (n / per + COUNTS)
    return float(one.gain[k]), float(DELAYS[k]), max(float(np.sqrt(counted)), SMALLEST)


def _left_out_error(
    trials: Sequence[_Trial], p: InverseParameters, scales: Scales, mixing: Array, use: Array
) -> float:
    """Relative error of linearised predictions of pairs of markers that are left out."""
    squares, moved, noise = 0.0, 0.0, 0.0
    used = [name for name in LIP_MARKERS if name not in p.left_out]
    pairs = {name.rsplit("_", 1)[0] for name in used}
    for trial in trials:
        whole = trial.linearised
        before = _prior(trial, p, scales, mixing, use)
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


def _one_volunteer(recordings: Sequence[xr.Dataset]) -> str:
    """Name of the volunteer of all recordings; DataError if there is none, or several."""
    if not recordings:
        raise DataError("found no calibration trial, expected at least one recording")
    volunteers = sorted({str(r.attrs.get("volunteer", "")) for r in recordings})
    if len(volunteers) > 1:
        raise DataError(
            f"calibration trials are of volunteers {', '.join(volunteers)}: calibrate each separately"
        )
    return volunteers[0]
