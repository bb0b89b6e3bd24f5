"""Inversion of one recording: activations of all muscles from lip markers and sEMG."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import xarray as xr

from emgface.errors import MarkerError
from emgface.face.motion import settle_face
from emgface.face.recipe import compose_scene, named_elements
from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.variants import Variant, trust_of
from emgface.muscles import LIP_MARKERS
from emgface.signals.activation import IDENTITY, activation_of
from emgface.signals.parameters import SignalChain
from emgface.study.measured import measured_during
from sim import Activation, State, Workspace, compile_scene
from sim.inverse import MeasuredActivation, PointTarget, Weights, track

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
    emg_weight : float
        Weight w_e of the sEMG of a muscle with electrodes, in the assisted variant [1].
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
    left_out : tuple of str
        Lip markers that are not tracked, for validation.
    """

    variant: Variant = "assisted"
    emg_weight: float = 1.0
    marker_error: float = 1e-3
    chase: float = 0.05
    size: float = 0.01
    change: float = 0.1
    jump: float = 0.2
    gain: float = 1.0
    delay: float = 0.04
    left_out: tuple[str, ...] = ()


def invert(
    recording: xr.Dataset,
    face: xr.Dataset,
    simulation: SimulationParameters | None = None,
    chain: SignalChain | None = None,
    parameters: InverseParameters | None = None,
    *,
    settled: xr.Dataset | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> xr.Dataset:
    """Activations by which a face follows the lip markers of a recording.

    The targets are the displacements of the markers since rest in the head frame, times the ratio of
    the sizes of the two mouths, at the markers of the face at rest. Every step is one linear step of
    implicit Euler (`sim.inverse.track`) of `simulation.output`; lost markers are left out while they
    are lost. The sEMG is estimated by `chain` with the strategy act_all; a constant channel counts as
    missing.

    Returns
    -------
    Dataset
        An activation (`activation(muscle, time)` [1], strategy "inverse" or "assisted") on the time of
        the recording, with ``misfit(time)`` [m], the root mean square distance per coordinate of the
        tracked markers, ``violation(time)`` and ``saturated(time)``, and ``emg_activation(muscle,
        time)``, the estimate from sEMG. Attribute ``misfit_ratio`` [1] is the root mean square of the
        misfit over that of the displacements wanted.

    Raises
    ------
    MarkerError
        Markers are missing, or a marker in `left_out` is unknown.
    ConfigurationError, DataError
        As of the signal chain and the variant.
    SimulationError
        A step failed; the face is inverted with linear steps of one size.
    """
    p, chain = parameters or InverseParameters(), chain or SignalChain()
    simulation = simulation or SimulationParameters()
    unknown = [name for name in p.left_out if name not in LIP_MARKERS]
    if unknown:
        raise MarkerError(
            f"left_out contains {unknown[0]!r}, expected lip markers: {', '.join(LIP_MARKERS)}"
        )
    silent = chain.normalisation.model_copy(update={"silent": "zero"})
    chain = chain.model_copy(update={"normalisation": silent})
    emg = activation_of(recording, chain, strategy="act_all")
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
    targets = [PointTarget(nodes, time, wanted, p.marker_error)]
    estimate = p.gain * emg["activation"].interp(time=start + time - p.delay, kwargs=_HELD)
    estimate = estimate.clip(0.0, 1.0).sel(muscle=list(system.muscles))
    values = np.ascontiguousarray(estimate.transpose("time", "muscle").values)
    missing = str(emg.attrs.get("silent", "")).split()
    trust = trust_of(p.variant, system.muscles, p.emg_weight, missing)
    with named_elements(face):
        found, _ = track(
            system,
            targets,
            duration=float(time[-1]),
            h=h,
            weights=Weights(size=p.size, change=p.change, jump=p.jump, chase=max(p.chase, h)),
            measured=MeasuredActivation(Activation(time, values), trust),
            initial=state,
            before=np.where(np.isinf(trust), values[0], 0.0),
            work=Workspace(system, simulation.linear_solver),
            progress=progress,
        )
    moved = float(np.sqrt(np.nanmean((wanted - state.q[nodes]) ** 2)))
    return _result(recording, found, emg, values, start, p, scale, noise, moved)


_HELD: dict[str, Any] = {"bounds_error": False, "fill_value": 0.0}


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
    found: xr.Dataset,
    emg: xr.Dataset,
    estimate: np.ndarray,
    start: float,
    p: InverseParameters,
    scale: float,
    noise: float,
    moved: float,
) -> xr.Dataset:
    time = start + found["time"].values
    result = found[["activation", "violation", "saturated"]].assign_coords(
        time=("time", time, {"units": "s"})
    )
    misfit = p.marker_error * found["misfit"].values
    result["misfit"] = ("time", misfit, {"units": "m"})
    result["emg_activation"] = (("muscle", "time"), estimate[1:].T, {"units": "1"})
    muscles = [str(name) for name in emg["muscle"].values]
    result = result.sel(muscle=muscles)
    attrs = {k: v for k, v in recording.attrs.items() if k in IDENTITY}
    return result.assign_attrs(
        attrs,
        strategy="inverse" if p.variant == "motion" else p.variant,
        montage=emg.attrs.get("montage", ""),
        parameters=json.dumps(asdict(p)),
        mouth_ratio=scale,
        marker_noise=noise,
        misfit_ratio=float(np.sqrt(np.mean(misfit**2))) / moved if moved > 0 else np.nan,
        run_time_s=found.attrs["run_time_s"],
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
