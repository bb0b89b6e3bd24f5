"""Jaws as a kind of model (`emgface.models.kinds.Functions`)."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import xarray as xr

from emgface.errors import JawError
from emgface.models.kinds import (
    Drive,
    Evidence,
    FittedModel,
    Moved,
    Person,
    Progress,
    chosen,
    error_of,
    names_file,
    refuse_unused,
    tolerance_of,
)
from emgface.schema.netcdf import read_netcdf, write_netcdf

if TYPE_CHECKING:
    from analysis.tables import Table


def build(person: Person) -> xr.Dataset:
    """Generate jaw, hyoid and larynx from published measures."""
    from emgface.anatomy.jaw.template import template_jaw
    from emgface.anatomy.jaw.template.measures import parse_settings

    measures = parse_settings(list(person.measures))
    return template_jaw(measures=measures, preset=person.preset, seed=person.seed)


def import_(folder: Path, settings: Mapping[str, str]) -> xr.Dataset:
    """Import the published model of jaw, hyoid and larynx."""
    from emgface.anatomy.jaw.published import import_jaw

    return import_jaw(folder, **chosen(import_jaw, settings, "variant", "condyle", "values"))


def read(path: Path) -> xr.Dataset:
    """Read a jaw."""
    from emgface.anatomy.checked import read_model

    return read_model(path, "jaw_model")


def write(jaw: xr.Dataset, path: Path) -> object:
    """Write a jaw."""
    return write_netcdf(jaw, path, "jaw_model")


def fit(
    jaw: xr.Dataset, evidence: Evidence, progress: Callable[[str, int, int], None]
) -> FittedModel:
    """Fit jaw, hyoid and larynx to landmarks and surfaces by the names of their bodies."""
    from emgface.face.file import load_face
    from emgface.fit.bones import fit_jaw
    from emgface.fit.parts_report import bones_summary, fitted_bones_page, write_fit_page

    progress("fit to the bones", 0, 1)
    fitted = fit_jaw(
        jaw, landmarks=evidence.landmarks, surfaces=evidence.surfaces, unit=evidence.unit,
        on_jaw=evidence.places, frame=None if evidence.frame is None else load_face(evidence.frame),
        noise=evidence.noise, name=evidence.name, simulated=evidence.simulated,
    )  # fmt: skip
    progress("fit to the bones", 1, 1)
    notes = (*fitted.notes, *bones_summary(fitted))
    return FittedModel(fitted.jaw, notes, partial(write_fit_page, fitted_bones_page(fitted)))


def describe(jaw: xr.Dataset) -> str:
    """Describe a jaw."""
    return (
        f"{jaw.attrs['name']}: {int(jaw['body_moves'].sum())} moving bodies, "
        f"{jaw.sizes['muscle']} muscles, {jaw.sizes['spring']} springs, {jaw.sizes['joint']} joints"
    )


def check(model: Any) -> list[tuple[str, pd.DataFrame]]:
    """Return no table: reading has checked the model."""
    return []


def move(jaw: xr.Dataset, drive: Drive, progress: Progress) -> Moved:
    """Move a jaw by a task or by excitations in a file.

    Settings are the muscle ``law`` and, for a task, the folder of published ``series`` and the side of
    the ``morsel``.
    """
    from emgface.anatomy.jaw.run import run_excitation, run_task
    from emgface.anatomy.jaw.series import read_excitation
    from emgface.anatomy.jaw.tasks import with_series

    refuse_unused(drive, (), "what moves a jaw")
    settings = dict(drive.settings)
    series, morsel = settings.pop("series", None), settings.pop("morsel", None)
    tolerance = tolerance_of(drive.accuracy)
    options: dict[str, Any] = chosen(_law, settings, "law") | {"tolerance": tolerance}
    given = {"duration": drive.duration, "step": drive.step}
    options |= {name: value for name, value in given.items() if value is not None}
    notes, path = list[str](), Path(drive.source)
    if names_file(drive.source):
        if series is not None or morsel is not None:
            raise JawError(
                "series and morsel are settings of a task, expected none with a file of excitations: "
                "leave them out"
            )
        name, simulated = path.stem, partial(run_excitation, jaw, read_excitation(path))
    else:
        name = drive.source
        task, own = with_series(name, series, morsel=morsel)
        if series is not None and not own:
            raise JawError(f"the task {name!r} has no series, expected none or the task 'chew'")
        if task.series and not own:
            notes.append(
                "The excitations of chewing are chosen, not measured; the setting series=FOLDER reads "
                "published ones."
            )
        simulated = partial(run_task, jaw, task, **own)
    motion = simulated(progress=progress, **options)
    motion.attrs["task"] = name
    if absent := motion.attrs.get("absent_exciters"):
        notes.append(f"The model has no exciter {absent}; the task is simulated without it.")
    if side := motion.attrs.get("morsel"):
        notes.append(f"The morsel is on the {'left' if side == 'L' else 'right'} side.")
    return Moved(motion, [*notes, *_unrest(motion), error_of(motion, tolerance)])


def _law(law: str = "peck") -> None:
    """Stand for the settings of `simulate_jaw` that a command may change."""


def _unrest(motion: xr.Dataset) -> list[str]:
    """Sentence on the speed of the jaw at the end of a task that should end at rest."""
    from emgface.anatomy.jaw.run import REST_SPEED

    speed = motion.attrs.get("end_speed", 0.0)
    if speed <= REST_SPEED:
        return []
    return [
        f"At the end, {float(motion['time'][-1]):.4g} s, a point still moves at {1e3 * speed:.2g} "
        "mm/s, although the task should end at rest: specify a longer --duration."
    ]


def write_motion(motion: xr.Dataset, jaw: xr.Dataset, path: Path) -> object:
    """Write the motion of a jaw."""
    return write_netcdf(motion, path, "jaw_motion")


def table(
    jaw: xr.Dataset, settings: Mapping[str, str], progress: Progress
) -> tuple[str, pd.DataFrame]:
    """Run all tasks, and tabulate the results with the published ones."""
    from emgface.anatomy.jaw.outcomes import task_outcome_table

    series = settings.get("series")
    options = chosen(
        task_outcome_table, {k: v for k, v in settings.items() if k != "series"}, "step"
    )
    outcomes = task_outcome_table(jaw, series, progress=progress, **options)
    return f"{jaw.attrs['name']}, simulated", outcomes


def scored(
    recording: xr.Dataset, motion: Path, options: Mapping[str, Any]
) -> "tuple[xr.Dataset, Table, str]":
    """Score every recorded point of the jaw, compared with motions by other excitations."""
    from emgface.anatomy.jaw.compared import compared_jaws
    from emgface.anatomy.jaw.recorded import score_motion

    moved = read_netcdf(motion, "jaw_motion")
    comparison = compared_jaws(recording, moved, baselines(options.get("baseline") or ()))
    return score_motion(recording, moved), comparison, comparison.note


def baselines(paths: Iterable[str | PathLike[str]]) -> dict[str, xr.Dataset]:
    """Motions that are scored for comparison with another one, by the names of their files."""
    return {Path(path).stem: read_netcdf(Path(path), "jaw_motion") for path in paths}
