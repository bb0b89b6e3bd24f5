"""Reading of recordings, and computation of trials and of what compares them, by workers.

Results go to the store, which is a folder on a file system of all workers. A job contains the names
and digests of its inputs; a worker reads the face once, and a recording once for its strategies.
"""

import time
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

from analysis.trial import Trial
from emgface.errors import DataError, EmgfaceError, ExecutionError, StoreError, WorkerDied
from emgface.face.file import load_face, save_face
from emgface.recordings.dataset import may_be_recording, read_recording
from emgface.study.configuration import StudyConfiguration
from emgface.study.digest import code_version, dataset_digest
from emgface.study.objects import Objects
from emgface.study.one_trial import origin_of, run_trial
from emgface.study.parallel import run_jobs
from emgface.study.processes import Workers
from emgface.study.provenance import CODE, require_code
from emgface.study.retention import FACES
from emgface.study.stages import Laboratory
from emgface.study.store import Done, Result, Store
from emgface.study.table import PlannedTrial, Recording, as_recording, checked, place_of

Job = TypeVar("Job")
Outcome = TypeVar("Outcome")

PAUSE: Final = 1.0  #: seconds after which a result that could not be written is tried once more


def compute(
    work: Callable[[Laboratory, Job], Outcome],
    laboratory: Laboratory,
    jobs: Sequence[Job],
    workers: int | Workers,
    *,
    starting: Callable[[int], bool],
    group: Callable[[Job], Hashable] = lambda job: None,
    lost: Callable[[Job, WorkerDied], Outcome] | None = None,
) -> Iterator[tuple[int, Done[Outcome]]]:
    """Execute jobs that use a laboratory; yield index and output of each job when it finishes.

    `work` is a module-level function of a laboratory with the store, face and study of `laboratory`,
    and of the job, whose names are small. `starting`, `group` and `lost` are those of `run_jobs`;
    without `lost`, WorkerDied is raised if several workers died of the same job.
    """
    if not jobs:
        return
    if workers == 1:
        begin, arguments = _use, (laboratory,)
    else:
        folder = laboratory.store.folder.resolve()
        _keep_face(laboratory, folder)
        code = code_version(CODE)
        objects = laboratory.store.objects
        url = None if objects is None else objects.url
        begin, arguments = _begin, (laboratory.study, folder, laboratory.moved, code, url)

    def dead(given: tuple[Any, Job], error: WorkerDied) -> Done[Outcome]:
        if lost is None:
            raise error
        return Done(lost(given[1], error), [], False, [], 0.0)

    yield from run_jobs(
        _work,
        [(work, job) for job in jobs],
        workers,
        begin=begin,
        arguments=arguments,
        group=lambda given: group(given[1]),
        lost=dead,
        starting=starting,
    )


TrialJob = tuple[PlannedTrial, Result | None]
"""Trial, and the range of the features of its volunteer, if required."""


def compute_trials(
    laboratory: Laboratory,
    trials: Sequence[PlannedTrial],
    extents: Mapping[str, Result],
    workers: int | Workers,
    starting: Callable[[PlannedTrial], bool],
) -> Iterator[tuple[PlannedTrial, Done[Trial]]]:
    """Compute trials; yield each trial and its output when it finishes.

    `extents` contains the range of the features per volunteer, if required. `starting` receives a
    trial that is about to begin; if it returns False, no further trial begins. A trial of which
    several workers died fails with WorkerDied.
    """
    if trials and workers != 1:
        laboratory.rest(laboratory.study.simulation)  # computed once, instead of in every worker
    found = compute(
        _trial,
        laboratory,
        [(trial, extents.get(trial.place[0])) for trial in trials],
        workers,
        starting=lambda index: starting(trials[index]),
        group=lambda job: job[0].place,
        lost=_lost,
    )
    for index, done in found:
        yield trials[index], done


def _trial(laboratory: Laboratory, job: TrialJob) -> Trial:
    return run_trial(laboratory, *job)


def _lost(job: TrialJob, error: WorkerDied) -> Trial:
    trial = job[0]
    return Trial.failed(*trial.place, trial.strategy, error, origin=origin_of(trial))


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


_laboratory: Laboratory | None = None
_messages: list[str] = []
"""Laboratory of a worker process, and its messages."""
_mapping: Path | None = None
"""File that maps the labels of the recordings which the process reads."""


def _use(laboratory: Laboratory) -> None:
    """Compute trials in the process of the study."""
    global _laboratory
    _laboratory = laboratory


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
        return as_recording(checked(given), path, _mapping)
    except DataError as lacking:
        return as_recording(given, path, _mapping, type(lacking)(f"{path.name}: {lacking}"))


def _begin(
    study: StudyConfiguration,
    folder: Path,
    moved: Mapping[str, str],
    code: str,
    objects: str | None,
) -> None:
    """Prepare a worker process, which must have the code and the files of the study."""
    global _laboratory
    require_code(code)
    path = folder / FACES / f"{moved['face']}.nc"
    if not path.is_file():
        raise ExecutionError(
            f"a worker does not find {path}, expected a file system that all workers share: "
            "specify a folder for the results that exists on all machines"
        )
    face = load_face(path)
    remote = None if objects is None else Objects(objects)
    store = Store(folder, report=_messages.append, objects=remote)
    _laboratory = Laboratory(store, face, study, _messages.append)
    try:
        same = _laboratory.moved == moved
    except OSError as error:
        raise ExecutionError(
            f"a worker cannot read {error.filename} ({error.strerror}), expected a file system that all "
            "workers share: specify files that exist on all machines"
        ) from error
    if not same:
        raise ExecutionError(
            "the face, the reduced face or the head was changed while the study ran: run it again"
        )


def _work(
    given: tuple[Callable[[Laboratory, Job], Outcome], Job],
) -> Done[Outcome]:
    assert _laboratory is not None, "the laboratory of a worker is not set"
    work, job = given
    events, _messages[:], started = _laboratory.store.events, [], time.perf_counter()
    before = len(events)
    try:
        outcome = work(_laboratory, job)
    except StoreError:
        # File systems of clusters fail for moments; a full disk fails again.
        time.sleep(PAUSE)
        outcome = work(_laboratory, job)
    own = events[before:]
    del events[before:]
    muted = bool(_laboratory.muted)
    _laboratory.muted.clear()
    return Done(outcome, own, muted, list(_messages), time.perf_counter() - started)
