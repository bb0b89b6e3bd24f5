"""Face model of a study, one for all volunteers or one for each."""

from collections.abc import Iterable
from functools import lru_cache
from glob import escape
from pathlib import Path

import xarray as xr

from emgface.anatomy.head.model import Head, read_head, require_face_and_jaw
from emgface.errors import FaceError, listed
from emgface.face.file import load_face
from emgface.face.template import template_face
from emgface.files import named_file
from emgface.study.configuration import VOLUNTEER, FaceConfiguration, TemplateParameters


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
    if found := sorted(path for path in folder.glob(wanted) if path.is_file()):
        return found[0]
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
