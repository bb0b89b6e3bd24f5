"""The face that a study simulates."""

import xarray as xr

from emgface.face.block import block_face
from emgface.face.model import load_face
from emgface.study.configuration import FaceConfiguration


def study_face(configuration: FaceConfiguration) -> xr.Dataset:
    """Load the face of a study, or generate the block.

    Parameters
    ----------
    configuration : FaceConfiguration
        File or block.

    Returns
    -------
    Dataset
        Checked face model.

    Raises
    ------
    FaceError, SchemaError, UnitsError
        If the file is absent, damaged or no usable face.
    """
    if configuration.path is not None:
        return load_face(configuration.path)
    b = configuration.block
    return block_face(size=(b.width, b.depth, b.height), cells=(b.cells_width, b.cells_height))
