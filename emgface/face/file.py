"""Write and read faces as netCDF files, with checks."""

import os
from pathlib import Path

import xarray as xr

from emgface.errors import DataError, FaceError
from emgface.face.validity import check_face
from emgface.files import existing_file, replace_file
from emgface.schema.rules import one_line


def save_face(ds: xr.Dataset, path: str | os.PathLike[str]) -> Path:
    """Check a face and write it as netCDF; an existing file is replaced only on success.

    Raises FaceError, SchemaError or UnitsError as `check_face`, or FaceError if it cannot be
    written.
    """
    ds = check_face(ds)
    path = Path(path)
    encoding = {str(name): {"zlib": True, "complevel": 4} for name in ds.data_vars}
    try:
        replace_file(path, lambda part: ds.to_netcdf(part, engine="netcdf4", encoding=encoding))
    except DataError as error:
        raise FaceError(str(error)) from error
    return path


def load_face(path: str | os.PathLike[str]) -> xr.Dataset:
    """Read a face_model netCDF into memory and check it.

    Raises FaceError if the file is absent, truncated or not netCDF, and errors of `check_face`.
    """
    path = existing_file(path, "a face of 'emgface build face' or 'emgface import face'", FaceError)
    try:
        with xr.open_dataset(path, engine="netcdf4") as opened:
            ds = opened.load()
    except (OSError, RuntimeError, ValueError) as error:
        raise FaceError(
            f"{path} cannot be read as netCDF ({one_line(error)}): it is truncated or of "
            "another format, write it again"
        ) from error
    return check_face(ds)
