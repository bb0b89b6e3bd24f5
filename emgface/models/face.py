"""Faces as a kind of model (`emgface.models.kinds.Functions`)."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr

from emgface.choices import configure
from emgface.errors import ConfigurationError, FitError, listed
from emgface.face.file import load_face as read
from emgface.face.file import save_face as write
from emgface.models.kinds import (
    Drive,
    Evidence,
    FittedModel,
    Moved,
    Person,
    Progress,
    chosen,
    levels_of,
    names_file,
    refuse_unused,
)

DEFAULT_LEVEL: Final = 0.3  #: of a muscle that is named without one
LEVELS_RISE: Final = 0.1  #: time in which levels are reached [s]
LEVELS_DURATION: Final = 0.5  #: simulated time of levels [s]


def build(person: Person) -> xr.Dataset:
    """Generate a lower face from published measures."""
    from emgface.face.template import parse_measures, template_face

    return template_face(
        resolution=person.resolution or "medium",
        measures=parse_measures(list(person.measures)),
        preset=person.preset,
        seed=person.seed,
    )


def import_(folder: Path, settings: Mapping[str, str]) -> xr.Dataset:
    """Import the published reference face."""
    from emgface.face.artisynth import import_artisynth

    names = ("radius", "oop", "oom", "lao_fibres", "marker_ring_offset", "bones")
    return import_artisynth(folder, **chosen(import_artisynth, settings, *names))


def fit(
    face: xr.Dataset, evidence: Evidence, progress: Callable[[str, int, int], None]
) -> FittedModel:
    """Fit a face to landmarks and surfaces (``skin``, ``inner``, ``bone``), then replace courses.

    Courses alone, without landmarks, are those of a face that was fitted before.
    """
    from emgface.fit.person import LARGEST_SURFACE_MISS, fit_face
    from emgface.fit.report import summary, write_report

    if evidence.landmarks is None and evidence.courses and not evidence.surfaces:
        from emgface.fit.courses import with_courses

        changed, notes = with_courses(face, evidence.courses, evidence.volumes)
        return FittedModel(changed.assign_attrs(name=evidence.name), notes, None)
    if evidence.landmarks is None:
        raise FitError(
            "no landmarks are given, expected those of a person: a face cannot be placed without them"
        )
    if unknown := [name for name in evidence.surfaces if name not in LARGEST_SURFACE_MISS]:
        raise FitError(
            f"a face has no surface {listed(unknown)}, expected some of {listed(LARGEST_SURFACE_MISS)}"
        )
    fitted = fit_face(
        face, evidence.landmarks, **evidence.surfaces, unit=evidence.unit,
        on_face=evidence.places, rim=evidence.rim, noise=evidence.noise, thickness=evidence.thickness,
        courses=evidence.courses, volumes=evidence.volumes, name=evidence.name,
        simulated=evidence.simulated, progress=progress,
    )  # fmt: skip
    return FittedModel(
        fitted.face, (*fitted.notes, *summary(fitted)), partial(write_report, fitted)
    )


def describe(face: xr.Dataset) -> str:
    """Describe a face."""
    return (
        f"{face.attrs['name']}, {face.attrs['origin']}: {face.sizes['node']} nodes, "
        f"{face.sizes['element']} elements, {int((face['fixed'] > 0).sum())} fixed nodes"
    )


def move(face: xr.Dataset, drive: Drive, progress: Progress) -> Moved:
    """Simulate a face by an activation, a recording or levels of muscles."""
    import emgface as ef

    step: dict[str, Any] = {} if drive.step is None else {"step": drive.step}
    given, choices = activation_for(face, drive), parameters_of(drive.settings, step)
    return Moved(ef.simulate(given, face, accuracy=drive.accuracy, progress=progress, **choices))


def parameters_of(settings: Mapping[str, str], given: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of a simulation: `given` ones by name, and settings such as ``contact.method=none``.

    Names and values of settings are those of the table ``[simulation]`` of a study file. Raises
    ConfigurationError for an unknown name, with the nearest one, and for one that is specified twice.
    """
    from emgface.api.given import merged
    from emgface.face.simulation_parameters import SimulationParameters
    from emgface.texts import value_of_toml

    parameters: dict[str, Any] = dict(given)
    for name, text in settings.items():
        first, *rest = name.split(".")
        if first not in SimulationParameters.model_fields:
            configure(SimulationParameters, {first: text}, where=f"--set {name}")
        if first in given:
            raise ConfigurationError(
                f"{first} is specified by --set {name}={text} and by another option, expected one of "
                "them: leave one out"
            )
        value: Any = value_of_toml(text)
        for part in reversed(rest):
            value = {part: value}
        parameters = merged(parameters, {first: value})
    return parameters


def activation_for(face: xr.Dataset, drive: Drive) -> xr.Dataset:
    """Activation of a file, of a recording, or of levels that are reached within `LEVELS_RISE`.

    Raises ConfigurationError if options of a recording are specified for an activation.
    """
    import emgface as ef
    from emgface.schema.netcdf import open_netcdf, read_netcdf

    path = Path(drive.source)
    if not names_file(drive.source):
        refuse_unused(drive, ("study",), "levels of muscles")
        return constant_activation(face, levels_of(drive.source, DEFAULT_LEVEL), drive.duration)
    if drive.duration is not None:
        raise ConfigurationError(
            f"--duration {drive.duration:g} cannot be applied to {path.name}, whose times are its own, "
            "expected levels of muscles with it: leave it out, or cut the recording"
        )
    if path.suffix.lower() == ".nc":
        with open_netcdf(path) as opened:
            is_activation = "activation" in opened.variables
        if is_activation:
            refuse_unused(drive, ("study",), "an activation")
            return read_netcdf(path, "activation")
    return ef.activate(path, **drive.recorded)


def constant_activation(
    face: xr.Dataset, levels: Mapping[str, float], duration: float | None = None
) -> xr.Dataset:
    """Activation (muscle, time) that rises within `LEVELS_RISE` to the levels [1] of some muscles.

    `duration` [s] is `LEVELS_DURATION` by default. Raises ConfigurationError if the face lacks a
    muscle, a level is not from 0 to 1, or the duration is not above 0.
    """
    duration = LEVELS_DURATION if duration is None else float(duration)
    if not 0.0 < duration < np.inf:
        raise ConfigurationError(f"the duration is {duration:g} s, expected a number above 0")
    muscles = face["muscle"].values.tolist()
    if unknown := [name for name in levels if name not in muscles]:
        raise ConfigurationError(
            f"the face has no muscle {unknown[0]!r}, expected one of {', '.join(muscles)}"
        )
    for name, level in levels.items():
        if not isinstance(level, int | float | np.number) or not 0.0 <= level <= 1.0:
            raise ConfigurationError(
                f"the level of {name} is {level!r}, expected a number from 0 to 1"
            )
    time = np.linspace(0.0, duration, max(2, round(duration / 0.01) + 1))
    values = np.outer(
        [levels.get(name, 0.0) for name in muscles], np.clip(time / LEVELS_RISE, 0.0, 1.0)
    )
    return xr.Dataset(
        {"activation": (("muscle", "time"), values, {"units": "1"})},
        coords={"muscle": muscles, "time": ("time", time, {"units": "s"})},
        attrs={"origin": "simulated", "strategy": "constant levels"},
    )


def write_motion(motion: xr.Dataset, face: xr.Dataset, path: Path) -> Path:
    """Write a trajectory."""
    from emgface.schema.netcdf import write_netcdf

    return write_netcdf(motion, path, "trajectory")


def check(face: xr.Dataset) -> list[tuple[str, pd.DataFrame]]:
    """Counts and measures of a face and of its muscles; FaceError if it cannot be simulated."""
    from emgface.face.check import face_report

    report = face_report(face)
    name = f"{face.attrs['name']} ({face.attrs['origin']})"
    return [(name, report.summary), ("muscles, volumes in mm3", report.muscles)]


def table(
    face: xr.Dataset, settings: Mapping[str, str], progress: Progress
) -> tuple[str, pd.DataFrame]:
    """Raise ConfigurationError: a face has no tasks."""
    raise ConfigurationError(
        "a face has no tasks, expected a jaw or a tongue: use 'emgface check' for its measures"
    )


def scored(
    recording: xr.Dataset, motion: Path, options: Mapping[str, Any]
) -> tuple[xr.Dataset, pd.DataFrame, str]:
    """Score the lip markers of a motion."""
    import emgface as ef

    scores = ef.score(recording, motion, face=options.get("face"), study=options.get("study"))
    return scores, scores[["rho", "amplitude_ratio", "rmse"]].to_dataframe().reset_index(), ""


__all__ = [
    "activation_for",
    "build",
    "check",
    "describe",
    "fit",
    "import_",
    "move",
    "read",
    "scored",
    "table",
    "write",
    "write_motion",
]
