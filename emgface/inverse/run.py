"""Inversion of one recording: activations of all muscles from lip markers and sEMG."""

import json
import time
from collections.abc import Callable
from dataclasses import asdict

import numpy as np
import xarray as xr

from emgface.errors import ConfigurationError
from emgface.face.identity import belongs
from emgface.face.recipe import named_elements
from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.assumptions import Density, emg_precision
from emgface.inverse.calibration import Calibration
from emgface.inverse.doubts import signs
from emgface.inverse.kept import Kept, digest_of
from emgface.inverse.mixing import in_order_of
from emgface.inverse.parameters import InverseParameters
from emgface.inverse.problem import Problem, pose_problem
from emgface.inverse.refine import (
    DRAWS,
    INTERVAL_PROBABILITY,
    Begun,
    Refined,
    refine,
)
from emgface.inverse.variants import trust_of
from emgface.recordings.belonging import of_face
from emgface.recordings.findings import with_findings
from emgface.recordings.repeated import warn_of
from emgface.signals.activation import IDENTITY
from emgface.signals.parameters import SignalChain
from sim import Activation, FixedStep, LinearlyImplicitEuler, Markers, simulate
from sim.inverse import MeasuredActivation, Weights, equilibria, track
from sim.state import Array
from sim.threads import one_blas_thread


@one_blas_thread
def invert(
    recording: xr.Dataset,
    face: xr.Dataset,
    simulation: SimulationParameters | None = None,
    chain: SignalChain | None = None,
    parameters: InverseParameters | None = None,
    *,
    settled: xr.Dataset | None = None,
    session: xr.Dataset | None = None,
    calibration: Calibration | None = None,
    mixing: Array | None = None,
    kept: Kept | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> xr.Dataset:
    """Activations by which a face follows the lip markers of a recording.

    The targets are the displacements of the markers since rest in the head frame, times the ratio of
    the sizes of the two mouths, at the markers of the face at rest. Every step is one linear step of
    implicit Euler (`sim.inverse.track`) of `simulation.output`; lost markers are left out while they
    are lost. `session` is the range of the features, if the chain does not normalise over the trial.
    The trajectory form is a fit to the whole recording (`emgface.inverse.refine`), whose state is
    stored in `kept` after every iteration and continues from there. The sEMG is estimated by `chain`
    with the strategy act_all, and its gains, delays and errors are those of the calibration, if there
    is one. Muscles whose channels are absent or constant are free. `mixing (n_muscles, n_muscles)`,
    in the order of `emgface.muscles.MUSCLES`, replaces the cross-talk of the calibration.

    Returns
    -------
    Dataset
        An activation (`activation(muscle, time)` [1], strategy "inverse" or "assisted") on the time of
        the recording, with ``misfit(time)`` [m], the root mean square distance per coordinate of the
        tracked markers, and ``emg_activation(muscle, time)``, the estimate from sEMG. In the
        trajectory form, with ``activation_low`` and ``activation_high (muscle, time)``, bounds of
        90 % intervals, and the attributes ``undetermined``, sentences on the muscles that cannot be
        distinguished, and ``converged``, 0 if the fit did not converge; otherwise with
        ``violation(time)`` and ``saturated(time)``. The attribute ``misfit_ratio`` [1] is the root mean
        square of the misfit over that of the displacements wanted, ``motion_misfit_ratio`` that of a
        motion by the activations (quasi-static form, whose misfit is that of equilibria),
        ``rest_ratio`` that of the displacements during `emgface.inverse.markers.REST` over it,
        further ones are those of `signs`, ``missing`` are the muscles without own sEMG, and
        ``sigma_max`` [Pa] is the largest stress of the face, to which the activations are relative.

    Raises
    ------
    MarkerError
        Markers are missing, or a marker in `left_out` is unknown.
    ConfigurationError, DataError
        As of the signal chain, the variant and the calibration, or `mixing` with another variant than
        assisted.
    SimulationError
        A step failed; the face is inverted with linear steps of one size. SceneError: the trajectory
        form does not exist with contact.
    """
    begun = time.perf_counter()
    p, chain = parameters or InverseParameters(), chain or SignalChain()
    simulation = simulation or SimulationParameters()
    if calibration is not None:
        chain, session = calibration.applied(chain, simulation.sigma_max, recording)
    problem = pose_problem(recording, face, simulation, chain, p, settled=settled, session=session)
    muscles = problem.system.muscles
    missing = str(problem.emg.attrs["missing"]).split()
    trust = trust_of(p.variant, muscles, p.emg_weight, missing)
    gain, delay, error = (np.full(len(muscles), x) for x in (p.gain, p.delay, p.emg_error))
    mixing = None if mixing is None else in_order_of(mixing, muscles)
    if calibration is not None:
        gain, delay, error = calibration.for_muscles(muscles)
        if mixing is None and p.variant == "assisted":
            mixing = calibration.mixing(muscles)
    if mixing is not None and p.variant != "assisted":
        raise ConfigurationError(
            f"cross-talk is not part of the variant {p.variant!r}, which "
            + ("uses no sEMG" if p.variant == "motion" else "prescribes muscles")
            + ": use the variant 'assisted', or leave the mixing matrix out"
        )
    each = zip(muscles, gain, delay, strict=True)
    values = np.array([g * problem.delayed(m, d) for m, g, d in each]).T.clip(0.0, 1.0)
    tracked = refined = None
    with named_elements(face):
        if p.form != "trajectory" or np.isinf(trust).all():
            measured = MeasuredActivation(Activation(problem.target.time, values), trust, mixing)
            tracked = _followed(problem, p, measured, progress)
        else:
            weight = emg_precision(p.assumed, error, trust, problem.h)
            density = p.assumed.density(values[1:], weight, problem.h, mixing)
            refined = fitted(problem, p, density, kept=kept, progress=progress)
    result = belongs(_result(recording, tracked, problem, values, p, refined), face)
    if calibration is not None:
        other = of_face(calibration.data.attrs, face, "calibration")
        warn_of(other)
        result = with_findings(result, other)
    return result.assign_attrs(
        signs(problem, recording, p.variant != "motion", float(np.mean(delay))),
        run_time_s=time.perf_counter() - begun,
        sigma_max=simulation.sigma_max,
    )


def _followed(
    problem: Problem,
    p: InverseParameters,
    measured: MeasuredActivation,
    progress: Callable[[int, int], None] | None,
) -> xr.Dataset:
    """Activations of every time by itself: of steps, or of equilibria."""
    target, h = problem.target, problem.h
    weights = Weights(size=p.size, change=p.change, jump=p.jump, chase=max(p.chase, h))
    before = np.where(np.isinf(measured.trust), measured.activation.values[0], 0.0)
    if p.form == "quasi_static":
        tracked, _ = equilibria(
            problem.system, [target], target.time[1:], weights=weights, measured=measured,
            initial=problem.state, before=before, work=problem.work, progress=progress,
        )  # fmt: skip
        activations = tracked["activation"].transpose("time", "muscle").values
        moved = motion_misfit(problem, np.concatenate([before[None], activations]))
        return tracked.assign_attrs(motion_misfit=moved)
    tracked, _ = track(
        problem.system, [target], duration=problem.duration, h=h, weights=weights,
        measured=measured, initial=problem.state, before=before, work=problem.work,
        progress=progress,
    )  # fmt: skip
    return tracked


def motion_misfit(problem: Problem, activations: Array) -> float:
    """Root mean square distance per coordinate [m] of the targets from a face that moves.

    `activations` (time, muscle) are those at the times of the targets; the face is simulated with the
    linear steps of the other forms.
    """
    target = problem.target
    names = tuple(map(str, range(len(target.nodes))))
    motion, _ = simulate(
        problem.system,
        Activation(target.time, activations),
        duration=problem.duration,
        integrator=LinearlyImplicitEuler(),
        steps=FixedStep(problem.h),
        probes=(Markers(target.nodes, names),),
        initial=problem.state,
        work=problem.work,
    )
    reached = motion["position"].transpose("time", "marker", "axis").values
    return float(np.sqrt(np.nanmean((reached - target.position)[1:] ** 2)))


def fitted(
    problem: Problem,
    p: InverseParameters,
    density: Density,
    *,
    kept: Kept | None = None,
    progress: Callable[[int, int], None] | None = None,
    draws: int = DRAWS,
) -> Refined:
    """Most probable activations of a recording, from a state that was kept if there is one."""
    system, target = problem.system, problem.target
    inputs = digest_of(
        problem.inputs, problem.state.q, target.position, problem.h, density.quadratic.Q,
        density.quadratic.c, asdict(p),
    )  # fmt: skip

    def after(state: Begun) -> None:
        if kept is not None:
            kept.write(inputs, state)
        if progress is not None:
            progress(state.done, p.iterations)

    begun = None if kept is None else kept.read(inputs)
    if progress is not None:
        progress(0 if begun is None else begun.done, p.iterations)
    refined = refine(
        system, target, density, problem.noise, p.assumed, h=problem.h, initial=problem.state,
        work=problem.work, iterations=p.iterations, draws=draws, begun=begun, after=after,
    )  # fmt: skip
    if progress is not None:
        progress(p.iterations, p.iterations)
    return refined


def _result(
    recording: xr.Dataset,
    tracked: xr.Dataset | None,
    problem: Problem,
    estimate: Array,
    p: InverseParameters,
    refined: Refined | None,
) -> xr.Dataset:
    both = ("muscle", "time")
    attrs = {k: v for k, v in recording.attrs.items() if k in IDENTITY}
    if tracked is not None:
        result = tracked[["activation", "violation", "saturated"]]
        misfit = p.marker_error * tracked["misfit"].values
        if "motion_misfit" in tracked.attrs and problem.moved > 0.0:
            attrs["motion_misfit_ratio"] = tracked.attrs["motion_misfit"] / problem.moved
    else:
        assert refined is not None  # one of both forms
        parts = {
            "activation": refined.activation,
            "activation_low": refined.low,
            "activation_high": refined.high,
        }
        result = xr.Dataset(
            {name: (both, values.T, {"units": "1"}) for name, values in parts.items()},
            coords={"muscle": list(problem.system.muscles), "time": refined.time},
        )
        squares = refined.linearised.residual**2
        seen = np.isfinite(squares).sum(axis=1)
        mean = np.nansum(squares, axis=1) / np.maximum(seen, 1)
        misfit = p.marker_error * np.sqrt(np.where(seen > 0, mean, np.nan))
        attrs |= {"interval": INTERVAL_PROBABILITY, "undetermined": "; ".join(refined.undetermined)}
        attrs |= {"model_error": refined.model_error, "converged": int(refined.converged)}
    at = problem.start + result["time"].values
    result = result.assign_coords(time=("time", at, {"units": "s"}))
    result["misfit"] = ("time", misfit, {"units": "m"})
    result["emg_activation"] = (both, estimate[1:].T, {"units": "1"})
    muscles = [str(name) for name in problem.emg["muscle"].values]
    result, moved = result.sel(muscle=muscles), problem.moved
    return result.assign_attrs(
        attrs,
        strategy="inverse" if p.variant == "motion" else p.variant,
        montage=problem.emg.attrs.get("montage", ""),
        parameters=json.dumps(asdict(p)),
        mouth_ratio=problem.scale,
        marker_noise=problem.noise,
        misfit_ratio=float(np.sqrt(np.nanmean(misfit**2))) / moved if moved > 0 else np.nan,
        rest_ratio=problem.at_rest / moved if moved > 0 else np.nan,
        missing=problem.emg.attrs["missing"],
    )
