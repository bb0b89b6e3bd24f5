"""Steps of the signal chain under the names that they had in version 0.1, for one release.

The accessor was called ``emg`` and hid the variable of this name. It is now ``semg``;
``recording.emg`` is the variable. Former scripts call steps on it, or on the accessor ``emg`` of an
array; both work, with a warning.
"""

import warnings
from typing import Any

import xarray as xr


def former(array: xr.DataArray, name: str) -> Any:
    """Return the accessor (``emg``) or one of its steps, with a warning at the line of the user."""
    what = "the accessor emg" if name == "emg" else f"the accessor with the step {name}"
    warnings.warn(
        f"{what} is called semg since version 0.2: write .semg instead of .emg",
        DeprecationWarning,
        stacklevel=4,  # above this function and those of xarray
    )
    steps: Any = array.semg  # pyright: ignore[reportAttributeAccessIssue]
    return steps if name == "emg" else getattr(steps, name)
