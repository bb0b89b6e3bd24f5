"""Simulated motions of scored trials and other results, read from the store one at a time."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import xarray as xr

from emgface.errors import StoreError
from emgface.files import result_file
from emgface.run.journal import Entry
from emgface.run.store import Result, Stage, damage_of
from emgface.study.stage_code import MOTION
from emgface.study.stages import Laboratory
from emgface.study.table import PlannedTrial


@dataclass(frozen=True)
class StoredMotion:
    """Simulated motion of a trial, read when it is needed."""

    laboratory: Laboratory
    trial: PlannedTrial
    entry: Entry
    extent: Result | None

    @property
    def digest(self) -> str:
        """Digest of the stored result."""
        return [digest for stage, digest, *_ in self.entry.files if stage == MOTION.name][-1]

    @cached_property
    def dataset(self) -> xr.Dataset:
        """Stored motion, computed again if it is damaged."""
        motion = self.laboratory.store.read(MOTION.name, self.digest)
        if motion is not None:
            return motion
        trial, laboratory = self.trial, self.laboratory.for_volunteer(self.trial.place[0])
        recording, strategy = trial.recording, trial.strategy
        assert recording is not None, "a scored trial has a recording"
        activation = laboratory.activation(recording, strategy, self.extent).dataset["activation"]
        return laboratory.predicted(
            recording, strategy, activation, trial.label, self.extent, self.entry.sigma_max
        ).dataset


def stored(laboratory: Laboratory, stage: Stage, digest: str) -> xr.Dataset:
    """Read a result that this or another worker has stored."""
    result = laboratory.store.read(stage.name, digest)
    if result is None:
        raise _changed(stage, digest)
    return result


def stored_file(laboratory: Laboratory, stage: Stage, digest: str) -> Path:
    """File of a result that this or another worker has stored."""
    path = result_file(laboratory.store.folder, stage.name, digest)
    if damage_of(path) is not None:
        raise _changed(stage, digest)
    return path


def _changed(stage: Stage, digest: str) -> StoreError:
    return StoreError(
        f"the result {digest} of stage {stage.name} was changed or removed while the study ran: "
        "run the same command again, which computes it again"
    )
