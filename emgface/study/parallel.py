"""Trials in several processes, one thread each, all on the same store.

Small meshes gain nothing from threads; independent trials gain all from processes.
"""

import multiprocessing
import os
import signal
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import xarray as xr

from analysis.trial import Trial
from emgface.study.configuration import StudyConfiguration
from emgface.study.faces import study_face
from emgface.study.one_trial import run_trial
from emgface.study.stages import Laboratory
from emgface.study.store import Event, Result, Store
from emgface.study.table import PlannedTrial, load_recording

THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@dataclass(frozen=True)
class Done:
    """What a worker gives back: the trial's result, what was stored, whom to tell what."""

    outcome: Trial
    events: list[Event]
    muted: set[str]
    messages: list[str]


def in_parallel(
    bench: Laboratory,
    trials: Sequence[PlannedTrial],
    extents: Mapping[str, Result],
    workers: int,
) -> Iterator[tuple[PlannedTrial, Done]]:
    """Run trials in several processes and yield them as they finish.

    Parameters
    ----------
    bench : Laboratory
        Store folder and configuration are handed to the workers.
    trials : sequence of PlannedTrial
        What to run.
    extents : mapping of str to Result
        Range of the features per volunteer, where needed.
    workers : int
        Number of processes.

    Yields
    ------
    PlannedTrial
        Which one has finished.
    Done
        How.

    Notes
    -----
    When the caller stops (interruption, error), the workers are stopped at once: results are
    stored whole or not at all, so nothing is left half-done.
    """
    bench.rest(bench.study.simulation)  # once here, or every worker would compute it
    mine = {child.pid for child in multiprocessing.active_children()}
    context = multiprocessing.get_context("spawn")
    with single_threaded_children():
        pool = ProcessPoolExecutor(workers, context, _begin, (bench.study, bench.store.folder))
        try:
            futures = {
                pool.submit(_work, _without_data(trial), extents.get(trial.place[0])): trial
                for trial in trials
            }
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:
            for child in multiprocessing.active_children():
                if child.pid not in mine:
                    child.terminate()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def single_threaded_children() -> Iterator[None]:
    """Let processes started in the block use one thread each."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name)
            else:
                os.environ[name] = value


_bench: Laboratory | None = None
_messages: list[str] = []
"""The laboratory of a worker process, and what it has to say."""


def _begin(study: StudyConfiguration, folder: Path) -> None:
    global _bench
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent hears it and stops the workers
    store = Store(folder, report=_messages.append)
    _bench = Laboratory(store, study_face(study.face), study, _messages.append)


def _without_data(trial: PlannedTrial) -> PlannedTrial:
    """Leave the samples of a usable recording behind: a worker reads the file itself."""
    recording = trial.recording
    if recording is None or recording.error is not None:
        return trial
    return replace(trial, recording=replace(recording, dataset=xr.Dataset(), digest=""))


def _work(trial: PlannedTrial, extent: Result | None) -> Done:
    assert _bench is not None, "the pool starts every worker with its laboratory"
    recording = trial.recording
    if recording is not None and recording.error is None:
        recording = load_recording(recording.path, _bench.study.recordings)
    before, _messages[:] = len(_bench.store.events), []
    outcome = run_trial(_bench, replace(trial, recording=recording), extent)
    return Done(outcome, _bench.store.events[before:], set(_bench.muted), list(_messages))
