"""Head driven by a recording: activations of the face, excitations of the jaw, and scores."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from analysis.align import align
from analysis.scores import score
from emgface.anatomy.head.model import Head
from emgface.anatomy.head.run import CLOSERS, STEP, simulate_head
from emgface.anatomy.jaw.emg import CHANNELS, excitation_of
from emgface.anatomy.jaw.recorded import INCISOR, score_motion
from emgface.anatomy.jaw.series import Excitation, excitation_in
from emgface.errors import HeadError
from emgface.muscles import LIP_MARKERS
from emgface.signals.activation import activation_of, feature_range
from emgface.study.configuration import StudyConfiguration
from emgface.study.measured import measured_during

SETTLING = 0.3
"""Time before the recording in which the head comes to rest under gravity at the first levels [s]."""


@dataclass(frozen=True, eq=False)
class Drive:
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


def excitation_of_head(recording: xr.Dataset, head: Head, drive: Drive | None = None) -> Excitation:
    """Levels of the muscles of face and jaw from one recording, from time 0 of the activation.

    Activations are those of `emgface.signals.activation.activation_of`, excitations of the jaw those of
    `emgface.anatomy.jaw.emg.excitation_of`; closers without a channel have the tone of a jaw at rest.

    Raises
    ------
    HeadError
        The head lacks face or jaw, or the recording has no channel of the jaw.
    DataError
        As of the two functions.
    """
    given = drive or Drive()
    for part in ("face", "jaw"):
        if part not in head.named:
            raise HeadError(
                f"the head has no {part}, expected face and jaw: emgface head build --parts face,jaw"
            )
    channels = (
        {str(name)[:-2] for name in recording["channel"].values} if "emg" in recording else set()
    )
    if not channels & set(CHANNELS):
        raise HeadError(
            f"the recording has no channel of the jaw ({', '.join(CHANNELS)}): simulate it on the face, "
            "which costs less (emgface simulate)"
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
    jaw = excitation_in(excitation_of(recording, chain, reference=given.effort))
    start = float(activation["time"].values[0])
    assert jaw.recorded_start is not None
    own = activation["time"].values - start
    beside = jaw.time + jaw.recorded_start - start
    time = np.union1d(own, beside[(beside >= 0.0) & (beside <= own[-1])])
    values = {
        str(m): np.interp(time, own, activation.sel(muscle=m).values)
        for m in activation["muscle"].values
    }
    known, _ = jaw.known_to(head.lists)
    values |= {name: np.interp(time, beside, u) for name, u in known.values.items()}
    exciter, level = CLOSERS
    values[exciter] = np.full(len(time), level)
    return Excitation(time, values, start)


def move_as_recorded(
    recording: xr.Dataset,
    head: Head,
    drive: Drive | None = None,
    *,
    step: float = STEP,
    progress: Callable[[int, int], None] | None = None,
) -> xr.Dataset:
    """Simulate a head for a recording, from rest under gravity at its first levels.

    Tissue, muscles and contact of the face are those of the study; step and solver are not, because a
    moving jaw requires linearly implicit steps.

    Raises
    ------
    HeadError, DataError, SimulationError
        As of `excitation_of_head` and `emgface.anatomy.head.run.simulate_head`.
    """
    given = drive or Drive()
    levels = excitation_of_head(recording, head, given)
    output = given.study.simulation.output
    first = output * np.ceil(SETTLING / output)
    duration = float(first + output * np.floor(levels.time[-1] / output + 1e-9))
    later = Excitation(levels.time + first, levels.values, levels.recorded_start)
    motion = simulate_head(
        head,
        later,
        duration=duration,
        face=given.study.simulation,
        step=step,
        output=output,
        progress=progress,
    )
    motion = motion.isel(time=motion["time"].values > first - 1e-9)
    shifted = ("time", motion["time"].values - motion["time"].values[0], motion["time"].attrs)
    motion = motion.assign_coords(time=shifted)
    motion.attrs |= {"recorded_start": levels.recorded_start, "recorded_pace": 1.0}
    return motion


def score_head(
    recording: xr.Dataset, motion: xr.Dataset, head: Head, drive: Drive | None = None
) -> xr.Dataset:
    """Align the measured lip markers, and the lower incisor if it was recorded, and score each.

    Raises
    ------
    MarkerError, AnalysisError
        As of a trial on a face, and of `emgface.anatomy.jaw.recorded.score_motion`.
    """
    plan = (drive or Drive()).study
    lips = motion.sel(marker=list(LIP_MARKERS))
    measured = measured_during(recording, lips, head.parts["face"], plan.signals.head_frame)
    aligned = align(
        measured,
        lips,
        smallest_motion=plan.score.smallest_motion,
        smallest_snr=plan.score.smallest_snr,
        **plan.alignment.arguments(),
    )
    found = score(aligned, lips, **plan.score.model_dump())
    if INCISOR not in recording["marker"].values:
        return found
    incisor = score_motion(recording.sel(marker=[INCISOR]), motion)
    both = [
        name for name in ("rho", "amplitude_ratio", "rmse") if name in found and name in incisor
    ]
    return xr.concat([found[both], incisor[both]], "marker", combine_attrs="drop_conflicts")
