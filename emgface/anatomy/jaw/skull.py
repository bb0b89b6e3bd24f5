"""Positions relative to a skull that is turned as prescribed."""

import numpy as np
import xarray as xr

from emgface.anatomy.jaw.model import Floats


def rotated(q: Floats, x: Floats) -> Floats:
    """Vectors (..., 3) turned by unit quaternions (..., 4), scalar first."""
    w, r = q[..., :1], q[..., 1:]
    t = 2.0 * np.cross(r, x)
    return np.asarray(x + w * t + np.cross(r, t), dtype=np.float64)


def in_skull(motion: xr.Dataset, x: Floats) -> Floats:
    """Positions (time, 3) of a motion with a moving skull, as if it had stayed [m]."""
    skull = motion.sel(body="skull")
    q = skull["body_quaternion"].transpose("time", "part").values
    return rotated(
        q * [1.0, -1.0, -1.0, -1.0], x - skull["body_position"].transpose("time", "axis").values
    )
