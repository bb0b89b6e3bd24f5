"""Formants of the trials of a study: the moving lips before a tract that does not move."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import xarray as xr

from analysis.formants import FORMANTS, INSTANTS, with_formants
from emgface.anatomy.airway import sound
from emgface.anatomy.airway.area_function import lips_of_trial, tract_of, with_lips
from emgface.face.lip_shape import has_mouth
from emgface.study.digest import dataset_digest
from emgface.study.journal import Entry
from emgface.study.motions import StoredMotion
from emgface.study.outcomes import Run
from emgface.study.stages import Laboratory
from emgface.study.store import Result, Stage
from emgface.study.table import PlannedTrial

SOUND: Final = Stage(
    "formants",
    (
        "sim.acoustics",
        "analysis.formants",
        "emgface.anatomy.airway.area_function",
        "emgface.anatomy.airway.parameters",
        "emgface.anatomy.airway.sound",
        "emgface.study.formants",
    ),
)


def add_formants(
    laboratory: Laboratory,
    cube: xr.Dataset,
    planned: Sequence[PlannedTrial],
    entries: Mapping[tuple[str, str, int, str], Entry],
    extents: Mapping[str, Result],
    run: Run,
) -> xr.Dataset:
    """Add the formants of every scored trial to the cube of a study, if it specifies a tract.

    They are computed from the stored motions (`analysis.formants.with_formants`).
    Arguments are those of `emgface.study.baselines.add_baselines`. A face without a mouth opening
    has no formants, which the observer of `run` is told.
    """
    parameters = laboratory.study.tract
    if parameters is None:
        return cube
    if not has_mouth(laboratory.face):
        run.observer.message("No formants are computed, because the face has no mouth opening.")
        return cube
    places = [(*trial.place, trial.strategy) for trial in planned]
    jobs = [
        (trial, entries[place], extents.get(trial.place[0]))
        for trial, place in zip(planned, places, strict=True)
        if entries[place].status == "ok"
    ]
    found = run.computed(formants, laboratory, jobs, "formants")
    return with_formants(
        cube,
        {(*job[0].place, job[0].strategy): one for job, one in zip(jobs, found, strict=True)},
        tract_of(parameters).attrs["assumptions"],
    )


def formants(laboratory: Laboratory, job: tuple[PlannedTrial, Entry, Result | None]) -> xr.Dataset:
    """Store and return the formants of one trial."""
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
    ).dataset


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
