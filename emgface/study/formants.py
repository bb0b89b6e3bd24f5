"""Formants of the trials of a study: the moving lips in front of a tract that does not move."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import xarray as xr

from analysis.formants import FORMANTS, INSTANTS, cube_with_formants
from emgface.anatomy.airway import sound
from emgface.anatomy.airway.area_function import lips_of_trial, tract_of, with_lips
from emgface.face.lip_shape import has_mouth
from emgface.run.digest import dataset_digest
from emgface.run.journal import Entry
from emgface.run.store import Result, Stage
from emgface.study.motions import StoredMotion, stored
from emgface.study.outcomes import StudyRun
from emgface.study.stages import Laboratory
from emgface.study.table import PlannedTrial

SOUND: Final = Stage("formants", ("analysis.formants", __name__))


def compute_formants(
    laboratory: Laboratory,
    planned: Sequence[PlannedTrial],
    entries: Mapping[tuple[str, str, int, str], Entry],
    extents: Mapping[str, Result],
    run: StudyRun,
) -> dict[tuple[str, str, int, str], str] | None:
    """Store the formants of every scored trial, if the study specifies a tract; digests by trial.

    Arguments are those of `emgface.study.baselines.compute_baselines`. The result is None without a
    tract, and for a face without a mouth opening, which the observer of `run` receives as a message.
    """
    if laboratory.study.tract is None:
        return None
    if not has_mouth(laboratory.face):
        run.observer.message("No formants are computed, because the face has no mouth opening.")
        return None
    places = [(*trial.place, trial.strategy) for trial in planned]
    jobs = [
        (trial, entries[place], extents.get(trial.place[0]))
        for trial, place in zip(planned, places, strict=True)
        if entries[place].status == "ok"
    ]
    computed = run.computed(trial_formants, laboratory, jobs, "formants")
    return {(*job[0].place, job[0].strategy): one for job, one in zip(jobs, computed, strict=True)}


def trial_formants(laboratory: Laboratory, job: tuple[PlannedTrial, Entry, Result | None]) -> str:
    """Store the formants of one trial and return their digest."""
    trial, entry, extent = job
    parameters = laboratory.study.tract
    assert parameters is not None, "a study with formants specifies a tract"
    tract, motion = tract_of(parameters), StoredMotion(laboratory, trial, entry, extent)
    return laboratory.store.get_or_compute(
        SOUND,
        {"motion": motion.digest, "tract": dataset_digest(tract)},
        {"lips": parameters.lips},
        lambda: formants_of(motion.dataset, tract, parameters.lips),
        label=trial.label,
    ).digest


def with_stored_formants(
    cube: xr.Dataset, laboratory: Laboratory, digests: Mapping[tuple[str, str, int, str], str]
) -> xr.Dataset:
    """Add stored formants to the cube of their trials (`analysis.formants.cube_with_formants`)."""
    assert laboratory.study.tract is not None, "a study with formants specifies a tract"
    return cube_with_formants(
        cube,
        {place: stored(laboratory, SOUND, digest) for place, digest in digests.items()},
        tract_of(laboratory.study.tract).attrs["assumptions"],
    )


def formants_of(motion: xr.Dataset, tract: xr.Dataset, lips: float) -> xr.Dataset:
    """Area function and formants of a motion at equal parts of its duration.

    `motion` is a trajectory with ``mouth_area`` and ``lip_protrusion``, `tract` the area function
    of one instant and `lips` the length of the lips' section at rest [m]. The result is of the kind
    "sound", at `INSTANTS` instants.
    """
    area, forward, at = lips_of_trial(motion)
    time = np.linspace(at[0], at[-1], INSTANTS)
    area, forward = np.interp(time, at, area), np.interp(time, at, forward)
    return sound.with_formants(with_lips(tract, area, forward, time, lips=lips), count=FORMANTS)
