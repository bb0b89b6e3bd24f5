"""Execution of trials in several processes with a common store."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import xarray as xr

from analysis.trial import Trial
from emgface.study.configuration import StudyConfiguration
from emgface.study.one_trial import run_trial
from emgface.study.parallel import in_processes
from emgface.study.stages import Laboratory
from emgface.study.store import Event, Result, Store
from emgface.study.table import PlannedTrial, load_recording


@dataclass(frozen=True)
class Done:
    """Output of a worker: result of the trial, stored results and messages."""

    outcome: Trial
    events: list[Event]
    muted: set[str]
    messages: list[str]


def in_parallel(
    laboratory: Laboratory,
    trials: Sequence[PlannedTrial],
    extents: Mapping[str, Result],
    workers: int,
) -> Iterator[tuple[PlannedTrial, Done]]:
    """Run trials in several processes; yield each trial and its output when it finishes.

    The workers receive store folder, face and configuration of the laboratory. `extents` contains the
    range of the features per volunteer, if required.
    """
    laboratory.rest(laboratory.study.simulation)  # computed once here instead of in every worker
    jobs = [(_without_data(trial), extents.get(trial.place[0])) for trial in trials]
    arguments = (laboratory.study, laboratory.face, laboratory.store.folder)
    for index, done in in_processes(_work, jobs, workers, begin=_begin, arguments=arguments):
        yield trials[index], done


_laboratory: Laboratory | None = None
_messages: list[str] = []
"""Laboratory of a worker process, and its messages."""


def _begin(study: StudyConfiguration, face: xr.Dataset, folder: Path) -> None:
    global _laboratory
    store = Store(folder, report=_messages.append)
    _laboratory = Laboratory(store, face, study, _messages.append)


def _without_data(trial: PlannedTrial) -> PlannedTrial:
    """Remove the samples of a usable recording, because a worker reads the file itself."""
    recording = trial.recording
    if recording is None or recording.error is not None or recording.excluded:
        return trial
    return replace(trial, recording=replace(recording, dataset=xr.Dataset(), digest=""))


def _work(job: tuple[PlannedTrial, Result | None]) -> Done:
    assert _laboratory is not None, "the laboratory of a worker is not set"
    trial, extent = job
    recording = trial.recording
    if recording is not None and recording.error is None and not recording.excluded:
        recording = load_recording(recording.path, _laboratory.study.recordings)
    before, _messages[:] = len(_laboratory.store.events), []
    outcome = run_trial(_laboratory, replace(trial, recording=recording), extent)
    return Done(outcome, _laboratory.store.events[before:], set(_laboratory.muted), list(_messages))
