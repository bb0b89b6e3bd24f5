"""A study from configuration to cube: every trial through every stage, none lost, all resumable."""

import json
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import xarray as xr

from analysis.cube import build_cube
from analysis.errors import AnalysisError
from analysis.trial import Origin, Trial
from emgface.errors import EmgfaceError
from emgface.face.block import block_face
from emgface.face.model import load_face
from emgface.muscles import LIP_MARKERS
from emgface.netcdf import write_netcdf
from emgface.study.configuration import FaceConfiguration, StudyConfiguration
from emgface.study.observer import Observer, Silent
from emgface.study.stages import Laboratory, StoredFailure, steps_of
from emgface.study.store import Event, Result, Store, dataset_digest, write_text
from emgface.study.table import (
    Intake,
    PlannedTrial,
    load_recording,
    plan_trials,
    take_in,
    take_in_references,
)
from sim.errors import SimulationError

EXPECTED = (EmgfaceError, AnalysisError, SimulationError)
"""Failures of one trial that do not stop the others."""


@dataclass(frozen=True)
class StudyResult:
    """What a study gave.

    Attributes
    ----------
    cube : Dataset
        Scores and status of every trial.
    path : Path
        File of the cube.
    events : list of Event
        What was computed and what was reused, in order.
    unreadable : dict of Path to EmgfaceError
        Files of the recordings' folder that could not be placed.
    """

    cube: xr.Dataset
    path: Path
    events: list[Event]
    unreadable: dict[Path, EmgfaceError] = field(default_factory=dict)

    def computed(self) -> list[Event]:
        """Return the events of results that were not in the store, or damaged there."""
        return [event for event in self.events if event.outcome != "reused"]


def study_face(configuration: FaceConfiguration) -> xr.Dataset:
    """Load the face of a study, or generate the block.

    Parameters
    ----------
    configuration : FaceConfiguration
        File or block.

    Returns
    -------
    Dataset
        Checked face model.

    Raises
    ------
    FaceError, SchemaError, UnitsError
        If the file is absent, damaged or no usable face.
    """
    if configuration.path is not None:
        return load_face(configuration.path)
    b = configuration.block
    return block_face(size=(b.width, b.depth, b.height), cells=(b.cells_width, b.cells_height))


def run_study(
    study: StudyConfiguration,
    out: Path,
    *,
    workers: int = 1,
    observer: Observer | None = None,
) -> StudyResult:
    """Run a study, computing only what is not stored yet.

    Parameters
    ----------
    study : StudyConfiguration
        All choices.
    out : Path
        Folder of the results: ``cube.nc``, ``times.jsonl``, and the stages under ``store``.
    workers : int
        Processes that simulate at the same time; the results do not depend on it.
    observer : Observer, optional
        Told what happens.

    Returns
    -------
    StudyResult

    Raises
    ------
    DataError
        If no recording can be used, or the face is unusable.
    StoreError
        If results cannot be written.

    Notes
    -----
    A failure of one trial is recorded with its status and reason in the cube. An interruption
    (KeyboardInterrupt) passes through; what was finished is stored.
    """
    observer = observer or Silent()
    intake = take_in(study.recordings)
    for error in intake.unreadable.values():
        observer.message(f"Left out: {error}")
    trials = plan_trials(intake.recordings, study.strategy_names)
    observer.begin(len(trials))
    bench = Laboratory(
        Store(out / "store", report=observer.message),
        study_face(study.face),
        study,
        observer.message,
    )
    extents = _extents(bench, intake)
    log = _TimesLog(out / "times.jsonl")
    results: list[Trial] = []
    events: list[Event] = bench.store.events
    try:
        if workers == 1:
            for trial in trials:
                observer.working(trial.label)
                outcome = run_trial(bench, trial, extents.get(trial.place[0]))
                results.append(outcome)
                observer.finished(trial.label, outcome.status)
        else:
            for trial, outcome, more, muted in _in_parallel(bench, trials, extents, workers):
                results.append(outcome)
                events.extend(more)
                bench.muted |= muted
                observer.finished(trial.label, outcome.status)
    finally:
        log.write(events)
    if bench.muted:
        observer.message(
            f"In {len(bench.muted)} of {len(intake.recordings)} recordings the feature of some "
            "muscle is zero or saturated throughout; the attribute 'warnings' of the results in "
            f"{bench.store.folder / 'activation'} names them."
        )
    cube = build_cube(
        results,
        volunteers=list(dict.fromkeys(t.place[0] for t in trials)),
        instructions=list(dict.fromkeys(t.place[1] for t in trials)),
        repetitions=sorted({t.place[2] for t in trials}),
        strategies=list(study.strategy_names),
        markers=list(LIP_MARKERS),
        origin=_origin(intake),
    )
    cube.attrs |= {
        "name": study.name,
        "face": str(bench.face.attrs["name"]),
        "face_origin": str(bench.face.attrs["origin"]),
        "configuration": study.model_dump_json(),
    }
    path = write_netcdf(cube, out / "cube.nc", "cube")
    return StudyResult(cube, path, events, dict(intake.unreadable))


def run_trial(bench: Laboratory, trial: PlannedTrial, extent: Result | None = None) -> Trial:
    """Take one trial through all stages.

    Parameters
    ----------
    bench : Laboratory
        Store, face and configuration.
    trial : PlannedTrial
        Which one.
    extent : Result, optional
        Range of the features, where normalisation reaches beyond the trial.

    Returns
    -------
    Trial
        Scores, or the status and reason of its failure.
    """
    labels = (*trial.place, trial.strategy)
    recording = trial.recording
    if recording is None:
        return Trial(*labels, status="missing", reason="there is no recording of this trial")
    origin: Origin = recording.dataset.attrs["origin"]
    if recording.error is not None:
        return Trial.failed(*labels, recording.error, origin=origin)
    known: dict[str, Any] = {}
    try:
        activation = bench.activation(recording, trial.strategy, extent)
        motion = bench.motion(activation.dataset["activation"], trial.label)
        attrs = motion.dataset.attrs
        known = {
            "sigma_max": float(attrs["sigma_max"]),
            "run_time": float(attrs["run_time_s"]),
            "steps": steps_of(motion.dataset),
        }
        aligned = bench.aligned(recording, motion, trial.label)
        scores = bench.scores(aligned, motion, trial.label)
    except StoredFailure as failure:
        return Trial(
            *labels,
            status=f"failed:{failure.name}",
            reason=str(failure),
            sigma_max=failure.sigma_max,
            run_time=failure.run_time,
            origin=origin,
        )
    except EXPECTED as error:
        return Trial.failed(*labels, error, origin=origin, **known)
    return Trial(*labels, scores=scores.dataset, origin=origin, **known)


def _extents(bench: Laboratory, intake: Intake) -> dict[str, Result]:
    """Range of the features per volunteer, where Eq. 8 reaches beyond the trial."""
    reach = bench.study.signals.normalisation.reach
    if reach == "trial" or bench.study.activation_source == "true":
        return {}
    volunteers = sorted({r.place[0] for r in intake.recordings if r.error is None})
    if reach == "session":
        return {
            volunteer: bench.extent(
                {r.digest: r.dataset for r in intake.of(volunteer)}, f"{volunteer}, session"
            )
            for volunteer in volunteers
        }

    references = take_in_references(bench.study.recordings)
    return {
        volunteer: bench.extent(
            {dataset_digest(r): r for r in references[volunteer]}, f"{volunteer}, reference"
        )
        for volunteer in volunteers
        if volunteer in references
    }


def _origin(intake: Intake) -> Origin:
    return "simulated" if intake.origin == "simulated" else "measured"


_Job = tuple[PlannedTrial, Trial, list[Event], set[str]]


def _in_parallel(
    bench: Laboratory,
    trials: Iterable[PlannedTrial],
    extents: dict[str, Result],
    workers: int,
) -> Iterator[_Job]:
    """Run trials in several processes; each reads and writes the same store."""
    pool = ProcessPoolExecutor(
        workers,
        mp_context=get_context("spawn"),
        initializer=_begin_worker,
        initargs=(bench.study, bench.store.folder),
    )
    try:
        futures = {}
        for trial in trials:
            extent = extents.get(trial.place[0])
            futures[pool.submit(_work, _without_data(trial), extent)] = trial
        for future in as_completed(futures):
            yield futures[future], *future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


_bench: Laboratory | None = None
"""The laboratory of a worker process."""


def _begin_worker(study: StudyConfiguration, folder: Path) -> None:
    global _bench
    import numba

    numba.set_num_threads(1)  # one core per process: the processes are the parallelism
    _bench = Laboratory(Store(folder), study_face(study.face), study, print)


def _without_data(trial: PlannedTrial) -> PlannedTrial:
    """Leave the samples of a usable recording behind: a worker reads the file itself."""
    recording = trial.recording
    if recording is None or recording.error is not None:
        return trial
    bare = type(recording)(recording.place, xr.Dataset(), "", recording.path)
    return PlannedTrial(trial.place, trial.strategy, bare)


def _work(trial: PlannedTrial, extent: Result | None) -> tuple[Trial, list[Event], set[str]]:
    assert _bench is not None, "the pool starts every worker with its laboratory"
    recording = trial.recording
    if recording is not None and recording.error is None:
        recording = load_recording(recording.path, _bench.study.recordings)
    before = len(_bench.store.events)
    outcome = run_trial(_bench, PlannedTrial(trial.place, trial.strategy, recording), extent)
    return outcome, _bench.store.events[before:], set(_bench.muted)


class _TimesLog:
    """What was computed when, one JSON object per line, added to at every run."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def write(self, events: Iterable[Event]) -> None:
        """Add the events of this run."""
        now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        old = self._path.read_text() if self._path.exists() else ""
        lines = (
            json.dumps({"run_ended": now, **asdict(event), "seconds": round(event.seconds, 4)})
            for event in events
            if event.outcome != "reused"
        )
        write_text(old + "".join(f"{line}\n" for line in lines), self._path)
