"""The parts that every reader of a foreign format assembles into a recording."""

import json
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from emgface.errors import DataError
from emgface.muscles import AXES
from emgface.units import to_si


def emg_array(values: np.ndarray, labels: Sequence[str], time: np.ndarray, unit: str) -> xr.Dataset:
    """Return EMG in volts.

    Parameters
    ----------
    values : ndarray, shape (channels, samples)
        Samples in `unit`.
    labels : sequence of str
        One per channel, each once.
    time : ndarray, shape (samples,)
        Instants [s].
    unit : str
        Unit of the values, in any known spelling.

    Returns
    -------
    xarray.Dataset
        ``emg(channel, time_emg)`` [V].

    Raises
    ------
    UnitsError
        If the unit is absent or no voltage.
    """
    coords = {"channel": list(labels), "time_emg": ("time_emg", time, {"units": "s"})}
    array = xr.DataArray(values, coords, ("channel", "time_emg"), "emg", {"units": unit})
    return to_si(array, "voltage").to_dataset()


def position_array(
    values: np.ndarray, labels: Sequence[str], time: np.ndarray, unit: str
) -> xr.Dataset:
    """Return marker positions in metres.

    Parameters
    ----------
    values : ndarray, shape (markers, 3, frames)
        Positions in `unit`; NaN where a marker was not seen.
    labels : sequence of str
        One per marker, each once.
    time : ndarray, shape (frames,)
        Instants [s].
    unit : str
        Unit of the values, in any known spelling.

    Returns
    -------
    xarray.Dataset
        ``position(marker, axis, time_marker)`` [m].

    Raises
    ------
    UnitsError
        If the unit is absent or no length.
    """
    coords = {
        "marker": list(labels),
        "axis": list(AXES),
        "time_marker": ("time_marker", time, {"units": "s"}),
    }
    dims = ("marker", "axis", "time_marker")
    array = xr.DataArray(values, coords, dims, "position", {"units": unit})
    return to_si(array, "length").to_dataset()


def assemble(
    parts: Sequence[xr.Dataset],
    *,
    original_names: Mapping[str, str],
    original_units: Mapping[str, str],
    dropped: Mapping[str, str],
    origin: str = "measured",
) -> xr.Dataset:
    """Unite EMG and positions, with the record of what the file held.

    Parameters
    ----------
    parts : sequence of xarray.Dataset
        Results of `emg_array` and `position_array`.
    original_names : mapping of str to str
        Name here to label in the file, where they differ.
    original_units : mapping of str to str
        Variable to its unit in the file.
    dropped : mapping of str to str
        What the file held and the recording does not, with the reason.
    origin : str
        ``measured`` or ``simulated``.

    Returns
    -------
    xarray.Dataset
        The recording.

    Raises
    ------
    DataError
        If there is no part.
    """
    if not parts:
        reasons = "; ".join(f"{name}: {why}" for name, why in list(dropped.items())[:3])
        raise DataError(
            f"The file holds neither EMG nor markers{f' ({reasons})' if reasons else ''}; "
            "expected at least one of them: see whether it is the right file."
        )
    united = xr.merge(parts)
    notes = {
        "original_names": original_names,
        "original_units": original_units,
        "dropped": dropped,
    }
    united.attrs = {"origin": origin}
    for name, value in notes.items():
        united.attrs[name] = json.dumps(dict(value), ensure_ascii=False)
    return united


def unique_labels(labels: Sequence[str], stem: str) -> tuple[list[str], dict[str, str]]:
    """Return labels stripped, named where empty, and numbered where repeated.

    Parameters
    ----------
    labels : sequence of str
        Labels of a file.
    stem : str
        Name for those that are empty.

    Returns
    -------
    list of str
        One label each, no two alike.
    dict of str to str
        New label to the one in the file, where they differ.
    """
    result: list[str] = []
    changed: dict[str, str] = {}
    for number, label in enumerate(labels, start=1):
        plain = label.strip() or f"{stem} {number}"
        name, again = plain, 2
        while name in result:
            name, again = f"{plain} ({again})", again + 1
        result.append(name)
        if name != label:
            changed[name] = label
    return result, changed
