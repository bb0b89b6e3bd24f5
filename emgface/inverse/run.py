"""Inversion of one recording: activations of all muscles from lip markers and sEMG."""

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Literal, get_args

import numpy as np
import xarray as xr

from emgface.errors import ConfigurationError, MarkerError
from emgface.face.motion import settle_face
from emgface.face.recipe import compose_scene, named_elements
from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.calibration import Calibration
from emgface.inverse.kept import Kept, digest_of
from emgface.inverse.mixing import in_order_of
from emgface.inverse.refine import (
    DRAWS,
    LEVEL,
    Assumptions,
    Begun,
    Refined,
    emg_precision,
    refine,
)
from emgface.inverse.variants import Variant, trust_of
from emgface.muscles import LIP_MARKERS
from emgface.signals.activation import IDENTITY, activation_of
from emgface.signals.parameters import SignalChain
from emgface.study.digest import dataset_digest
from emgface.study.measured import measured_during
from sim import Activation, State, System, Workspace, compile_scene
from sim.inverse import MeasuredActivation, PointTarget, Weights, equilibria, track
from sim.state import Array

Form = Literal["trajectory", "step", "quasi_static"]

REST = 0.1
"""Duration at the start of a recording whose mean is the position at rest [s]."""
FOLLOWED = 0.5
"""Misfit over motion of the targets above which the face does not follow the markers [1]."""


@dataclass(frozen=True)
class InverseParameters:
    """Parameters of an inversion.

    Attributes
    ----------
    variant : "driven", "hybrid", "assisted" or "motion"
    form : "trajectory", "step" or "quasi_static"
        Most probable activations over the whole recording, with intervals; or those of every step
        by itself; or those whose equilibria have the positions of the markers, for faces that move
        slowly or are held. The last two have no intervals.
    emg_weight : float
        Weight w_e of the sEMG of a muscle with electrodes, in the assisted variant [1]. In the
        trajectory form, a factor on the inverse variance of its error.
    marker_error : float
        Unit of the residuals of the markers [m].
    chase : float
        Time in which a deviation is to vanish [s]; it averages the noise of the markers.
    size, change : float
        Weights of the size and of the change of the activations [1].
    jump : float
        Largest change of an activation in one step.
    gain : float
        Factor on the normalised sEMG, whose scale is unknown [1].
    delay : float
        Electromechanical delay by which the sEMG precedes the activation [s].
    emg_error : float
        Standard deviation of the sEMG times the gain from the activation [1].
    left_out : tuple of str
        Lip markers that are not tracked, for validation.
    assumed : Assumptions
        Errors that determine the intervals.
    iterations : int
        Largest number of Gauss-Newton iterations of the trajectory form.
    """

    variant: Variant = "assisted"
    form: Form = "trajectory"
    emg_weight: float = 1.0
    marker_error: float = 1e-3
    chase: float = 0.05
    size: float = 0.01
    change: float = 0.1
    jump: float = 0.2
    gain: float = 1.0
    delay: float = 0.04
    emg_error: float = 0.25
    left_out: tuple[str, ...] = ()
    assumed: Assumptions = field(default_factory=Assumptions)
    iterations: int = 5


def form_of(form: str, contact: bool) -> None:
    """Raise ConfigurationError if a form is unknown or does not exist with contact."""
    if form not in get_args(Form):
        raise ConfigurationError(
            f"form {form!r} is unknown, expected one of {', '.join(get_args(Form))}"
        )
    if contact and form == "trajectory":
        raise ConfigurationError(
            "the trajectory form has no derivatives with contact: use --form step, which has no "
            "intervals, or leave contact out"
        )


def without_contact(simulation: SimulationParameters) -> SimulationParameters:
    """Parameters of the same mechanics without contact."""
    none = simulation.contact.model_copy(update={"method": "none"})
    return simulation.model_copy(update={"contact": none})


@dataclass(frozen=True)
class Problem:
    """One recording as a problem of inverse tracking on a face.

    Attributes
    ----------
    system, state, work : scene, its equilibrium and the memory of its solver.
    target : PointTarget
        Of the lip markers that are tracked.
    start, h : time of the recording at the start of the simulation, and step [s].
    emg : Dataset
        Activation from sEMG, before gain and delay.
    scale, noise : ratio of the mouths [1], noise of the markers on the face [m].
    inputs : digest of the face and of the parameters of its mechanics.
    """

    system: System
    state: State
    work: Workspace
    target: PointTarget
    start: float
    h: float
    emg: xr.Dataset
    scale: float
    noise: float
    inputs: str

    @property
    def duration(self) -> float:
        """Length of the recording [s]."""
        return float(self.target.time[-1])

    @property
    def moved(self) -> float:
        """Root mean square displacement of the targets per coordinate [m]."""
        rest = self.state.q[self.target.nodes]
        return float(np.sqrt(np.nanmean((self.target.position - rest) ** 2)))

    def delayed(self, muscle: str, delay: float) -> Array:
        """Activation from sEMG of one muscle at the times of the targets, 0 where not recorded."""
        one = self.emg["activation"].sel(muscle=muscle)
        times = self.start + self.target.time - delay
        return np.interp(times, one["time"].values, one.values, left=0.0, right=0.0)


def pose_problem(
    recording: xr.Dataset,
    face: xr.Dataset,
    simulation: SimulationParameters,
    chain: SignalChain,
    parameters: InverseParameters,
    *,
    settled: xr.Dataset | None = None,
    session: xr.Dataset | None = None,
) -> Problem:
    """Scene, targets and sEMG of a recording; errors as of `invert`."""
    p = parameters
    unknown = [name for name in p.left_out if name not in LIP_MARKERS]
    if unknown:
        raise MarkerError(
            f"left_out contains {unknown[0]!r}, expected lip markers: {', '.join(LIP_MARKERS)}"
        )
    silent = chain.normalisation.model_copy(update={"silent": "zero"})
    chain = chain.model_copy(update={"normalisation": silent})
    emg = activation_of(recording, chain, strategy="act_all", session=session)
    start, stop = (float(emg["time"][k]) for k in (0, -1))
    h = simulation.output
    steps = int((stop - start) / h + 1e-6)
    time = np.linspace(0.0, h * steps, steps + 1, dtype=np.float64)
    position, noise = _positions(recording, face, chain, time, start)

    system = compile_scene(compose_scene(face, simulation))
    settled = settle_face(face, simulation) if settled is None else settled
    rest = system.rest_state()
    state = State(0.0, np.ascontiguousarray(settled["node_position"].values), rest.v, rest.memory)
    used = [name for name in LIP_MARKERS if name not in p.left_out]
    nodes = face["marker_node"].sel(marker=used).values.astype(np.int64)
    wanted, scale = _wanted(position.sel(marker=used), state.q[nodes])
    target = PointTarget(nodes, time, wanted, p.marker_error)
    work = Workspace(system, simulation.linear_solver)
    inputs = digest_of(dataset_digest(face), simulation.model_dump_json())
    return Problem(system, state, work, target, start, h, emg, scale, scale * noise, inputs)


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
    is one; a constant channel counts as missing. `mixing (n_muscles, n_muscles)`,
    in the order of `emgface.muscles.MUSCLES`, replaces the cross-talk of the calibration.

    Returns
    -------
    Dataset
        An activation (`activation(muscle, time)` [1], strategy "inverse" or "assisted") on the time of
        the recording, with ``misfit(time)`` [m], the root mean square distance per coordinate of the
        tracked markers, and ``emg_activation(muscle, time)``, the estimate from sEMG. In the
        trajectory form, with ``activation_low`` and ``activation_high (muscle, time)``, bounds of
        90 % intervals, and the attribute ``undetermined``, sentences on the muscles that cannot be told
        apart; otherwise with ``violation(time)`` and ``saturated(time)``. Attribute ``misfit_ratio``
        [1] is the root mean square of the misfit over that of the displacements wanted.

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
    missing = str(problem.emg.attrs.get("silent", "")).split()
    trust = trust_of(p.variant, muscles, p.emg_weight, missing)
    gain, delay, error = (np.full(len(muscles), x) for x in (p.gain, p.delay, p.emg_error))
    mixing = None if mixing is None else in_order_of(mixing, muscles)
    if calibration is not None:
        gain, delay, error = calibration.of(muscles)
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
    found = refined = None
    with named_elements(face):
        if p.form != "trajectory" or np.isinf(trust).all():
            measured = MeasuredActivation(Activation(problem.target.time, values), trust, mixing)
            found = _followed(problem, p, measured, progress)
        else:
            weight = emg_precision(p.assumed, error, trust, problem.h)
            refined = fitted(
                problem, p, values[1:], weight, kept=kept, progress=progress, mixing=mixing
            )
    result = _result(recording, found, problem, values, p, refined)
    return result.assign_attrs(run_time_s=time.perf_counter() - begun)


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
        found, _ = equilibria(
            problem.system, [target], target.time[1:], weights=weights, measured=measured,
            initial=problem.state, before=before, work=problem.work, progress=progress,
        )  # fmt: skip
        return found
    found, _ = track(
        problem.system, [target], duration=problem.duration, h=h, weights=weights,
        measured=measured, initial=problem.state, before=before, work=problem.work,
        progress=progress,
    )  # fmt: skip
    return found


def fitted(
    problem: Problem,
    p: InverseParameters,
    emg: Array,
    weight: Array,
    *,
    mixing: Array | None = None,
    kept: Kept | None = None,
    progress: Callable[[int, int], None] | None = None,
    draws: int = DRAWS,
) -> Refined:
    """Most probable activations of a recording, from a state that was kept if there is one.

    Parameters
    ----------
    emg, weight : activation from sEMG (n_steps, n_muscles) and its inverse variances (n_muscles,).
    """
    system, target = problem.system, problem.target
    inputs = digest_of(
        problem.inputs, problem.state.q, target.position, problem.h, emg, weight, mixing,
        asdict(p),
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
        system, target, emg, weight, problem.noise, p.assumed, h=problem.h, initial=problem.state,
        work=problem.work, iterations=p.iterations, mixing=mixing, draws=draws, begun=begun,
        after=after,
    )  # fmt: skip
    if progress is not None:
        progress(p.iterations, p.iterations)
    return refined


def _positions(
    recording: xr.Dataset, face: xr.Dataset, chain: SignalChain, time: np.ndarray, start: float
) -> tuple[xr.DataArray, float]:
    """Measured positions (time, marker, axis) [m] at the steps, and their noise [m]."""
    steps = xr.Dataset(coords={"time": time}, attrs={"recorded_start": start, "recorded_pace": 1.0})
    measured = measured_during(recording, steps, face, chain.head_frame)
    return measured["position"].transpose("time", "marker", "axis"), float(measured["noise"].max())


def _wanted(position: xr.DataArray, rest: np.ndarray) -> tuple[np.ndarray, float]:
    """Targets (time, marker, 3) [m] at the markers of the face, and the ratio of the mouths."""
    begin = position.sel(time=slice(0.0, REST)).mean("time").values
    if not np.isfinite(begin).all():
        name = str(position["marker"].values[~np.isfinite(begin).all(axis=1)][0])
        raise MarkerError(
            f"marker {name} is not visible in the first {REST:g} s, expected the mouth at rest: begin "
            "the trial earlier, or leave the marker out"
        )
    size = [np.linalg.norm(x - x.mean(axis=0)) for x in (rest, begin)]
    scale = float(size[0] / size[1])
    return rest + scale * (position.values - begin), scale


def _result(
    recording: xr.Dataset,
    found: xr.Dataset | None,
    problem: Problem,
    estimate: Array,
    p: InverseParameters,
    refined: Refined | None,
) -> xr.Dataset:
    both = ("muscle", "time")
    attrs = {k: v for k, v in recording.attrs.items() if k in IDENTITY}
    if found is not None:
        result = found[["activation", "violation", "saturated"]]
        misfit = p.marker_error * found["misfit"].values
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
        misfit = p.marker_error * np.sqrt(np.nanmean(refined.linearised.residual**2, axis=1))
        attrs |= {"interval": LEVEL, "undetermined": "; ".join(refined.undetermined)}
        attrs |= {"model_error": refined.model_error}
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
    )


def targets_of(
    recording: xr.Dataset, face: xr.Dataset, settled: xr.Dataset, time: np.ndarray
) -> xr.DataArray:
    """Target positions (time, marker, axis) [m] of all lip markers at times of the recording [s].

    They are those of `invert`, for the comparison with a forward simulation.
    """
    position, _ = _positions(recording, face, SignalChain(), time - time[0], float(time[0]))
    nodes = face["marker_node"].sel(marker=list(LIP_MARKERS)).values.astype(np.int64)
    wanted, _ = _wanted(position, settled["node_position"].values[nodes])
    return position.copy(data=wanted)
