"""Face model of a study."""

import xarray as xr

from emgface.face.file import load_face
from emgface.face.template import template_face
from emgface.study.configuration import FaceConfiguration, TemplateParameters


def study_face(configuration: FaceConfiguration) -> xr.Dataset:
    """Load the face of a study, or generate the template.

    Parameters
    ----------
    configuration : FaceConfiguration
        File or template; the template with its defaults when neither is given.

    Returns
    -------
    Dataset
        Checked face model.

    Raises
    ------
    FaceError, SchemaError, UnitsError
        If the file is absent, damaged or no usable face, or no template can be made.
    """
    if configuration.path is not None:
        return load_face(configuration.path)
    template = configuration.template or TemplateParameters()
    return template_face(**template.model_dump())
