"""NetCDF files written by `emgface.recordings.dataset.write_recording`."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from emgface.errors import DataError, UnitsError, listed
from emgface.recordings.findings import Kind, with_findings
from emgface.recordings.timebase import TimeBase, of_stamps
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
    """Read a recording as it was written, in SI units; gaps in its times are NaN.

    Raises UnitsError if `units` is not empty, because every variable of the file states its unit.
    """
    if units:
        raise UnitsError(
            f"{path.name} states its units, and a mapping specifies that of {listed(units)}; expected "
            "one statement: remove the table 'units' from the mapping."
        )
    recording = read_netcdf(path, "recording")
    clocks: tuple[tuple[str, Kind], ...] = (("time_emg", "channel"), ("time_marker", "marker"))
    for dim, kind in clocks:
        if recording.sizes.get(dim, 0) > 1 and dim in recording.coords:
            base = of_stamps(f"{path.name}, {dim}", recording[dim].values)
            recording = _laid(recording, dim, base)
            recording = with_findings(recording, base.findings(kind))
    return recording


def _laid(recording: xr.Dataset, dim: str, base: TimeBase) -> xr.Dataset:
    """Lay a recording at the instants of a time base, NaN in its gaps."""
    attrs = recording[dim].attrs
    if base.gaps or not np.array_equal(base.order, np.arange(base.stored)):
        recording = recording.isel({dim: base.order}).assign_coords({dim: base.places})
        recording = recording.reindex({dim: np.arange(base.times.size)})
    return recording.assign_coords({dim: (dim, base.times, attrs)})
