"""Positions of a template face by its structure."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray


def sheets(face: xr.Dataset) -> NDArray[np.float64]:
    """Positions over ray, ring and sheet."""
    rays, rings = face.attrs["rays"], face.attrs["rings"]
    return face["position"].values.reshape(rays, rings + 1, 4, 3)
