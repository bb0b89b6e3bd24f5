"""Face model of a study."""

from functools import lru_cache
from pathlib import Path

import xarray as xr

from emgface.anatomy.head.model import Head, read_head, require_face_and_jaw
from emgface.face.file import load_face
from emgface.face.template import template_face
from emgface.study.configuration import FaceConfiguration, TemplateParameters


def study_face(configuration: FaceConfiguration) -> xr.Dataset:
    """Load the face of a study or of its head, or generate the template, which is the default.

    Raises FaceError, SchemaError or UnitsError if the file is absent or does not contain a valid
    face, or the template cannot be generated; HeadError if a head has no face or no jaw.
    """
    if configuration.head is not None:
        return study_head(configuration.head).parts["face"]
    if configuration.path is not None:
        return load_face(configuration.path)
    template = configuration.template or TemplateParameters()
    return _generated(template.model_dump_json()).copy(deep=True)


def study_head(path: Path) -> Head:
    """Read a head with face and jaw; HeadError if it lacks one."""
    head = read_head(path)
    require_face_and_jaw(head)
    return head


@lru_cache(maxsize=4)
def _generated(parameters: str) -> xr.Dataset:
    """Template face; those of the last studies are kept, since several steps of a study use it."""
    return template_face(**TemplateParameters.model_validate_json(parameters).model_dump())
