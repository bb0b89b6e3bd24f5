"""NetCDF files written by `emgface.recordings.dataset.write_recording`."""

from collections.abc import Mapping
from pathlib import Path

import xarray as xr

from emgface.errors import DataError
from emgface.schema.netcdf import open_netcdf, read_netcdf

SUFFIXES = (".nc",)
FORMAT = "netCDF of this package"


def is_recording(path: Path) -> bool:
    """Return False for a netCDF file of another kind; a damaged one may be a recording.

    Parameters
    ----------
    path : Path
        File with a suffix of `SUFFIXES`.

    Returns
    -------
    bool
        False if the file declares another kind of dataset.
    """
    try:
        with open_netcdf(path) as opened:
            return getattr(opened, "schema", "recording") == "recording"
    except DataError:
        return True


def read(path: Path, units: Mapping[str, str]) -> xr.Dataset:
    """Read a recording.

    Parameters
    ----------
    path : Path
        File to read.
    units : mapping of str to str
        Not needed: the format holds SI units.

    Returns
    -------
    xarray.Dataset
        The recording as it was written.

    Raises
    ------
    DataError
        If the file is truncated, no netCDF, or no recording.
    """
    return read_netcdf(path, "recording")
