"""Template faces that several tests read, and their mirror image."""

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from emgface.face.template import template_face


@pytest.fixture(scope="session")
def coarse() -> xr.Dataset:
    return template_face(resolution="coarse")


@pytest.fixture(scope="session")
def medium() -> xr.Dataset:
    return template_face(resolution="medium")


@pytest.fixture(scope="session")
def fine() -> xr.Dataset:
    return template_face(resolution="fine")


def sheets(face: xr.Dataset) -> NDArray[np.float64]:
    """Positions over ray, ring and sheet."""
    rays, rings = face.attrs["rays"], face.attrs["rings"]
    return face["position"].values.reshape(rays, rings + 1, 4, 3)
