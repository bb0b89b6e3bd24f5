"""Results of a finished study: cube, configuration, run times and trials."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr
from pydantic import ValidationError

from analysis.axes import reference_cube
from analysis.cube import TRIAL_DIMS
from analysis.errors import AnalysisError
from emgface.errors import ConfigurationError, DataError, EmgfaceError
from emgface.run.state import read_state
from emgface.run.store import Result, Store
from emgface.schema.netcdf import read_netcdf
from emgface.study.configuration import FaceConfiguration, StudyConfiguration
from emgface.study.file import placed, variants
from emgface.study.intake import Intake, take_in
from emgface.study.run import feature_extents
from emgface.study.stages import Laboratory, StoredFailure
from emgface.study.table import Place, Recording
from sim.errors import SimulationError

FAILURES = (EmgfaceError, AnalysisError, SimulationError, StoredFailure, OSError)
"""Errors of a part of a report that do not prevent the other parts."""


@dataclass(frozen=True)
class ReportedTrial:
    """Stored results of one trial."""

    place: Place
    strategy: str
    recording: Recording
    activation: xr.Dataset
    motion: xr.Dataset
    aligned: xr.Dataset
    scores: xr.Dataset

    @property
    def label(self) -> str:
        """Readable label."""
        return " ".join(map(str, (*self.place, self.strategy)))


@dataclass
class Results:
    """A finished study."""

    folder: Path  #: folder of ``cube.nc``
    cube: xr.Dataset  #: scores and status of every trial
    #: configuration, with varied choices at their reference, if the cube contains it
    study: StudyConfiguration | None = None
    laboratory: Laboratory | None = None  #: store and face, if they can be read
    intake: Intake | None = None  #: recordings, if they can be read
    #: faces from files, of all choices of the study
    faces: list[FaceConfiguration] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)  #: one sentence for each missing part
    _extents: dict[str, Result] | None = None

    @property
    def base(self) -> xr.Dataset:
        """Cube with every further axis at its reference, the first label."""
        return reference_cube(self.cube)

    def trial(self, place: Place, strategy: str) -> ReportedTrial:
        """Read the results of one trial from the store, or compute missing ones.

        Raises DataError if there is no such recording, and the errors of a stage that cannot be
        computed.
        """
        if self.laboratory is None or self.intake is None:
            raise DataError("the recordings and the face of the study cannot be read")
        recording = next((r for r in self.intake.recordings if r.place == place), None)
        if recording is None or recording.error is not None or recording.excluded:
            raise DataError(f"there is no usable recording {' '.join(map(str, place))}")
        laboratory = self.laboratory.for_volunteer(place[0])
        label = " ".join(map(str, (*place, strategy)))
        activation = self._activation(recording, strategy)
        labels = dict(zip(TRIAL_DIMS, (*place, strategy), strict=True))
        used = float(self.base["sigma_max"].sel(labels))
        sigma_max = used if np.isfinite(used) else None
        drive, extent = activation.dataset["activation"], (self._extents or {}).get(place[0])
        motion = laboratory.predicted(recording, strategy, drive, label, extent, sigma_max)
        aligned = laboratory.aligned(recording, motion, label)
        scores = laboratory.scores(recording, aligned, motion, label)
        return ReportedTrial(
            place,
            strategy,
            recording,
            activation.dataset,
            motion.dataset,
            aligned.dataset.assign_attrs(strategy=strategy),
            scores.dataset,
        )

    def activation(self, recording: Recording, strategy: str) -> xr.Dataset:
        """Read the activation of one recording from the store, or compute it."""
        return self._activation(recording, strategy).dataset

    def _activation(self, recording: Recording, strategy: str) -> Result:
        assert self.laboratory is not None and self.intake is not None, "trials have both"
        if self._extents is None:
            self._extents = feature_extents(self.laboratory, self.intake)
        return self.laboratory.for_volunteer(recording.place[0]).activation(
            recording, strategy, self._extents.get(recording.place[0])
        )


def study_cube(folder: Path) -> xr.Dataset:
    """Read the cube of a finished study; DataError if there is none, or it cannot be read."""
    path = folder / "cube.nc"
    if not path.is_file():
        raise DataError(
            f"{folder} contains no cube.nc, expected the folder of a finished study: specify "
            "the folder of 'emgface study run --out', or run the study again to complete it"
        )
    return read_netcdf(path, "cube")


def open_results(folder: Path) -> Results:
    """Open the folder of a finished study.

    Recordings, face and store are None, with a note, if they do not exist any more. Raises
    DataError if the folder has no cube, or it cannot be read.
    """
    results = Results(folder, study_cube(folder))
    text = results.cube.attrs.get("configuration")
    if text is None:
        results.notes.append(
            "The cube does not contain the configuration of its study; parameters and "
            "moving faces are omitted."
        )
        return results
    try:
        whole = StudyConfiguration.model_validate(json.loads(str(text)))
        whole, results.notes = placed(whole, folder)
        every = [variant.study for variant in variants(whole)]
        results.study = every[0]  # the reference of varied choices
        own = {s.face.path: s.face for s in every if s.face.path is not None}
        results.faces = list(own.values())
    except (ValidationError, json.JSONDecodeError, ConfigurationError) as error:
        results.notes.append(
            "The configuration in the cube was written by another version of this package; "
            "parameters and moving faces are omitted "
            f"({' '.join(str(error).split())[:200]})."
        )
        return results
    if not (results.base["status"].values == "ok").any():
        return results
    try:
        results.intake = take_in(results.study.recordings, results.study.exclude, study=folder)
        results.laboratory = Laboratory.of_study(
            Store(_store(folder), report=results.notes.append),
            results.study,
            results.notes.append,
            [str(name) for name in results.base["volunteer"].values],
        )
    except FAILURES as error:
        results.notes.append(
            "Moving faces and pictures of trials are omitted, because the recordings or the "
            f"face can no longer be read: {error}"
        )
    return results


def _store(folder: Path) -> Path:
    """Store of the last run of a study, or the default store if there is no journal."""
    try:
        return read_state(folder).store(folder)
    except DataError:
        return folder / "store"


def representative(cube: xr.Dataset) -> dict[str, Place]:
    """Choose the representative trial of each instruction with a scored trial.

    Among the trials that are scored with the largest number of strategies, it is the trial whose
    median rho is nearest to the median of the instruction.
    """
    chosen: dict[str, Place] = {}
    ok = cube["status"] == "ok"
    for instruction in cube["instruction"].values:
        scored = ok.sel(instruction=instruction).sum("strategy")
        if not scored.size or not int(scored.max()):
            continue
        rho = cube["rho"].sel(instruction=instruction)
        median = rho.median(["strategy", "marker"], skipna=True)
        distance = abs(median - float(np.nanmedian(rho.values) if rho.notnull().any() else 0.0))
        distance = distance.fillna(np.inf).where(scored == scored.max(), np.inf)
        if not np.isfinite(distance.values).any():
            distance = (scored != scored.max()).astype(float)
        flat = distance.transpose("volunteer", "repetition").values
        v, r = np.unravel_index(int(np.argmin(flat)), flat.shape)
        chosen[str(instruction)] = (
            str(cube["volunteer"].values[v]),
            str(instruction),
            int(cube["repetition"].values[r]),
        )
    return chosen
