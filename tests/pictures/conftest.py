"""A coarse face, and a motion of its surface that follows a formula."""

import numpy as np
import pytest
import xarray as xr

from emgface.pictures.body import skin_of
from emgface.pictures.surface import with_surface


@pytest.fixture(scope="session")
def face(coarse: xr.Dataset) -> xr.Dataset:
    return coarse


@pytest.fixture(scope="session")
def motion(face: xr.Dataset) -> xr.Dataset:
    """All of the face rises by 8 mm within 0.2 s."""
    skin, time = skin_of(face), np.arange(0.0, 0.201, 0.01)
    lift = np.outer(40e-3 * time, [0.0, 0.0, 1.0])[:, None]
    rest = face["position"].values
    lips = rest[face["marker_node"].values] + lift
    trajectory = xr.Dataset(
        {
            "position": (("marker", "axis", "time"), lips.transpose(1, 2, 0), {"units": "m"}),
            "surface_position": (("time", "surface_node", "axis"), rest[skin.node] + lift),
        },
        coords={
            "time": ("time", time, {"units": "s"}),
            "marker": face["marker"].values,
            "axis": ["x", "y", "z"],
        },
        attrs={"output": 0.01, "sigma_max": 100e3, "origin": "simulated", "instruction": "D",
               "volunteer": "S01", "recorded_start": 1.0, "recorded_pace": 1.0, "face": "template"},
    )  # fmt: skip
    return with_surface(trajectory, face, skin)
