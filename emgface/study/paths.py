"""Files that a study names: relative to its file, and of a study whose folder was moved or copied."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel

from emgface.errors import DataError
from emgface.run.state import read_state
from emgface.study.axes import Axis
from emgface.study.configuration import VOLUNTEER, StudyConfiguration

Model = TypeVar("Model", bound=BaseModel)

VARIED = ("face.path", "face.head", "simulation.reduced.file", "tract.areas")
"""Parameters of an axis that are files."""


def with_paths(study: StudyConfiguration, change: Callable[[Path], Path]) -> StudyConfiguration:
    """Replace every path of a study, also those of its axes, by a function of it."""
    axes = tuple(_axis(axis, change) for axis in study.axis)
    return _changed(study, change).model_copy(update={"axis": axes})


def _changed(model: Model, change: Callable[[Path], Path]) -> Model:
    update: dict[str, object] = {}
    for name in type(model).model_fields:
        value = getattr(model, name)
        if isinstance(value, Path):
            update[name] = change(value)
        elif isinstance(value, BaseModel):
            update[name] = _changed(value, change)
    return model.model_copy(update={k: v for k, v in update.items() if v != getattr(model, k)})


def _axis(axis: Axis, change: Callable[[Path], Path]) -> Axis:
    files = {k for k, name in enumerate(axis.parameters) if name in VARIED}
    rows = [
        tuple(str(change(Path(str(v)))) if k in files else v for k, v in enumerate(row))
        for row in axis.values()
    ]
    levels = tuple(row if len(axis.parameters) > 1 else row[0] for row in rows)
    return axis.model_copy(update={"levels": levels}) if files else axis


def _folder(pattern: Path) -> Path:
    """Folder of the files of a pattern, one for each volunteer."""
    while VOLUNTEER in str(pattern):
        pattern = pattern.parent
    return pattern


def placed(study: StudyConfiguration, folder: Path) -> tuple[StudyConfiguration, list[str]]:
    """Study with the paths that it has from `folder`, and one sentence for each that is another.

    `study` names files by the paths that they had when it ran. If its folder was moved or copied
    since, according to its journal, a file at the same relative path is used; one that does not
    exist there is looked for at its old path. The sentences name both.
    """
    try:
        before = next(
            (
                run.first["folder"]
                for run in reversed(read_state(folder).runs)
                if "folder" in run.first
            ),
            None,
        )
    except DataError:  # no journal
        before = None
    if before is None or Path(before) == folder.resolve():
        return study, []
    notes: dict[str, None] = {}

    def moved(old: Path) -> Path:
        new = Path(os.path.normpath(folder.resolve() / os.path.relpath(old, before)))
        if new == old:
            return old
        told = f"The study was moved or copied from {before}: "
        if new.exists() or (VOLUNTEER in str(new) and _folder(new).exists()):
            notes[f"{told}{new} is used in place of {old}."] = None
            return new
        notes[f"{told}{old} is used as before, because there is no {new}."] = None
        return old

    return with_paths(study, moved), list(notes)
