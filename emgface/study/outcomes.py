"""Trials of one run: computed by workers, or known from its journal.

Results go to the store, which is a folder on a file system of all workers. A job contains the names
and digests of its inputs; a worker reads the face once, and a recording once for its strategies.
"""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import xarray as xr

from analysis.trial import Trial
from emgface.errors import DataError, EmgfaceError, ExecutionError, StoreError
from emgface.face.file import load_face, save_face
from emgface.recordings.dataset import may_be_recording, read_recording
from emgface.run.digest import dataset_digest
from emgface.run.journal import Entry, Journal, StoredFiles
from emgface.run.objects import Objects
from emgface.run.observer import Observer, Silent
from emgface.run.provenance import require_code
from emgface.run.retention import FACES
from emgface.run.runner import Workers
from emgface.run.store import Result, Store
from emgface.run.tasks import Done, Job, Outcome, Task
from emgface.study.configuration import StudyConfiguration
from emgface.study.stages import Laboratory, origin_of_trial, run_trial
from emgface.study.table import (
    Place,
    PlannedTrial,
    Recording,
    as_recording,
    checked_recording,
    place_of,
)


def on_laboratory(
    work: Callable[[Laboratory, Job], Outcome],
    laboratory: Laboratory,
    workers: int | Workers,
    *,
    group: Callable[[Job], Hashable] = lambda job: None,
    failed: Callable[[Job, Exception], Outcome] | None = None,
) -> Task[Any, Laboratory, Job, Outcome]:
    """Task on jobs that use a laboratory with the store, face and study of `laboratory`.

    `work` is a module-level function of the laboratory and of the job, whose names are small;
    `group` and `failed` are those of `Task`.
    """
    if workers == 1:
        return Task(_same, laboratory, work, group, failed)
    folder = laboratory.store.folder.resolve()
    _keep_face(laboratory, folder)
    own = {volunteer: laboratory.for_volunteer(volunteer) for volunteer in laboratory.own}
    for one in own.values():
        _keep_face(one, folder)
    objects = laboratory.store.objects
    url = None if objects is None else objects.url
    faces = {volunteer: one.face_digest for volunteer, one in own.items()}
    given = (laboratory.study, folder, laboratory.moved, url, faces)
    return Task(read_laboratory, given, work, group, failed)


TrialJob = tuple[PlannedTrial, Result | None]
"""Trial, and the range of the features of its volunteer, if required."""
Judged = tuple[Trial, bool]
"""Outcome of a trial, and True if a feature of its recording is zero or saturated throughout."""


def compute_trials(
    laboratory: Laboratory,
    trials: Sequence[PlannedTrial],
    extents: Mapping[str, Result],
    workers: int | Workers,
    starting: Callable[[PlannedTrial], bool],
) -> Iterator[tuple[PlannedTrial, Done[Judged]]]:
    """Compute trials; yield each trial and its output when it finishes.

    `extents` contains the range of the features per volunteer, if required. `starting` receives a
    trial that is about to begin; if it returns False, no further trial begins. A trial of which
    several workers died fails with WorkerDied.
    """
    if trials and workers != 1 and not laboratory.own:
        laboratory.rest(laboratory.study.simulation)  # computed once, instead of in every worker
    task = on_laboratory(_trial, laboratory, workers, group=_of_place, failed=_lost)
    jobs = [(trial, extents.get(trial.place[0])) for trial in trials]
    for index, done in task.outcomes(jobs, workers, starting=lambda index: starting(trials[index])):
        yield trials[index], done


def _trial(laboratory: Laboratory, job: TrialJob) -> Judged:
    trial = run_trial(laboratory, *job)
    muted = bool(laboratory.muted)
    laboratory.muted.clear()
    return trial, muted


def _of_place(job: TrialJob) -> Hashable:
    return job[0].place


def _lost(job: TrialJob, error: Exception) -> Judged:
    trial = job[0]
    return Trial.failed(*trial.place, trial.strategy, error, origin=origin_of_trial(trial)), False


def _kept_face(store: Path, digest: str) -> xr.Dataset:
    """Read a face that the process of the study has written to the store."""
    path = store / FACES / f"{digest}.nc"
    if not path.is_file():
        raise ExecutionError(
            f"a worker does not find {path}, expected a file system that all workers share: "
            "specify a folder for the results that exists on all machines"
        )
    return load_face(path)


def _keep_face(laboratory: Laboratory, store: Path) -> None:
    """Write the face of a study to the store, unless it is there."""
    path = store / FACES / f"{laboratory.face_digest}.nc"
    try:
        if dataset_digest(load_face(path)) == laboratory.face_digest:
            return
    except DataError:
        pass
    try:
        save_face(laboratory.face, path)
    except DataError as error:
        raise StoreError(str(error)) from error


_mapping: Path | None = None
"""File that maps the labels of the recordings which the process reads."""


def begin_reading(mapping: Path | None, code: str) -> None:
    """Prepare a worker process for `identified`."""
    global _mapping
    require_code(code)
    _mapping = mapping


def identified(paths: Sequence[Path]) -> list[Recording | EmgfaceError | None]:
    """Describe recordings; an error for an unreadable one, None for a file of another kind."""
    return [_identified(path) for path in paths]


def _identified(path: Path) -> Recording | EmgfaceError | None:
    if not path.is_file():
        raise ExecutionError(
            f"a worker does not find {path}, expected a file system that all workers share: "
            "specify a folder of recordings that exists on all machines"
        )
    if not may_be_recording(path):
        return None
    try:
        given = read_recording(path, mapping=_mapping)
        place_of(given, path.name)
    except EmgfaceError as error:
        return error
    try:
        return as_recording(checked_recording(given), path, _mapping)
    except DataError as lacking:
        return as_recording(given, path, _mapping, type(lacking)(f"{path.name}: {lacking}"))


def _same(laboratory: Laboratory, report: Callable[[str], None]) -> Laboratory:
    """Laboratory of the process of the study."""
    return laboratory


Files = tuple[StudyConfiguration, Path, Mapping[str, str], str | None, Mapping[str, str]]
"""Study, folder of the store, digests of what moves, and address of the object storage.

The last are the digests of the faces of the volunteers, if each has one.
"""


def read_laboratory(given: Files, report: Callable[[str], None]) -> Laboratory:
    """Prepare the laboratory of a worker process, which must have the files of the study."""
    study, folder, moved, objects, faces = given
    face = _kept_face(folder, moved["face"])
    own = {volunteer: _kept_face(folder, digest) for volunteer, digest in faces.items()}
    remote = None if objects is None else Objects(objects)
    store = Store(folder, report=report, objects=remote)
    laboratory = Laboratory(store, face, study, report, own=own)
    try:
        same = laboratory.moved == moved
    except OSError as error:
        raise ExecutionError(
            f"a worker cannot read {error.filename} ({error.strerror}), expected a file system that all "
            "workers share: specify files that exist on all machines"
        ) from error
    if not same:
        raise ExecutionError(
            "the face, the reduced face or the head was changed while the study ran: run it again"
        )
    return laboratory


Entries = dict[tuple[str, str, int, str], Entry]
"""Outcomes of the trials by volunteer, instruction, repetition and strategy."""


@dataclass
class StudyRun:
    """Journal and execution of one run, and the outcomes of all its trials.

    `stopping` returns True if no further trial should begin; `variant` is the label of the present
    variant of the study.
    """

    journal: Journal
    stored: StoredFiles
    workers: int | Workers
    observer: Observer
    stopping: Callable[[], bool]
    variant: str = ""
    entries: list[Entry] = field(default_factory=list)
    muted: set[Place] = field(default_factory=set)

    def label(self, trial: PlannedTrial) -> str:
        """Readable label of a trial of the present variant."""
        return f"{self.variant}: {trial.label}" if self.variant else trial.label

    @contextmanager
    def silently(self) -> Iterator[None]:
        """Do not count trials that are computed again as progress."""
        observer, self.observer = self.observer, Silent()
        try:
            yield
        finally:
            self.observer = observer

    def starting(self, trial: PlannedTrial) -> bool:
        """Note that a trial begins, unless the run is to stop."""
        if self.stopping():
            return False
        self.journal.write("begin", trial=[*trial.place, trial.strategy], variant=self.variant)
        self.observer.working(self.label(trial))
        return True

    def checkpoint(self) -> None:
        """Raise KeyboardInterrupt if the run is to stop."""
        if self.stopping():
            raise KeyboardInterrupt

    def computed(
        self,
        work: Callable[[Laboratory, Job], Outcome],
        laboratory: Laboratory,
        jobs: Sequence[Job],
        stage: str,
    ) -> list[Outcome]:
        """Return the outcomes of jobs of the workers that are not trials, in their order.

        The events of their results are added to those of `laboratory`. Raises KeyboardInterrupt if
        the run is to stop, and WorkerDied if several workers died of the same job.
        """
        outcomes: dict[int, Outcome] = {}

        def starting(index: int) -> bool:
            self.observer.working(f"{stage} {index + 1} of {len(jobs)}")
            return not self.stopping()

        task = on_laboratory(work, laboratory, self.workers)
        for index, done in task.outcomes(jobs, self.workers, starting=starting):
            outcomes[index] = done.outcome
            laboratory.store.events += done.events
            for text in done.messages:
                self.observer.message(text)
        if len(outcomes) < len(jobs):
            raise KeyboardInterrupt
        return [outcomes[index] for index in range(len(jobs))]

    def outcomes(
        self,
        trials: Sequence[PlannedTrial],
        keys: Sequence[str],
        compute_left: Callable[[list[PlannedTrial]], Iterator[tuple[PlannedTrial, Done[Judged]]]],
        store: Path,
    ) -> Entries:
        """Return the outcomes of trials, computed if they are unknown or their results damaged.

        `keys` are the digests of all inputs of the trials; `compute_left` yields trials and their
        outputs in any order, and `store` is the folder of their results. Raises KeyboardInterrupt
        if `compute_left` stops early, and StoreError if the journal cannot be written.
        """
        entries: Entries = {}
        absent: dict[tuple[Place, str], str] = {}
        for trial, key in zip(trials, keys, strict=True):
            entry = self.journal.known.get(key)
            if entry is None or not entry.final or not self.stored.intact(entry):
                absent[trial.place, trial.strategy] = key
                continue
            entries[*trial.place, trial.strategy] = entry
            if entry.muted:
                self.muted.add(trial.place)
            self.observer.finished(self.label(trial), entry.status)
        left = [trial for trial in trials if (trial.place, trial.strategy) in absent]
        for trial, done in compute_left(left):
            outcome, muted = done.outcome
            entry = self.journal.trial(
                absent[trial.place, trial.strategy],
                outcome,
                done.events,
                store,
                variant=self.variant,
                seconds=done.seconds,
                muted=muted,
            )
            entries[*trial.place, trial.strategy] = entry
            if muted:
                self.muted.add(trial.place)
            for text in done.messages:
                self.observer.message(text)
            self.observer.finished(self.label(trial), outcome.status)
        if len(entries) < len(trials):
            raise KeyboardInterrupt
        self.entries += entries.values()
        return {(*t.place, t.strategy): entries[*t.place, t.strategy] for t in trials}
