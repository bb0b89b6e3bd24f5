"""Head driven by a recording: activations of the face, excitations of the jaw, and scores."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

import sim
from analysis.align import align
from analysis.scores import score
from emgface.anatomy.head.model import Head, require_face_and_jaw
from emgface.anatomy.head.run import CLOSERS, HEAD_STEP, simulate_head
from emgface.anatomy.head.scene import HeadScene, head_scene
from emgface.anatomy.jaw.emg import JAW_CHANNELS, excitation_of
from emgface.anatomy.jaw.recorded import INCISOR, score_motion
from emgface.anatomy.jaw.series import Excitation, excitation_in
from emgface.anatomy.step_error import order_of_steps, repeated_motion
from emgface.errors import HeadError
from emgface.face.identity import belongs
from emgface.face.measured import measured_during
from emgface.face.numerical_error import largest_motion
from emgface.face.parts import Integers
from emgface.face.simulation_parameters import SimulationParameters
from emgface.muscles import LIP_MARKERS
from emgface.recordings.belonging import of_face, of_recording
from emgface.recordings.findings import with_findings
from emgface.recordings.repeated import warn_of
from emgface.signals.activation import activation_of, feature_range
from emgface.signals.parameters import SignalChain
from emgface.study.configuration import StudyConfiguration

SETTLING_TIME = 0.3
"""Time before the recording in which the head comes to rest under gravity at the first levels [s]."""


@dataclass(frozen=True, eq=False)
class RecordedDrive:
    """Recordings that determine the levels of a head."""

    study: StudyConfiguration = field(
        default_factory=StudyConfiguration
    )  #: signal chain and scores
    strategy: str | None = None  #: of the face, such as "act_all"; by default of the study
    instruction: str | None = None  #: A to F, if the recording does not state it
    effort: Sequence[xr.Dataset] = ()
    """Recordings of maximum effort, which normalise the channels of the jaw, and those of the face
    if the normalisation of the study has the reach "reference". Without them a channel that is
    silent in the recording is amplified to full range."""


def excitation_of_head(
    recording: xr.Dataset, head: Head, drive: RecordedDrive | None = None
) -> Excitation:
    """Levels of the muscles of face and jaw from one recording, from time 0 of the activation.

    Activations are those of `emgface.signals.activation.activation_of`, excitations of the jaw
    those of `emgface.anatomy.jaw.emg.excitation_of`; closers without a channel have the tone of a
    jaw at rest. Raises HeadError if the head lacks face or jaw, or the recording a channel of the
    jaw.
    """
    given = drive or RecordedDrive()
    require_face_and_jaw(head)
    if not has_jaw(map(str, recording["channel"].values) if "emg" in recording else ()):
        raise HeadError(
            f"the recording has no channel of the jaw ({', '.join(JAW_CHANNELS)}): simulate it on "
            "the face, which costs less (emgface simulate)"
        )
    chain = given.study.signals
    by_effort = chain.normalisation.reach == "reference"
    activation = activation_of(
        recording,
        chain,
        strategy=given.strategy or given.study.strategy_names[0],
        instruction=given.instruction,
        reference=feature_range(given.effort, chain) if by_effort else None,
    )["activation"]
    return _with_jaw(activation, recording, head, given)


def has_jaw(channels: Iterable[str]) -> bool:
    """True if a muscle of the jaw is among the recorded channels."""
    return any(name[:-2] in JAW_CHANNELS for name in channels)


def activation_of_head(
    activation: xr.Dataset, recording: xr.Dataset, head: Head, chain: SignalChain
) -> xr.Dataset:
    """Activation (muscle, time) of a face with that of all other muscles of a head.

    Those of the jaw follow their channels, normalised by the range of the recording itself.
    """
    study = StudyConfiguration(signals=chain)
    levels = _with_jaw(activation["activation"], recording, head, RecordedDrive(study))
    given, _ = levels.activation(head.lists)
    of_face = {str(m) for m in activation["muscle"].values}
    others = [str(m) for m in given["muscle"].values if str(m) not in of_face]
    time = activation["time"].values - activation["time"].values[0]
    rows = np.array([np.interp(time, levels.time, given.sel(muscle=m).values) for m in others])
    face = activation["activation"].transpose("muscle", "time")
    return xr.Dataset(
        {"activation": (("muscle", "time"), np.concatenate([face.values, rows]), face.attrs)},
        coords={
            "muscle": [*face["muscle"].values, *others],
            "time": ("time", face["time"].values, face["time"].attrs),
        },
        attrs=activation.attrs,
    )


def _with_jaw(
    activation: xr.DataArray, recording: xr.Dataset, head: Head, given: RecordedDrive
) -> Excitation:
    """Levels of the muscles of the face and of the exciters of the jaw, from time 0."""
    jaw = excitation_in(excitation_of(recording, given.study.signals, reference=given.effort))
    start = float(activation["time"].values[0])
    assert jaw.recorded_start is not None
    own = activation["time"].values - start
    jaw_time = jaw.time + jaw.recorded_start - start
    time = np.union1d(own, jaw_time[(jaw_time >= 0.0) & (jaw_time <= own[-1])])
    values = {
        str(m): np.interp(time, own, activation.sel(muscle=m).values)
        for m in activation["muscle"].values
    }
    known, _ = jaw.known_to(head.lists)
    values |= {name: np.interp(time, jaw_time, u) for name, u in known.values.items()}
    exciter, level = CLOSERS
    values[exciter] = np.full(len(time), level)
    return Excitation(time, values, start)


def move_as_recorded(
    recording: xr.Dataset,
    head: Head,
    drive: RecordedDrive | None = None,
    *,
    step: float = HEAD_STEP,
    tolerance: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> xr.Dataset:
    """Simulate a head for a recording, from rest under gravity at its first levels.

    Tissue, muscles and contact of the face are those of the study; step and solver are not, because
    a moving jaw requires linearly implicit steps. `tolerance` is the desired error [m].
    """
    given = drive or RecordedDrive()
    levels = excitation_of_head(recording, head, given)
    simulation = given.study.simulation
    scene = head_scene(head, face=simulation, gravity=simulation.gravity)
    return _moved(
        head, scene, levels, simulation.output, step, tolerance=tolerance, progress=progress
    )


def _moved(
    head: Head,
    scene: HeadScene,
    levels: Excitation,
    output: float,
    step: float,
    **options: Any,
) -> xr.Dataset:
    """Motion for levels, after the head has come to rest at the first of them.

    `options` are check, tolerance and progress of `simulate_head`.
    """
    first = output * np.ceil(SETTLING_TIME / output)
    duration = float(first + output * np.floor(levels.time[-1] / output + 1e-9))
    later = Excitation(levels.time + first, levels.values, levels.recorded_start)
    motion = simulate_head(
        head, later, duration=duration, scene=scene, step=step, output=output, **options
    )
    motion = motion.isel(time=motion["time"].values > first - 1e-9)
    shifted = ("time", motion["time"].values - motion["time"].values[0], motion["time"].attrs)
    motion = motion.assign_coords(time=shifted)
    motion.attrs |= {"recorded_start": levels.recorded_start, "recorded_pace": 1.0}
    return motion


def trajectory_of_head(
    head: Head, activation: xr.DataArray, parameters: SimulationParameters, nodes: Integers
) -> xr.Dataset:
    """Motion of the lips of a head, in the form of `emgface.face.motion.simulate_face`.

    Linearly implicit steps of 5 ms, halved where they fail, from rest at the first levels. The
    motion is repeated with other steps, and ``numerical_error`` is the error of the lips until every
    instant (`emgface.anatomy.step_error`). ``incisor`` (axis, time) is the lower one, and the
    attribute ``incisor_error`` its error. Step, solver and tolerances of the parameters do
    not apply. Raises HeadError for a reduced face, or times other than the recorded ones.
    """
    p = parameters
    if p.reduced.file is not None or p.timing != "recorded":
        raise HeadError(
            "a head has no reduced form and moves in recorded time: remove reduced.file and set "
            "timing = 'recorded', or leave out face.head"
        )
    start = float(activation["time"].values[0])
    time = activation["time"].values - start
    values = {str(m): activation.sel(muscle=m).values for m in activation["muscle"].values}
    levels = Excitation(time, values, start)
    scene = head_scene(head, face=p, gravity=p.gravity)
    pair = repeated_motion(
        lambda h, _: _moved(head, scene, levels, p.output, h, check=False),
        HEAD_STEP,
        p.output,
        order_of_steps(sim.LinearlyImplicitEuler()),
    )
    motion, face = pair.motion, head.parts["face"]
    lips = face["marker"].values.tolist()
    x, error = motion["position"].sel(marker=lips), pair.error(lips)
    variables = {
        "position": x.transpose("marker", "axis", "time"),
        "incisor": motion["position"].sel(marker=INCISOR, drop=True).transpose("axis", "time"),
        "numerical_error": ("time", error, {"units": "m"}),
        "surface_position": motion["node_position"]
        .isel(node=nodes)
        .rename(node="surface_node")
        .transpose("time", "surface_node", "axis"),
    }
    kept = ("smallest_J", "iterations", "lip_opening", "mouth_area", "lip_protrusion")
    variables |= {name: motion[name] for name in kept if name in motion}
    trajectory = xr.Dataset(variables).drop_vars(
        ["muscle", "tissue", "named", "body"], errors="ignore"
    )
    trajectory.attrs = {
        "solver": "linearly_implicit",
        "contact": p.contact.method,
        "step": float(motion.attrs["step_s"]),
        "output": p.output,
        "sigma_max": p.sigma_max,
        "origin": "simulated",
        "head": str(head.lists.attrs["name"]),
        "recorded_start": start,
        "recorded_pace": 1.0,
        "run_time_s": float(pair.motion.attrs["run_time_s"] + pair.other.attrs["run_time_s"]),
    }
    trajectory.attrs["motion"] = moved = largest_motion(trajectory)
    trajectory.attrs["numerical_error"] = float(error[-1])
    trajectory.attrs["incisor_error"] = float(pair.error([INCISOR])[-1])
    trajectory.attrs["inaccurate"] = int(error[-1] > 0.1 * moved)
    return belongs(trajectory, face)


def score_head(
    recording: xr.Dataset, motion: xr.Dataset, head: Head, drive: RecordedDrive | None = None
) -> xr.Dataset:
    """Align the measured lip markers, and the lower incisor if it was recorded, and score each."""
    plan = (drive or RecordedDrive()).study
    other = of_face(motion.attrs, head.parts["face"], "motion")
    other += of_recording(motion.attrs, recording.attrs)
    warn_of(other)
    lips = motion.sel(marker=list(LIP_MARKERS))
    measured = measured_during(recording, lips, head.parts["face"], plan.signals.head_frame)
    aligned = align(
        measured,
        lips,
        smallest_motion=plan.score.smallest_motion,
        smallest_snr=plan.score.smallest_snr,
        **plan.alignment.arguments(),
    )
    scores = with_findings(score(aligned, lips, **plan.score.model_dump()), other)
    if INCISOR not in recording["marker"].values:
        return scores
    incisor = score_motion(recording.sel(marker=[INCISOR]), motion)
    both = [
        name for name in ("rho", "amplitude_ratio", "rmse") if name in scores and name in incisor
    ]
    return xr.concat([scores[both], incisor[both]], "marker", combine_attrs="drop_conflicts")
