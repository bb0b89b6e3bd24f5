"""Steps of the signal chain under the names that they had in version 0.1.

The accessor was called ``emg`` and hid the variable of this name. It is now ``semg``;
``recording.emg`` is the variable. Former scripts call steps on it, or on the accessor ``emg`` of an
array; both work, with a warning.
"""

from typing import Any, Final

import xarray as xr

from emgface.deprecation import Former

SEMG: Final = Former("the accessor .emg", ".semg", "0.2", "0.4")


def former(array: xr.DataArray, name: str) -> Any:
    """Return the accessor (``emg``) or one of its steps, with a warning at the line of the user."""
    SEMG.warn(stacklevel=4)  # above this function and those of xarray
    steps: Any = array.semg  # pyright: ignore[reportAttributeAccessIssue]
    return steps if name == "emg" else getattr(steps, name)
