"""Heads of face, jaw, tongue and hyoid as a kind of model (`emgface.models.kinds.Functions`)."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from emgface.anatomy.head.model import PARTS, Head
from emgface.anatomy.head.model import read_head as read
from emgface.anatomy.head.model import write_head as write
from emgface.errors import HeadError
from emgface.models.kinds import (
    Drive,
    Evidence,
    FittedModel,
    Moved,
    Person,
    Progress,
    chosen,
    error_of,
    levels_of,
    names_file,
    refuse_unused,
    tolerance_of,
)


def build(person: Person) -> Head:
    """Generate the head of a person."""
    from emgface.anatomy.head.build import build_head
    from emgface.anatomy.jaw.template.measures import parse_settings
    from emgface.face.template.muscles import parse_ring
    from emgface.models.kinds import kind_named

    return build_head(
        list(person.parts or PARTS),
        preset=person.preset,
        seed=person.seed,
        measures=parse_settings(list(person.measures)),
        resolution=person.resolution or "coarse",
        contacts=None if person.contacts is None else list(person.contacts),
        rings={muscle: parse_ring(words) for muscle, words in (person.rings or {}).items()},
        models={
            part: kind_named(part).functions.read(path)
            for part, path in (person.models or {}).items()
        },
    )


def import_(folder: Path, settings: Mapping[str, str]) -> Head:
    """Import the published coupled head.

    Settings are ``parts`` and ``contacts``, names separated by commas or "none", and ``floor``.
    """
    from emgface.anatomy.head.published import import_head

    names = {
        name: [] if text == "none" else [one.strip() for one in text.split(",")]
        for name, text in settings.items()
        if name in ("parts", "contacts")
    }
    rest = {name: text for name, text in settings.items() if name not in names}
    return import_head(folder, **names, **chosen(import_head, rest, "floor"))


def fit(head: Head, evidence: Evidence, progress: Callable[[str, int, int], None]) -> FittedModel:
    """Raise HeadError: a head is composed of fitted parts."""
    raise HeadError(
        "a head is not fitted as a whole, expected its parts: fit face, jaw and tongue, and compose "
        "them by 'emgface build head --model face=FILE --model jaw=FILE --model tongue=FILE'"
    )


def describe(head: Head) -> str:
    """Describe a head."""
    own = head.lists
    return (
        f"{own.attrs['name']}: {own.sizes['muscle']} muscles, "
        f"{own.sizes['attachment']} attached nodes ({', '.join(own['pair'].values) or 'none'}), "
        f"contact of {', '.join(own['contact'].values) or 'nothing'}"
    )


def _settings(law: str = "peck", gravity: bool = True) -> None:
    """Stand for the settings of `simulate_head` that a command may change."""


def check(model: Any) -> list[tuple[str, pd.DataFrame]]:
    """Return no table: reading has checked the model."""
    return []


def move(head: Head, drive: Drive, progress: Progress) -> Moved:
    """Move a head by excitations of its muscles, or by a recording of face and jaw.

    Settings are the muscle ``law`` of the jaw and ``gravity``. The lips and the incisor of a recording
    are scored.
    """
    from emgface.anatomy.head.run import HEAD_OUTPUT, raised, simulate_head
    from emgface.anatomy.jaw.series import duration_of, read_excitation

    path, tolerance = Path(drive.source), tolerance_of(drive.accuracy)
    step: dict[str, Any] = {} if drive.step is None else {"step": drive.step}
    if (is_file := names_file(drive.source)) and _is_recording(path):
        return _followed(head, path, drive, progress)
    refuse_unused(drive, (), "excitations of a head")
    if is_file:
        excitation, task = read_excitation(path), path.stem
        duration = duration_of(excitation, HEAD_OUTPUT, drive.duration)
    else:
        levels = levels_of(drive.source, 0.3)
        jaw = "bi_close" in head.lists["exciter"].values
        excitation, task = raised(levels, jaw=jaw), " and ".join(levels) or "rest"
        duration = 0.5 if drive.duration is None else drive.duration
    options = chosen(_settings, drive.settings, "law", "gravity")
    motion = simulate_head(
        head, excitation, duration=duration, tolerance=tolerance, progress=progress,
        **options, **step,
    )  # fmt: skip
    motion.attrs["task"] = task
    return Moved(motion, [error_of(motion, tolerance)])


def _is_recording(path: Path) -> bool:
    """Return True for a file that is not one of excitations."""
    from emgface.schema.netcdf import kind_of

    if path.suffix.lower() != ".nc":
        return path.suffix.lower() != ".csv" or path.with_suffix(".toml").is_file()
    return kind_of(path) == "recording"


def _followed(head: Head, path: Path, drive: Drive, progress: Progress) -> Moved:
    """Motion by a recording, and its scores."""
    from emgface.anatomy.head.recorded import RecordedDrive as Recorded
    from emgface.anatomy.head.recorded import move_as_recorded, score_head
    from emgface.api.given import recording_of, study_of

    chosen(_followed, drive.settings)
    used = ("mapping", "reference", "study", "strategy", "instruction")
    refuse_unused(drive, used, "a recording that moves a head")
    recorded = drive.recorded
    given = recording_of(path, recorded.get("mapping"))
    efforts = [
        recording_of(one, recorded.get("mapping")) for one in recorded.get("reference") or ()
    ]
    how = Recorded(
        study_of(recorded.get("study")),
        recorded.get("strategy"),
        recorded.get("instruction"),
        efforts,
    )
    step: dict[str, Any] = {} if drive.step is None else {"step": drive.step}
    tolerance = tolerance_of(drive.accuracy)
    motion = move_as_recorded(given, head, how, tolerance=tolerance, progress=progress, **step)
    motion.attrs["task"] = path.stem
    notes = [error_of(motion, tolerance)]
    if "position" not in given:
        return Moved(motion, notes)
    return Moved(
        motion, notes, [("Scores, rmse in mm", rows(score_head(given, motion, head, how)))]
    )


def rows(scores: xr.Dataset) -> pd.DataFrame:
    """Table of the scores of the markers, rmse in mm."""
    by_marker = scores[["rho", "amplitude_ratio", "rmse"]].to_dataframe().reset_index()
    return by_marker.assign(rmse=1e3 * by_marker["rmse"])


def write_motion(motion: xr.Dataset, head: Head, path: Path) -> object:
    """Write the motion of a head with its parts."""
    from emgface.anatomy.head.run import write_motion as write_of

    return write_of(motion, head, path)


def table(head: Head, settings: Mapping[str, str], progress: Progress) -> tuple[str, pd.DataFrame]:
    """Raise HeadError: the runs of a head are those of a plan."""
    raise HeadError(
        "the runs of a head are those of a plan, expected one: use 'emgface sweep PLAN'"
    )


def scored(
    recording: xr.Dataset, motion: Path, options: Mapping[str, Any]
) -> tuple[xr.Dataset, pd.DataFrame, str]:
    """Score the lips and the incisor of a motion."""
    from emgface.anatomy.head.recorded import RecordedDrive as Recorded
    from emgface.anatomy.head.recorded import score_head
    from emgface.anatomy.head.run import read_motion
    from emgface.api.given import study_of

    moved, _ = read_motion(motion)
    scores = score_head(
        recording, moved, read(Path(options["model"])), Recorded(study_of(options.get("study")))
    )
    return scores, rows(scores), ""


__all__ = [
    "build", "check", "describe", "fit", "import_", "move", "read", "scored", "table", "write",
    "write_motion",
]  # fmt: skip
