"""Session of a simulated volunteer: repetitions of an instruction, with rests."""

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from emgface.errors import ConfigurationError
from emgface.muscles import CHANNELS, INSTRUCTIONS, MUSCLES
from emgface.volunteers.conduction import Conduction
from emgface.volunteers.disturbances import draw_failures, fail, movement_artefacts
from emgface.volunteers.emg import Pools, synthesise_emg
from emgface.volunteers.filming import film, occlude
from emgface.volunteers.instructions import draw_timing, true_activation
from emgface.volunteers.markers import record_markers
from emgface.volunteers.mismatch import draw_mismatch
from emgface.volunteers.muscle_dynamics import activation_of_excitation
from emgface.volunteers.noise import noise_for
from emgface.volunteers.person import SimulatedVolunteer
from emgface.volunteers.repetition import draw_deviation
from emgface.volunteers.settings import VolunteerParameters

TAIL = 0.5  #: simulated time after a trial [s], after which the face is at rest to a micrometre
_RUNS = 3  #: number of realisations of the EMG of each movement for an estimate of its power
_GRID = 0.25
"""Grid of the start times of trials [s], at which samples (2048 Hz) and frames (100 Hz) coincide."""


def trial_excitation(
    person: SimulatedVolunteer, instruction: str, repetition: int, settings: VolunteerParameters
) -> xr.DataArray:
    """Excitation of one repetition, which generates the EMG, and the rest after it.

    The result (muscle, time_true) [1] extends from 0 to the duration of a trial and `TAIL`;
    `repetition` is 1 for the first.
    """
    rng = person.rng(instruction, repetition)
    mismatch = draw_mismatch(person.seed, person.index, settings.world)
    timing = draw_timing(rng, speed=person.speed, variability=person.variability)
    levels, recruitment = person.efforts, mismatch.recruitment.get(instruction)
    deviation = draw_deviation(
        person.seed, person.index, instruction, repetition, settings.world, person.variability
    )
    if deviation is not None:
        timing, recruitment = deviation.timed(timing), deviation.recruited(recruitment)
        levels = {muscle: level * deviation.levels[muscle] for muscle, level in levels.items()}
    return true_activation(
        instruction,
        timing=timing,
        levels=levels,
        co_contraction=person.co_contraction,
        recruitment=recruitment,
        duration=settings.duration,
        tail=min(TAIL, settings.rest),
    )


def trial_activation(
    person: SimulatedVolunteer, instruction: str, repetition: int, settings: VolunteerParameters
) -> xr.DataArray:
    """Activation of one repetition, equal to `trial_excitation` in the matched world."""
    return activation_of_excitation(
        trial_excitation(person, instruction, repetition, settings),
        delay=draw_mismatch(person.seed, person.index, settings.world).delay,
        activation_time=settings.world.activation_time,
        deactivation_time=settings.world.deactivation_time,
    )


def amplifier_noise(
    person: SimulatedVolunteer,
    settings: VolunteerParameters,
    *,
    pools: Pools | None,
    conduction: Conduction | None,
) -> np.ndarray:
    """White noise (14,) [V] of every channel: that of the person, or for the ratio of the world.

    It is the same in all sessions of a person; `pools` and `conduction` are as for
    `emgface.volunteers.emg.synthesise_emg`.
    """
    snr = draw_mismatch(person.seed, person.index, settings.world).snr
    if snr is None:
        return np.full(len(CHANNELS), settings.noise_factor * person.baseline_noise)
    clean = [
        _emg(
            person,
            settings,
            trial_excitation(person, instruction, 1, settings),
            rng=np.random.default_rng([person.seed, person.index, 40, run, k]),
            baseline_noise=0.0,
            mains_hum=0.0,
            pools=pools,
            conduction=conduction,
        ).values
        for run in range(_RUNS)
        for k, instruction in enumerate(INSTRUCTIONS)
    ]
    return settings.noise_factor * noise_for(
        clean,
        np.array([snr[channel] for channel in CHANNELS]),
        mains_hum=person.mains_hum,
        sampling_rate=settings.sampling_rate,
        runs=_RUNS,
    )


def _emg(
    person: SimulatedVolunteer,
    settings: VolunteerParameters,
    excitation: xr.DataArray,
    **options: Any,
) -> xr.DataArray:
    """EMG of a person; `options` are further arguments of `synthesise_emg`."""
    return synthesise_emg(
        excitation,
        gain=[settings.world.amplitude * person.gain[channel] for channel in CHANNELS],
        cross_talk=person.cross_talk if settings.cross_talk is None else settings.cross_talk,
        sampling_rate=settings.sampling_rate,
        mains_frequency=settings.mains_frequency,
        **options,
    )


def session_events(
    instruction: str, repetitions: int, settings: VolunteerParameters
) -> pd.DataFrame:
    """Times of the repetitions of a session: columns ``onset``, ``duration`` [s] and ``label``.

    `emgface.recordings.events.cut_trials` accepts this table.
    """
    first = math.ceil(settings.rest / _GRID) * _GRID
    period = math.ceil((settings.duration + settings.rest) / _GRID - 1e-9) * _GRID
    return pd.DataFrame(
        {
            "onset": [first + k * period for k in range(repetitions)],
            "duration": settings.duration,
            "label": instruction,
        }
    )


def simulate_session(
    person: SimulatedVolunteer,
    instruction: str,
    activations: Sequence[xr.DataArray],
    motions: Sequence[xr.Dataset],
    face_marker_position: xr.DataArray,
    settings: VolunteerParameters,
    *,
    pools: Pools | None = None,
    conduction: Conduction | None = None,
    noise: np.ndarray | None = None,
) -> xr.Dataset:
    """Simulate a session of alternating rests and repetitions of one instruction (A to F).

    `activations` are the `trial_activation` of each repetition (the EMG is generated by its
    `trial_excitation`), `motions` its simulated ``position(marker, axis, time)`` [m] from time 0,
    and `face_marker_position` has the dims (face_marker, axis) [m]. `pools` are motor units
    (default: noise); `conduction`, the paths of the muscles to the electrodes, is required if the
    world records through the tissue; `noise` (14,) is the `amplifier_noise` of the person [V]
    (default: computed).

    The recording contains ``emg`` [V], ``position`` [m], ``true_excitation`` and
    ``true_activation`` [1], with world, person, mismatch, sigma_max and failed electrodes as
    attributes.
    """
    if settings.world.pick_up == "volume" and conduction is None:
        raise ConfigurationError(
            "the pick-up of this world is through the tissue, but the distances of the "
            "muscles to the electrodes are missing: specify conduction, or a world with "
            "pick_up = 'mapping'"
        )
    events = session_events(instruction, len(motions), settings)
    onsets = [float(onset) for onset in events["onset"]]
    end = onsets[-1] + math.ceil((settings.duration + settings.rest) / _GRID - 1e-9) * _GRID
    truth = _joined_activation(activations, onsets, end)
    excited = [
        trial_excitation(person, instruction, repetition, settings)
        for repetition in range(1, len(motions) + 1)
    ]
    excitation = _joined_activation(excited, onsets, end)
    if noise is None:
        noise = amplifier_noise(person, settings, pools=pools, conduction=conduction)
    emg_rng, wrong_rng, head_rng, camera_rng = person.rng(instruction, 0).spawn(4)
    clean = _emg(
        person,
        settings,
        excitation,
        rng=emg_rng,
        baseline_noise=noise,
        mains_hum=person.mains_hum,
        pools=pools,
        conduction=conduction,
    )
    emg, failures = _disturbed(clean, onsets, end, settings, wrong_rng)
    lips = _joined_motion(motions, onsets, end)
    position = _tracks(person, settings, lips, face_marker_position, head_rng, camera_rng)
    return xr.Dataset(
        {
            "emg": emg,
            "position": position,
            "true_excitation": excitation,
            "true_activation": truth,
        },
        attrs={
            "volunteer": person.name,
            "instruction": instruction,
            "origin": "simulated",
            "world": settings.world.label,
            "source": f"simulated volunteer {person.name}, seed {person.seed}, {settings.world.label}",
            "mismatch": json.dumps(
                draw_mismatch(person.seed, person.index, settings.world).as_parameters()
            ),
            "true_sigma_max": [float(motion.attrs["sigma_max"]) for motion in motions],
            "electrode_failures": json.dumps(failures),
            "person": json.dumps(person.as_parameters()),
            "settings": settings.model_dump_json(),
        },
    )


def _tracks(
    person: SimulatedVolunteer,
    settings: VolunteerParameters,
    lips: xr.DataArray,
    face_markers: xr.DataArray,
    head_rng: np.random.Generator,
    camera_rng: np.random.Generator,
) -> xr.DataArray:
    """Marker tracks with head motion, noise of the cameras and losses."""
    filmed = settings.cameras == "three"
    position = record_markers(
        lips,
        face_markers,
        noise=0.0 if filmed else person.marker_noise,
        rotation=person.head_rotation,
        shift=person.head_shift,
        rng=head_rng,
        frame_rate=settings.frame_rate,
    )
    if filmed:
        position = film(position, pixel_noise=settings.pixel_noise, rng=camera_rng)
    return occlude(position, rate=settings.occlusions, rng=camera_rng)


def _disturbed(
    emg: xr.DataArray,
    onsets: Sequence[float],
    end: float,
    settings: VolunteerParameters,
    rng: np.random.Generator,
) -> tuple[xr.DataArray, dict[str, dict[str, object]]]:
    """EMG with movement artefacts and failing electrodes; start and kind of each failure."""
    time = emg["time_emg"].values
    values = emg.values + movement_artefacts(
        time,
        onsets,
        len(CHANNELS),
        probability=settings.artefact_probability,
        amplitude=settings.artefact_amplitude,
        rng=rng,
    )
    failures = draw_failures(len(CHANNELS), end, probability=settings.electrode_failure, rng=rng)
    values = fail(values, time, failures, mains_frequency=settings.mains_frequency, rng=rng)
    faults = {CHANNELS[f.channel]: {"start": f.start, "kind": f.kind} for f in failures}
    return emg.copy(data=values), faults


def _joined_activation(
    activations: Sequence[xr.DataArray], onsets: Sequence[float], end: float
) -> xr.DataArray:
    rate = 1.0 / float(activations[0]["time_true"][1] - activations[0]["time_true"][0])
    values = np.zeros((len(MUSCLES), round(end * rate) + 1))
    for activation, onset in zip(activations, onsets, strict=True):
        start = round(onset * rate)
        rows = activation.sel(muscle=list(MUSCLES)).values
        values[:, start : start + rows.shape[1]] = rows
    time = ("time_true", np.arange(values.shape[1]) / rate, {"units": "s"})
    return xr.DataArray(
        values,
        coords={"muscle": list(MUSCLES), "time_true": time},
        dims=("muscle", "time_true"),
        attrs=activations[0].attrs,
    )


def _joined_motion(
    motions: Sequence[xr.Dataset], onsets: Sequence[float], end: float
) -> xr.DataArray:
    """Concatenate motions; the lips remain at the end of one until the next begins.

    A motion that lasts until the next or the end gives up its last instant, so that times are unique.
    """
    parts: list[xr.DataArray] = []
    for motion, onset, until in zip(motions, onsets, [*onsets[1:], end], strict=True):
        time = onset + motion["time"].values
        part = motion["position"].assign_coords(time=time)
        parts.append(part.isel(time=np.flatnonzero(time < until - 1e-6)))
    before = parts[0].isel(time=[0]).assign_coords(time=[0.0])
    after = motions[-1]["position"].isel(time=[-1]).assign_coords(time=[end])
    return xr.concat([before, *parts, after], dim="time")
