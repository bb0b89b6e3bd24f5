"""Check a face, jaw or tongue by the kind of its file, and read it checked."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import xarray as xr

from emgface.anatomy.jaw.model import check_jaw
from emgface.anatomy.tongue.model import check_tongue
from emgface.face.validity import check_face
from emgface.schema.netcdf import read_netcdf

CHECKS: Final[Mapping[str, Callable[[xr.Dataset], xr.Dataset]]] = {
    "face_model": check_face,
    "jaw_model": check_jaw,
    "tongue_model": check_tongue,
}


def read_model(path: str | Path, kind: str, *, group: str | None = None) -> xr.Dataset:
    """Read a dataset of a kind, a model checked, from a group of a file if one is named.

    Raises errors as `emgface.schema.netcdf.read_netcdf` and the check of the kind.
    """
    return checked_model(read_netcdf(path, kind, group=group), kind)


def checked_model(dataset: xr.Dataset, kind: str) -> xr.Dataset:
    """Return a dataset after the check of its kind; kinds without one pass."""
    return CHECKS[kind](dataset) if kind in CHECKS else dataset
