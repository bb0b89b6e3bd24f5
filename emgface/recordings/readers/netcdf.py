"""NetCDF files written by `emgface.recordings.dataset.write_recording`."""

from collections.abc import Mapping
from pathlib import Path

import xarray as xr

from emgface.errors import DataError
from emgface.schema.netcdf import open_netcdf, read_netcdf

SUFFIXES = (".nc",)
FORMAT = "netCDF of this package"


def is_recording(path: Path) -> bool:
    """Return False for a netCDF file that declares another kind of dataset."""
    try:
        with open_netcdf(path) as opened:
            return getattr(opened, "schema", "recording") == "recording"
    except DataError:
        return True


def read(path: Path, units: Mapping[str, str]) -> xr.Dataset:
    """Read a recording as it was written, in SI units."""
    return read_netcdf(path, "recording")
