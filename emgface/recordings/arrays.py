"""Variables of MATLAB and HDF5 files, and selection of the one that contains the recording."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from emgface.errors import DataError, listed
from emgface.recordings.draft import Draft
from emgface.recordings.readers._arrays import read_array, read_texts
from emgface.recordings.readers._declared import declared_voltage, rates_of, statements_near
from emgface.recordings.readers._isolated import parsed
from emgface.recordings.readers._parsers import parse_contents
from emgface.schema.rules import hint

_LEAST: Final = 100  #: fewest samples of a recording


def array_table(
    path: Path, draft: Draft, variable: str | None, columns: Sequence[str] | None
) -> tuple[pd.DataFrame, float | None, str | None]:
    """Choose the variable of a file that contains the recording, one column per channel.

    `draft` is the sidecar that receives variable, dims and labels; `variable` and `columns`
    (labels) are specified if known. Returns in addition the sampling rate [Hz] and the unit of voltage,
    if a variable or attribute states it. Raises DataError if the file is damaged or contains no such
    array.
    """
    contents = parsed(path, parse_contents, path)
    arrays = {
        name: shape
        for name, (shape, kind) in contents["variables"].items()
        if kind in "iuf" and 1 <= len([n for n in shape if n > 1]) <= 2 and max(shape) >= _LEAST
    }
    if not arrays:
        raise DataError(
            f"{path.name} contains no array of two dims with {_LEAST} samples or more, found "
            f"{', '.join(contents['variables']) or 'no variable'}; expected time and channels."
        )
    if variable is not None and variable not in arrays:
        raise DataError(
            f"{path.name} has no array {variable!r}{hint(variable, arrays)}; found {listed(arrays)}."
        )
    name = variable or max(arrays, key=lambda key: _merit(path, key, arrays[key]))
    values = read_array(path, name).squeeze()
    transposed = values.ndim == 2 and values.shape[0] < values.shape[1]
    frame = pd.DataFrame(values.T if transposed else values)
    sure = variable is not None or len(arrays) == 1
    draft.put(
        "variable", name, "" if sure else "the largest array that varies", table="emg", sure=sure
    )
    others = [f"{key} {shape}" for key, shape in arrays.items() if key != name]
    if others:
        draft.lines.append(f"# other arrays in the file: {listed(others)}")
    draft.put("dims", ["channel", "time"] if transposed else ["time", "channel"])
    frame.columns = _labels(path, draft, name, columns, frame.shape[1], contents["variables"])
    rates = list(rates_of(contents["numbers"]).values())
    return frame, rates[0] if rates else None, declared_voltage(statements_near(path, name))


def _labels(
    path: Path,
    draft: Draft,
    name: str,
    columns: Sequence[str] | None,
    count: int,
    variables: Mapping[str, tuple[tuple[int, ...], str]],
) -> list[str]:
    """Labels of the columns: as specified, from a variable of texts, or numbers."""
    if columns is not None:
        if len(columns) != count:
            raise DataError(
                f"{path.name}: {name!r} has {count} columns and {len(columns)} labels were given; "
                "expected one for each."
            )
        draft.put("columns", list(columns))
        return list(columns)
    for key, (size, kind) in variables.items():
        if kind in "OUS" and int(np.prod(size)) == count:
            draft.put("columns_variable", key, table="emg", sure=False)
            return read_texts(path, key)
    labels = [f"channel {k + 1}" for k in range(count)]
    draft.put("columns", labels, "the file contains none", table="emg", sure=False)
    return labels


def _merit(path: Path, name: str, shape: tuple[int, ...]) -> tuple[bool, int, bool]:
    """Order of arrays: varying ones before constant ones and counters, then the largest."""
    step = np.diff(read_array(path, name, counts=True).squeeze(), axis=0)
    words = name.lower()
    return bool(np.ptp(step) > 0), int(np.prod(shape)), "emg" in words or "raw" in words
