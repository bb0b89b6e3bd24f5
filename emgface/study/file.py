"""File of a study: read and checked, its variants, paths and face, and a commented template.

Paths are relative to the file, also of a study whose folder was moved or copied.
"""

import json
import os
import textwrap
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from glob import escape
from itertools import product
from pathlib import Path
from typing import Any, Final, TypeVar, get_args, get_origin

import xarray as xr
from pydantic import BaseModel

from emgface.anatomy.head.model import Head, read_head, require_face_and_jaw
from emgface.choices import configure
from emgface.errors import ConfigurationError, DataError, FaceError, listed
from emgface.face.accuracy import SET_BY_ACCURACY
from emgface.face.file import load_face
from emgface.face.template import template_face
from emgface.files import existing_file, named_file
from emgface.recordings.exclusions import check_exclusions, read_exclusions
from emgface.run.state import read_state
from emgface.study.configuration import (
    CUBE_NAMES,
    VOLUNTEER,
    Axis,
    FaceConfiguration,
    Label,
    StudyConfiguration,
    TemplateParameters,
    Value,
)
from emgface.texts import read_toml


def load_study(path: Path) -> StudyConfiguration:
    """Read study.toml, with paths relative to its folder made absolute and its file of exclusions.

    Raises ConfigurationError if the file is missing or is not TOML, a parameter is unknown (with
    the nearest valid name) or a value is out of range.
    """
    existing_file(path, "a study file, as 'emgface study template' writes", ConfigurationError)
    study = configure(StudyConfiguration, read_toml(path), where=path.name)
    base = path.resolve().parent

    exclude = check_exclusions(study.exclude, where=path.name)
    study = with_paths(study, lambda given: base / given)
    if study.recordings.exclusions is not None:
        exclude += read_exclusions(study.recordings.exclusions)
    study = study.model_copy(update={"exclude": exclude})
    check_axes(study, where=path.name)
    return study


VARIED = ("signals", "simulation", "alignment", "score", "face")
"""Tables of a study file whose parameters may be varied."""


@dataclass(frozen=True)
class Variant:
    """One combination of levels and its study."""

    labels: tuple[Label, ...]
    study: StudyConfiguration

    @property
    def label(self) -> str:
        """Readable label."""
        return ", ".join(map(str, self.labels))


def check_axes(study: StudyConfiguration, *, where: str) -> None:
    """Raise ConfigurationError if an axis cannot be varied; `where` is the file, for messages.

    Refused are an axis without parameters or with fewer than two levels, a parameter that is
    unknown or must not be varied, a level of the wrong length, a name that is already used, and an
    invalid value.
    """
    taken: set[str] = set(CUBE_NAMES)
    for number, axis in enumerate(study.axis, 1):
        place = f"{where}: axis {number}"
        if not axis.parameters or len(axis.levels) < 2:
            raise ConfigurationError(
                f"{place} has {len(axis.parameters)} parameters and {len(axis.levels)} levels, "
                "expected at least one parameter and two levels"
            )
        for name in axis.parameters:
            if name.partition(".")[0] not in VARIED:
                raise ConfigurationError(
                    f"{place} varies {name!r}, expected a parameter of {', '.join(VARIED)} with "
                    "its table, such as 'simulation.sigma_max'"
                )
        for values in axis.values():
            if len(values) != len(axis.parameters):
                raise ConfigurationError(
                    f"{place} has a level of {len(values)} values, expected one for each of its "
                    f"{len(axis.parameters)} parameters"
                )
        if not axis.dim.isidentifier() or axis.dim in taken:
            raise ConfigurationError(
                f"{place} is called {axis.dim!r}, expected a name that is not used in the cube"
                f" ({', '.join(sorted(taken))}): set its name"
            )
        taken.add(axis.dim)
        if len(set(axis.labels())) < len(axis.labels()):
            raise ConfigurationError(
                f"{place} ({axis.dim}) contains a level twice: {', '.join(map(str, axis.labels()))}"
            )
    variants(study, where=where)


def variants(study: StudyConfiguration, *, where: str = "") -> list[Variant]:
    """Return the studies of all combinations of levels in the design, the reference first.

    A study without axes has one variant, itself. Raises ConfigurationError if a parameter does not
    exist or a value is invalid; `where` is the file, for messages.
    """
    counts = [range(len(axis.levels)) for axis in study.axis]
    if study.axis_design == "factorial":
        chosen = list(product(*counts))
    else:
        origin = (0,) * len(counts)
        chosen = [origin]
        for position, levels in enumerate(counts):
            chosen += [
                (*origin[:position], level, *origin[position + 1 :]) for level in levels if level
            ]
    return [_variant(study, index, where) for index in chosen]


def _variant(study: StudyConfiguration, index: tuple[int, ...], where: str) -> Variant:
    if not study.axis:
        return Variant((), study)
    values = study.model_dump(mode="python", exclude={"axis", "axis_design"})
    labels: list[Label] = []
    for axis, level in zip(study.axis, index, strict=True):
        labels.append(axis.labels()[level])
        for name, value in zip(axis.parameters, axis.values()[level], strict=True):
            _set(values, name.split("."), value)
            if name == "simulation.accuracy":
                # Validation sets these if they are not specified.
                for follows in SET_BY_ACCURACY:
                    values["simulation"].pop(follows)
    place = f"{where}: " if where else ""
    words = ", ".join(
        f"{axis.dim} = {label}" for axis, label in zip(study.axis, labels, strict=True)
    )
    made = configure(type(study), _plain(values), where=f"{place}{words}")
    return Variant(tuple(labels), made)


def _set(values: dict[str, Any], path: list[str], value: Value) -> None:
    for part in path[:-1]:
        # An optional table, such as face.template, may be absent.
        values[part] = dict(values.get(part) or {})
        values = values[part]
    values[path[-1]] = value


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    return {k: _plain(v) if isinstance(v, Mapping) else v for k, v in values.items()}


Model = TypeVar("Model", bound=BaseModel)

VARIED_FILES = ("face.path", "face.head", "simulation.reduced.file", "tract.areas")
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
    files = {k for k, name in enumerate(axis.parameters) if name in VARIED_FILES}
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
        reason = f"The study was moved or copied from {before}: "
        if new.exists() or (VOLUNTEER in str(new) and _folder(new).exists()):
            notes[f"{reason}{new} is used in place of {old}."] = None
            return new
        notes[f"{reason}{old} is used as before, because there is no {new}."] = None
        return old

    return with_paths(study, moved), list(notes)


SHORT_PARAMETERS: Final = (
    "schema_version", "name", "strategies", "recordings.folder", "recordings.mapping",
    "recordings.exclusions", "face.path", "face.head", "signals.filter.low", "signals.filter.high",
    "signals.feature.threshold", "signals.montage.missing_side", "signals.montage.missing_muscle",
    "signals.mapping.mapping_stage", "signals.mapping.oom", "signals.normalisation.reach",
    "signals.normalisation.silent", "simulation.accuracy", "simulation.sigma_max",
    "simulation.gravity", "simulation.sigma_max_policy.calibration", "simulation.contact.method",
    "alignment.scaling", "alignment.sign",
)  # fmt: skip
"""Parameters that the short study file contains: those that most studies have to decide."""


def study_template(
    study: StudyConfiguration | None = None, *, only: Collection[str] | None = None
) -> str:
    """TOML text of a study file with all parameters (default: their defaults) and descriptions.

    `only` are the names of parameters, such as "recordings.folder", to which it is restricted.
    Parameters and tables without a value are comments.
    """
    head = (
        "# A study: every parameter with its default, unit and source.\n"
        "# Lines with defaults may be removed.\n"
        if only is None
        else "# A study: the parameters that most studies decide, with default, unit and source.\n"
        "# 'emgface study template --all' lists every one; those that are absent have their default.\n"
    )
    return head + "\n".join(_table(study or StudyConfiguration(), "", only)) + "\n"


def _table(model: BaseModel, name: str, only: Collection[str] | None = None) -> list[str]:
    lines: list[str] = []
    prefix = f"{name}." if name else ""
    fields = {
        key: field
        for key, field in type(model).model_fields.items()
        if only is None or any(f"{one}.".startswith(f"{prefix}{key}.") for one in only)
    }
    rows_of = {key: _row(model, key) for key in fields if _row(model, key) is not None}
    tables = {key: _nested(model, key) for key in fields if _nested(model, key) is not None}
    if name:
        lines += [f"[{name}]"]
    for key, field in fields.items():
        if key in tables or key in rows_of:
            continue
        value = getattr(model, key)
        comment = textwrap.wrap(field.description or "", 96)
        lines += [f"# {line}" for line in comment]
        lines += [f"# {key} =" if value is None else f"{key} = {_value(value)}", ""]
    for key, nested in tables.items():
        path = f"{name}.{key}" if name else key
        title = textwrap.wrap(fields[key].description or "", 96)
        rows = _table(nested, path, only)
        if getattr(model, key) is None:
            rows = [row if row.startswith("#") or not row else f"# {row}" for row in rows]
        lines += ["", *(f"# {line}" for line in title), *rows]
    for key, empty in rows_of.items():
        lines += ["", *(f"# {line}" for line in textwrap.wrap(fields[key].description or "", 96))]
        given = getattr(model, key)
        for row in given or (empty,):
            rows = [f"[[{name}.{key}]]" if name else f"[[{key}]]", *_table(row, "")]
            lines += rows if given else [f"# {r}" if r and r[0] != "#" else r for r in rows]
    return lines


def _row(model: BaseModel, key: str) -> Any:
    """Defaults of one row of an array of tables; None for other fields."""
    annotation = type(model).model_fields[key].annotation
    first = (*get_args(annotation), None)[0] if get_origin(annotation) is tuple else None
    return first() if isinstance(first, type) and issubclass(first, BaseModel) else None


def _nested(model: BaseModel, key: str) -> Any:
    """Table of a name: its value, or the defaults of an optional one."""
    if isinstance(value := getattr(model, key), BaseModel):
        return value
    if _row(model, key) is not None:
        return None
    kinds = get_args(type(model).model_fields[key].annotation)
    return next((k() for k in kinds if isinstance(k, type) and issubclass(k, BaseModel)), None)


def _value(value: Any) -> str:
    if isinstance(value, Path):
        value = value.as_posix()
    if isinstance(value, dict):
        return "{" + ", ".join(f"{name} = {_value(one)}" for name, one in value.items()) + "}"
    return json.dumps(list(value) if isinstance(value, tuple) else value)


def study_face(configuration: FaceConfiguration) -> xr.Dataset:
    """Load the face of a study or of its head, or generate the template, which is the default.

    If every volunteer has a face, it is the first of their files by name, which stands for them in
    pictures. Raises FaceError, SchemaError or UnitsError if the file is absent or does not contain a
    valid face, or the template cannot be generated; HeadError if a head has no face or no jaw.
    """
    if configuration.head is not None:
        return study_head(configuration.head).parts["face"]
    if configuration.path is not None:
        if configuration.per_volunteer:
            return load_face(_first(configuration.path))
        return load_face(configuration.path)
    template = configuration.template or TemplateParameters()
    return _generated(template.model_dump_json()).copy(deep=True)


def volunteer_faces(
    configuration: FaceConfiguration, volunteers: Iterable[str]
) -> dict[str, xr.Dataset]:
    """Load the face of each volunteer; empty if all have that of the study.

    Raises FaceError, SchemaError or UnitsError if a file is absent or does not contain a valid face.
    """
    if not configuration.per_volunteer:
        return {}
    return {name: load_face(face_file(configuration, name)) for name in dict.fromkeys(volunteers)}


def face_file(configuration: FaceConfiguration, volunteer: str) -> Path:
    """File of the face of a volunteer, whose name is changed to that of a file if it is none."""
    assert configuration.path is not None
    name = named_file(Path(), volunteer, suffix="").name
    parts = [part.replace(VOLUNTEER, name) for part in configuration.path.parts]
    return Path(*parts)


def _first(pattern: Path) -> Path:
    """First file of a pattern, in the order of the names."""
    at = next(k for k, part in enumerate(pattern.parts) if VOLUNTEER in part)
    folder = Path(*pattern.parts[:at])
    wanted = "/".join(escape(part).replace(VOLUNTEER, "*") for part in pattern.parts[at:])
    if matches := sorted(path for path in folder.glob(wanted) if path.is_file()):
        return matches[0]
    raise FaceError(
        f"no file has the pattern {pattern}, expected a face of each volunteer: correct face.path "
        f"(files of {folder}: {listed([path.name for path in folder.glob('*')], 6) or 'none'})"
    )


def study_head(path: Path) -> Head:
    """Read a head with face and jaw; HeadError if it lacks one."""
    head = read_head(path)
    require_face_and_jaw(head)
    return head


@lru_cache(maxsize=4)
def _generated(parameters: str) -> xr.Dataset:
    """Template face; those of the last studies are kept, since several steps of a study use it."""
    return template_face(**TemplateParameters.model_validate_json(parameters).model_dump())
