"""Estimation of gain, delay and error of the sEMG from calibration trials with markers."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import xarray as xr

from emgface.errors import DataError
from emgface.face.identity import belongs
from emgface.face.motion import settle_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.calibration import Calibration, over_session
from emgface.inverse.calibration_trial import (
    DELAY,
    ERROR,
    GAIN,
    CalibrationTrial,
    Scales,
    fit_trial,
)
from emgface.inverse.mixing import estimated_row, in_order_of
from emgface.inverse.parameters import InverseParameters
from emgface.inverse.regression import common_delay, profile, regressed
from emgface.inverse.variants import RECORDED_MUSCLES
from emgface.muscles import LIP_MARKERS, MUSCLES
from emgface.signals.activation import feature_range
from emgface.signals.parameters import SignalChain
from emgface.study.table import refuse_copies
from sim.inverse import minimise_in_box
from sim.state import Array
from sim.threads import one_blas_thread

CALIBRATION_ROUNDS = 8
"""Iterations of expectation and maximisation."""
OWN_DELAY = 0.01
"""Standard deviation of the delay of a muscle from that of the person [s]."""


def calibrate(
    recordings: Sequence[xr.Dataset],
    face: xr.Dataset,
    simulation: SimulationParameters | None = None,
    chain: SignalChain | None = None,
    parameters: InverseParameters | None = None,
    *,
    mixing: Array | None = None,
    cross_talk: bool = False,
) -> Calibration:
    """Estimate gain, delay and error of every muscle with electrodes, from markers and sEMG.

    The trials are fitted one after the other (`fit_trial`); those of files, by workers, with
    `emgface.inverse.calibrate_many.calibrate_all`. Then as `estimate`.

    Raises
    ------
    DataError
        There is no trial, or they are of several volunteers.
    Others as `emgface.inverse.run.invert`.
    """
    p, chain = parameters or InverseParameters(), over_session(chain or SignalChain())
    simulation = simulation or SimulationParameters()
    volunteer = volunteer_of(recordings)
    origin = str(recordings[0].attrs.get("origin", "measured"))
    session = feature_range(recordings, chain)
    settled = settle_face(face, simulation)
    trials = [
        fit_trial(one, face, simulation, chain, p, settled=settled, session=session)
        for one in recordings
    ]
    estimated = estimate(trials, p, session, mixing=mixing, cross_talk=cross_talk)
    return described_calibration(estimated, volunteer, face, simulation, origin)


def described_calibration(
    data: xr.Dataset,
    volunteer: str,
    face: xr.Dataset,
    simulation: SimulationParameters,
    origin: str,
) -> Calibration:
    """Calibration of a volunteer on a face, of trials that are measured or simulated."""
    about = {"volunteer": volunteer, "sigma_max": simulation.sigma_max, "origin": origin}
    return Calibration(belongs(data.assign_attrs(about), face))


@one_blas_thread
def estimate(
    trials: Sequence[CalibrationTrial],
    p: InverseParameters,
    session: xr.Dataset,
    *,
    mixing: Array | None = None,
    cross_talk: bool = False,
) -> xr.Dataset:
    """Estimate gain, delay and error of every muscle with electrodes from fitted trials.

    The model is sum_j mixing_mj a_j(t) = gain_m e_m(t - delay_m) + error, where e is the sEMG
    normalised over all trials and a the activation by which the face follows the markers. The delay
    of the person is that of the activation from markers alone. Expectation-maximisation on the
    linearised trials alternates between the posterior of a, from markers and sEMG, and the
    regression of a on e with the posterior variance of a in its error, so that a muscle that the
    motion does not determine keeps the values assumed before. Source of the idea: Pizzolato et al.
    2015, J Biomech 48:3929-3936 (calibration on separate trials); Dempster, Laird and Rubin 1977.

    `session` is the range of the features over all trials; `mixing` (n_muscles, n_muscles) is known
    cross-talk in the order of `emgface.muscles.MUSCLES`, and with `cross_talk` the share of the
    other muscles of the same side in every signal is estimated, too. Muscles without electrodes
    have the mean gain, and the error assumed before. ``model_error`` is the error of the face at
    markers left out of the linearised fit (two at a time), divided by the displacement of these
    markers.
    """
    muscles, n = trials[0].muscles, len(trials[0].muscles)
    recorded = np.array([m.rpartition("_")[0] in RECORDED_MUSCLES for m in muscles])
    active = [np.array([t.delayed(m, DELAY[0]).max() > 0.0 for m in range(n)]) for t in trials]
    estimated = recorded & np.any(active, axis=0)
    X = np.eye(n) if mixing is None else in_order_of(mixing, muscles)
    scales = _maximised(trials, p, X, estimated, cross_talk)
    gain, delay, error = scales
    gain[~estimated] = gain[estimated].mean() if estimated.any() else GAIN[0]
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
    return data.merge(bounds).assign_attrs(
        trials=len(trials),
        model_error=_left_out_error(trials, p, scales, X, estimated),
        range_parameters=session.attrs["parameters"],
    )


def _maximised(
    trials: Sequence[CalibrationTrial],
    p: InverseParameters,
    X: Array,
    estimated: Array,
    cross_talk: bool,
) -> Scales:
    """Gain, delay and error of the muscles by expectation-maximisation, and in X the cross-talk."""
    n, muscles = len(estimated), trials[0].muscles
    gain, delay, error = (np.full(n, x) for x in (GAIN[0], DELAY[0], ERROR))
    starts = [t.coefficients.ravel() for t in trials]
    per = max(p.assumed.emg_memory / trials[0].h, 1.0)
    sides = np.array([m.rpartition("_")[2] for m in muscles])

    def expected(use: Array) -> tuple[list[Array], Array, Array]:
        moments = [
            _expected(trial, p, (gain, delay, error), X, use, start)
            for trial, start in zip(trials, starts, strict=True)
        ]
        starts_, means, variances = zip(*moments, strict=True)
        return list(starts_), np.concatenate(means), np.concatenate(variances)

    signals = {i: partial(_delayed, trials, i) for i in np.flatnonzero(estimated).tolist()}
    _, a, variance = expected(0.0 * estimated)  # by the markers alone
    profiles = [profile(e, a[:, i], variance[:, i], ERROR, per) for i, e in signals.items()]
    person = common_delay([one.cost for one in profiles])
    delay[:] = person
    for _ in range(CALIBRATION_ROUNDS):
        starts, a, variance = expected(estimated)
        mixed, spread = a @ X.T, variance @ (X**2).T
        for i, e in signals.items():
            one = profile(e, mixed[:, i], spread[:, i], float(error[i]), per)
            gain[i], delay[i], error[i] = regressed(one, (person, OWN_DELAY), len(a), per)
            if cross_talk:
                other = np.flatnonzero((sides == sides[i]) & (np.arange(n) != i))
                signal = gain[i] * e(float(delay[i]))
                X[i] = estimated_row(signal, a, variance, i, other, 1.0 / (per * error[i] ** 2))
    return gain, delay, error


def _delayed(trials: Sequence[CalibrationTrial], muscle: int, delay: float) -> Array:
    """Normalised sEMG of one muscle at the ends of the steps of all trials."""
    return np.concatenate([trial.delayed(muscle, delay) for trial in trials])


def _expected(
    trial: CalibrationTrial,
    p: InverseParameters,
    scales: Scales,
    mixing: Array,
    use: Array,
    start: Array,
) -> tuple[Array, Array, Array]:
    """Most probable coefficients, and mean and variance (n_steps, n_muscles) of the activations."""
    problem = trial.linearised.normal(trial.marker_weight) + trial.prior(p, scales, mixing, use)
    x = minimise_in_box(problem.Q, problem.c, 0.0 * start, 0.0 * start + 1.0, start).x
    n, B = len(use), trial.basis
    covariance = np.linalg.inv(problem.Q).reshape(len(x) // n, n, len(x) // n, n)
    variance = np.array([np.einsum("tk,kl,tl->t", B, covariance[:, i, :, i], B) for i in range(n)])
    return x, B @ x.reshape(-1, n), variance.T


def _left_out_error(
    trials: Sequence[CalibrationTrial],
    p: InverseParameters,
    scales: Scales,
    mixing: Array,
    use: Array,
) -> float:
    """Relative error of linearised predictions of pairs of markers that are left out."""
    squares, moved, noise = 0.0, 0.0, 0.0
    used = [name for name in LIP_MARKERS if name not in p.left_out]
    pairs = {name.rsplit("_", 1)[0] for name in used}
    away = np.repeat(
        np.array([[name.rsplit("_", 1)[0] == pair for name in used] for pair in sorted(pairs)]),
        3,
        axis=1,
    )
    for trial in trials:
        whole, before = trial.linearised, trial.prior(p, scales, mixing, use)
        start = whole.coefficients.ravel()
        for out in away:
            kept = replace(whole, residual=np.where(out, np.nan, whole.residual))
            problem = kept.normal(trial.marker_weight) + before
            x = minimise_in_box(problem.Q, problem.c, 0.0 * start, 0.0 * start + 1.0, start).x
            left = whole.residual[:, out] - whole.J[:, out] @ (x - start)
            squares += float(np.nansum((trial.size * left) ** 2))
            moved += float(np.nansum(trial.displacement[:, out] ** 2))
            noise += float(np.isfinite(left).sum()) * trial.noise**2
    return float(np.sqrt(max(squares - noise, 0.0) / max(moved, 1e-300)))


def volunteer_of(recordings: Sequence[xr.Dataset]) -> str:
    """Name of the volunteer of all recordings; DataError if there is none, several, or a copy."""
    if not recordings:
        raise DataError("found no calibration trial, expected at least one recording")
    volunteers = sorted({str(r.attrs.get("volunteer", "")) for r in recordings})
    if len(volunteers) > 1:
        raise DataError(
            f"calibration trials are of volunteers {', '.join(volunteers)}: calibrate each separately"
        )
    if not volunteers[0]:
        raise DataError(
            "the calibration trials name no volunteer, expected one, by which other recordings are "
            "matched: set it in the mapping or the attributes of the recordings"
        )
    refuse_copies(recordings)
    return volunteers[0]
