"""The face that a study simulates."""

import xarray as xr

from emgface.face.block import block_face
from emgface.face.model import load_face
from emgface.face.template import template_face
from emgface.study.configuration import BlockParameters, FaceConfiguration


def study_face(configuration: FaceConfiguration) -> xr.Dataset:
    """Load the face of a study, or generate the template or the block.

    Parameters
    ----------
    configuration : FaceConfiguration
        File, template or block; the block when none is given.

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
    if configuration.template is not None:
        return template_face(**configuration.template.model_dump())
    b = configuration.block or BlockParameters()
    return block_face(size=(b.width, b.depth, b.height), cells=(b.cells_width, b.cells_height))
