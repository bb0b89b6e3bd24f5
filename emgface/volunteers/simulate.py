"""Recordings of simulated volunteers with individual faces and known activations."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from emgface.errors import ConfigurationError
from emgface.face.motion import load_kernels
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import volunteer_face
from emgface.face.template.grid import LAYER_COUNT, make_grid
from emgface.muscles import INSTRUCTIONS, LETTERS
from emgface.recordings.dataset import write_recording
from emgface.recordings.events import cut_trials
from emgface.run.observer import Observer, Silent
from emgface.run.runner import Workers
from emgface.run.store import Store
from emgface.run.tasks import Task, run_table
from emgface.volunteers.conduction import Conduction, face_conduction
from emgface.volunteers.emg import Pools, draw_pools
from emgface.volunteers.mismatch import Mismatch, draw_mismatch, world_parameters
from emgface.volunteers.motions import Mover
from emgface.volunteers.person import (
    SimulatedVolunteer,
    draw_volunteer,
    person_face,
    person_parameters,
)
from emgface.volunteers.session import (
    amplifier_noise,
    session_events,
    simulate_session,
    trial_activation,
)
from emgface.volunteers.settings import VolunteerParameters
from emgface.volunteers.write import write_session
from sim.threads import one_blas_thread


@one_blas_thread
def make_volunteers(
    face: xr.Dataset | None,
    out: Path,
    *,
    n: int,
    repetitions: int = 1,
    instructions: Sequence[str] = tuple(INSTRUCTIONS),
    seed: int = 0,
    parameters: SimulationParameters | None = None,
    settings: VolunteerParameters | None = None,
    workers: int | Workers = 1,
    observer: Observer | None = None,
    store: Path | None = None,
    stopping: Callable[[], bool] = lambda: False,
) -> list[Path]:
    """Simulate `n` volunteers with `repetitions` of each instruction, and write their recordings.

    A session of a volunteer is one instruction, repeated, with rests before, between and after; it
    is cut into trials, which are written to ``out/recordings``: one file per trial, origin
    "simulated", labelled with its world, with ``true_activation`` and ``true_excitation``. Motions
    are stored, so that the same call completes an interrupted set; sets in worlds that differ only
    in their EMG may share the folder `store` (default ``out/store``).

    Each volunteer's face is a scaled copy of `face`, with the same mesh and muscles in every world,
    or a template face if it is None. sigma_max and tissue stiffness of `parameters` are replaced by
    the person's; `settings` are those of faces, sessions, electrodes and cameras. The recordings do
    not depend on `workers`, a number of processes or the workers of a scheduler; `observer`
    receives messages and progress, and ``out/runs`` the journal that `emgface study status` reads. If
    `stopping` returns True, the sessions that have begun are completed before KeyboardInterrupt is
    raised.

    Raises ConfigurationError if an instruction is unknown, SimulationError if a motion cannot be
    simulated, and DataError or StoreError if a file cannot be written.
    """
    unknown = [instruction for instruction in instructions if instruction not in INSTRUCTIONS]
    if unknown:
        raise ConfigurationError(
            f"instruction {unknown[0]!r} is unknown, expected some of {LETTERS}"
        )
    observer = observer or Silent()
    settings = settings or VolunteerParameters()
    if face is not None:
        of_file = settings.world.without("mesh", "courses")
        settings = settings.model_copy(update={"world": of_file})
    setup = _Setup(
        face, out.resolve(), (store or out / "store").resolve(), seed, repetitions,
        parameters or SimulationParameters(), settings,
    )  # fmt: skip
    # Volunteers vary fastest, so that every process begins with the rest state of another face.
    jobs = [(index, instruction) for instruction in instructions for index in range(1, n + 1)]
    written = run_table(
        Task(_Recorder, setup, _Recorder.record, lambda place: place[0]),
        jobs,
        [(f"S{index:02d}", instruction) for index, instruction in jobs],
        name=f"simulated volunteers, {settings.world.label}",
        out=setup.out,
        store=setup.store,
        workers=workers,
        observer=observer,
        stopping=stopping,
    )
    return [path for _, paths in sorted(zip(jobs, written, strict=True)) for path in paths]


def other_resolution(resolution: str | int, factor: float) -> str | int:
    """Resolution with the number of elements multiplied by a factor."""
    if factor == 1.0:
        return resolution
    grid = make_grid(resolution)
    return round(factor * LAYER_COUNT * grid.rays * grid.n_rings)


_Place = tuple[int, str]  #: index of the volunteer, and instruction


@dataclass(frozen=True)
class _Setup:
    """Data common to all recordings of a set."""

    face: xr.Dataset | None
    out: Path
    store: Path
    seed: int
    repetitions: int
    parameters: SimulationParameters
    settings: VolunteerParameters


@dataclass(frozen=True)
class _Subject:
    """Person with an individual face and motor units."""

    person: SimulatedVolunteer
    mover: Mover
    mismatch: Mismatch
    pools: Pools | None
    conduction: Conduction | None
    noise: np.ndarray


class _Recorder:
    """Simulator of recordings, which builds and settles the face of each person once."""

    def __init__(self, setup: _Setup, report: Callable[[str], None]) -> None:
        self._setup, self._report = setup, report
        self.store = Store(setup.store, report=report)
        self._subjects: dict[int, _Subject] = {}

    def record(self, place: _Place) -> list[Path]:
        """Record one session, cut it into trials and write these."""
        index, instruction = place
        subject, settings = self._subject(index), self._setup.settings
        person = subject.person
        activations = [
            trial_activation(person, instruction, repetition, settings)
            for repetition in range(1, self._setup.repetitions + 1)
        ]
        motions = [
            subject.mover.motion(
                subject.mismatch.driven(activation).rename(time_true="time"),
                f"{person.name} {instruction} {repetition}",
            )
            for repetition, activation in enumerate(activations, 1)
        ]
        session = simulate_session(
            person,
            instruction,
            activations,
            motions,
            subject.mover.face["face_marker_position"],
            settings,
            pools=subject.pools,
            conduction=subject.conduction,
            noise=subject.noise,
        )
        events = session_events(instruction, self._setup.repetitions, settings)
        if settings.keep_sessions:
            write_session(session, events, self._setup.out / "sessions")
        paths: list[Path] = []
        for number, trial in enumerate(cut_trials(session, events), 1):
            trial.attrs["true_sigma_max"] = session.attrs["true_sigma_max"][number - 1]
            path = self._setup.out / "recordings" / f"{person.name}_{instruction}_{number}.nc"
            paths.append(write_recording(trial, path))
        return paths

    def _subject(self, index: int) -> _Subject:
        if index not in self._subjects:
            setup, settings = self._setup, self._setup.settings
            world, person = settings.world, draw_volunteer(index, setup.seed)
            mismatch = draw_mismatch(setup.seed, index, world)
            if setup.face is None:
                face, _ = volunteer_face(
                    setup.seed,
                    index,
                    resolution=other_resolution(settings.resolution, world.elements),
                    preset=settings.preset,
                    spread=settings.spread,
                    asymmetry=settings.face_asymmetry,
                    course_shift=world.course_shift,
                )
            else:
                face = person_face(setup.face, person.geometry_scale)
            parameters = person_parameters(person, setup.parameters)
            parameters = world_parameters(parameters, world, mismatch)
            with ThreadPoolExecutor(
                1
            ) as background:  # compiling leaves the interpreter half the time
                background.submit(load_kernels, face, parameters)
                pools = None
                if settings.emg == "motor_units":
                    # The units of a person are the same in all sessions.
                    pools = draw_pools(
                        np.random.default_rng([setup.seed, index, len(INSTRUCTIONS) + 1]),
                        settings.sampling_rate,
                    )
                conduction = face_conduction(face) if world.pick_up == "volume" else None
                noise = amplifier_noise(person, settings, pools=pools, conduction=conduction)
            mover = Mover(self.store, face, parameters, self._report)
            self._subjects[index] = _Subject(person, mover, mismatch, pools, conduction, noise)
        return self._subjects[index]
