"""Recordings of simulated volunteers: each has a face of its own, moved by known activations."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from emgface.dataset import write_recording
from emgface.errors import ConfigurationError
from emgface.face.motion import settle_face, simulate_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.muscles import CHANNELS, INSTRUCTIONS
from emgface.study.digest import dataset_digest
from emgface.study.observer import Observer, Silent
from emgface.study.parallel import in_processes
from emgface.study.policy import lower_sigma_max
from emgface.study.store import Stage, Store
from emgface.volunteers.emg import synthesise_emg
from emgface.volunteers.instructions import TRIAL_DURATION, draw_timing, true_activation
from emgface.volunteers.markers import record_markers
from emgface.volunteers.person import (
    SimulatedVolunteer,
    draw_volunteer,
    person_face,
    person_parameters,
)

_MECHANICS = ("sim", "emgface.face.motion", "emgface.face.recipe")
REST = Stage("volunteer_rest", _MECHANICS)
MOTION = Stage("volunteer_motion", (*_MECHANICS, "emgface.study.policy"))


def make_volunteers(
    face: xr.Dataset,
    out: Path,
    *,
    n: int,
    repetitions: int = 1,
    instructions: Sequence[str] = tuple(INSTRUCTIONS),
    seed: int = 0,
    parameters: SimulationParameters | None = None,
    duration: float = TRIAL_DURATION,
    workers: int = 1,
    observer: Observer | None = None,
) -> list[Path]:
    """Simulate volunteers and write their recordings.

    Motions are kept under ``out/store``, so that an interrupted set is completed by running again.

    Parameters
    ----------
    face : Dataset
        Face model; each volunteer's is a scaled copy.
    out : Path
        Folder; recordings go to ``out/recordings``.
    n, repetitions : int
        Number of volunteers, and of repetitions of each instruction.
    instructions : sequence of str
        Some of A to F.
    seed : int
        Seed of the whole set.
    parameters : SimulationParameters, optional
        Mechanics; sigma_max and tissue stiffness are replaced by the person's.
    duration : float
        Length of a trial [s].
    workers : int
        Processes that simulate at the same time; the recordings do not depend on it.
    observer : Observer, optional
        Told what happens.

    Returns
    -------
    list of Path
        One file per trial, origin "simulated", with ``true_activation`` beside the recording.

    Raises
    ------
    ConfigurationError
        If an instruction is unknown.
    SimulationError
        If a motion cannot be simulated.
    DataError, StoreError
        If a file cannot be written.
    """
    unknown = [instruction for instruction in instructions if instruction not in INSTRUCTIONS]
    if unknown:
        raise ConfigurationError(
            f"instruction {unknown[0]!r} is unknown, expected some of {', '.join(INSTRUCTIONS)}"
        )
    observer = observer or Silent()
    setup = _Setup(face, out, seed, parameters or SimulationParameters(), duration)
    # Volunteers vary fastest, so that processes begin with faces of their own to settle.
    jobs = [
        (index, instruction, repetition)
        for repetition in range(1, repetitions + 1)
        for instruction in instructions
        for index in range(1, n + 1)
    ]
    observer.begin(len(jobs))
    written: dict[_Place, Path] = {}
    if workers == 1:
        recorder = _Recorder(setup, observer)
        for job in jobs:
            observer.working("S{:02d} {} {}".format(*job))
            written[job] = recorder.record(job)
            observer.finished("S{:02d} {} {}".format(*job), "ok")
    else:
        results = in_processes(_work, jobs, workers, begin=_begin, arguments=(setup,))
        for k, (path, messages) in results:
            written[jobs[k]] = path
            for text in messages:
                observer.message(text)
            observer.finished("S{:02d} {} {}".format(*jobs[k]), "ok")
    return [written[job] for job in sorted(jobs)]


_Place = tuple[int, str, int]
"""Index of the volunteer, instruction, repetition."""


@dataclass(frozen=True)
class _Setup:
    """What all recordings of a set share."""

    face: xr.Dataset
    out: Path
    seed: int
    parameters: SimulationParameters
    duration: float


class _Recorder:
    """Makes recordings, each person's face being scaled and settled once."""

    def __init__(self, setup: _Setup, observer: Observer) -> None:
        self._setup, self._observer = setup, observer
        self._store = Store(setup.out / "store", report=observer.message)
        self._people: dict[int, tuple[SimulatedVolunteer, _Mover]] = {}

    def record(self, place: _Place) -> Path:
        """Make one recording and write it."""
        index, instruction, repetition = place
        person, own = self._person(index)
        recording = simulate_recording(person, own, instruction, repetition, self._setup.duration)
        path = self._setup.out / "recordings" / f"{person.name}_{instruction}_{repetition}.nc"
        return write_recording(recording, path)

    def _person(self, index: int) -> tuple[SimulatedVolunteer, "_Mover"]:
        if index not in self._people:
            person = draw_volunteer(index, self._setup.seed)
            face = person_face(self._setup.face, person.geometry_scale)
            parameters = person_parameters(person, self._setup.parameters)
            mover = _Mover(self._store, face, parameters, self._observer)
            self._people[index] = (person, mover)
        return self._people[index]


class _Notes(Silent):
    """Keeps what a worker process has to say until its job is done."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def message(self, text: str) -> None:
        """Keep a sentence."""
        self.texts.append(text)


_recorder: _Recorder | None = None
_notes = _Notes()
"""The recorder of a worker process, and what it has to say."""


def _begin(setup: _Setup) -> None:
    global _recorder
    _recorder = _Recorder(setup, _notes)


def _work(place: _Place) -> tuple[Path, list[str]]:
    assert _recorder is not None, "every worker begins with its recorder"
    _notes.texts.clear()
    path = _recorder.record(place)
    return path, list(_notes.texts)


class _Mover:
    """Moves one person's face, keeping each motion in the store."""

    def __init__(
        self, store: Store, face: xr.Dataset, parameters: SimulationParameters, observer: Observer
    ) -> None:
        self.face, self.parameters = face, parameters
        self._store, self._observer, self._digest = store, observer, dataset_digest(face)

    def rest(self, parameters: SimulationParameters) -> xr.Dataset:
        """Return the face at its equilibrium under gravity."""
        drop = {"step", "solver", "timing", "sigma_max_policy"}
        return self._store.get_or_compute(
            REST,
            {"face": self._digest},
            parameters.model_dump(mode="json", exclude=drop),
            lambda: settle_face(self.face, parameters),
            label="rest",
        ).dataset

    def motion(self, activation: xr.DataArray, label: str) -> xr.Dataset:
        """Return the motion of the lip markers under an activation."""

        def once(parameters: SimulationParameters) -> xr.Dataset:
            rest = self.rest(parameters)
            return simulate_face(self.face, activation, parameters, settled=rest)

        def compute() -> xr.Dataset:
            return lower_sigma_max(once, self.parameters, report=self._observer.message).trajectory

        inputs = {
            "face": self._digest,
            "activation": dataset_digest(activation.to_dataset(name="activation")),
        }
        parameters = self.parameters.model_dump(mode="json")
        return self._store.get_or_compute(MOTION, inputs, parameters, compute, label=label).dataset


def simulate_recording(
    person: SimulatedVolunteer, own: _Mover, instruction: str, repetition: int, duration: float
) -> xr.Dataset:
    """Record one trial of a simulated volunteer.

    Parameters
    ----------
    person : SimulatedVolunteer
        Who.
    own : _Mover
        Moves the person's face.
    instruction : str
        A to F.
    repetition : int
        1 for the first.
    duration : float
        Length of the trial [s].

    Returns
    -------
    Dataset
        Recording with ``emg`` [V], ``position`` [m] and ``true_activation`` [1].
    """
    timing_rng, emg_rng, marker_rng = person.rng(instruction, repetition).spawn(3)
    truth = true_activation(
        instruction,
        timing=draw_timing(timing_rng),
        levels=person.levels,
        co_contraction=person.co_contraction,
        duration=duration,
    )
    label = f"{person.name} {instruction} {repetition}"
    motion = own.motion(truth.rename(time_true="time"), label)
    emg = synthesise_emg(
        truth,
        gain=[person.gain[channel] for channel in CHANNELS],
        cross_talk=person.cross_talk,
        baseline_noise=person.baseline_noise,
        mains_hum=person.mains_hum,
        rng=emg_rng,
    )
    position = record_markers(
        motion["position"],
        own.face["face_marker_position"],
        noise=person.marker_noise,
        rotation=person.head_rotation,
        shift=person.head_shift,
        rng=marker_rng,
    )
    return xr.Dataset(
        {"emg": emg, "position": position, "true_activation": truth},
        attrs={
            "volunteer": person.name,
            "instruction": instruction,
            "repetition": repetition,
            "origin": "simulated",
            "source": f"simulated volunteer {person.name}, seed {person.seed}",
            "true_sigma_max": motion.attrs["sigma_max"],
            "person": json.dumps(person.as_parameters()),
        },
    )
