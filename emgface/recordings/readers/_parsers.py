"""Contents of binary files as arrays and texts, read by compiled parsers.

The functions run in the child process of `emgface.recordings.readers._isolated`; this module
therefore imports only what a parser requires.
"""

from pathlib import Path
from typing import Any

import numpy as np

from emgface.errors import DataError

MOST_STATED = 512  #: most values of a variable or attribute that may describe another one
VALUES_PER_BYTE = 1100
"""Largest number of values per byte of a file; zeros are compressed to about 1/1030."""

_NEUTRAL = {
    "scale_factor": 1.0,
    "add_offset": 0.0,
    "conversion": 1.0,
    "offset": 0.0,
}
"""Attributes by which netCDF and NWB convert stored numbers, with the values that change nothing."""
_UNITS = ("units", "unit")


class AbsentVariable(LookupError):
    """A file has no such variable; ``args`` are the name and the existing names."""


class NotAnArray(LookupError):
    """A name refers to a group; ``args`` are the name and its members."""


def parse_c3d(path: Path) -> dict[str, Any]:
    """Return parameters, points and analog samples of a C3D file of checked structure, by ezc3d.

    The keys are ``parameters`` (group to name to value), ``points`` (4, points, frames), ``analogs``
    (1, channels, samples), ``residuals`` (1, points, frames) and ``first_frame``, counted from 0.
    """
    import ezc3d

    content = ezc3d.c3d(str(path))
    groups = content["parameters"]
    parameters = {
        group: {
            name: list(groups[group][name]["value"])
            for name in groups[group]
            if isinstance(groups[group][name], dict) and "value" in groups[group][name]
        }
        for group in groups
    }
    return {
        "parameters": parameters,
        "points": np.array(content["data"]["points"], dtype=np.float64),
        "analogs": np.array(content["data"]["analogs"], dtype=np.float64),
        "residuals": np.array(content["data"]["meta_points"]["residuals"], dtype=np.float64),
        "first_frame": int(content["header"]["points"]["first_frame"]),
    }


def parse_matlab(path: Path, name: str) -> Any:
    """Return a variable, or a field of one, of a MATLAB file before version 7.3.

    Raises AbsentVariable, or DataError if the array is larger than the file can contain.
    """
    import scipy.io

    head, *fields = name.split(".")
    listing: list[Any] = scipy.io.whosmat(str(path), appendmat=False)
    shapes: dict[str, tuple[int, ...]] = {str(row[0]): row[1] for row in listing}
    if head not in shapes:
        raise AbsentVariable(head, list(shapes))
    _require_room(path, head, shapes[head])
    # With mat_dtype, logical arrays are bool, also in structures, not numbers 0 and 1.
    value: Any = scipy.io.loadmat(
        str(path), appendmat=False, variable_names=[head], mat_dtype=True
    )[head]
    for field in fields:
        known = value.dtype.names or () if isinstance(value, np.ndarray) else ()
        if field not in known:
            raise AbsentVariable(field, list(known))
        value = value[field]
        # A single structure is an array of one object.
        while isinstance(value, np.ndarray) and value.dtype == object and value.size == 1:
            value = value.ravel()[0]
    if isinstance(value, np.ndarray) and value.dtype.names is not None:
        raise NotAnArray(name, list(value.dtype.names))
    if not isinstance(value, np.ndarray):
        raise DataError(
            f"{path.name}: {name!r} is a {type(value).__name__}; expected an array: save it as one."
        )
    return value


def parse_hdf5(
    path: Path, name: str, *, matlab: bool, texts: bool, unit: str = "", counts: bool = False
) -> Any:
    """Return a data set of an HDF5 file, with the order of dims of MATLAB if it wrote the file.

    Raises AbsentVariable, NotAnArray, or DataError if the array is larger than the file can
    contain, or its attributes contradict the `unit`, or state a conversion that the caller does not
    make; with `counts`, the caller converts the numbers of the file.
    """
    import h5py

    from emgface.schema.hdf5 import item_of, require_own_data

    with h5py.File(path, "r") as opened:
        try:
            where: Any = item_of(path, opened, name.replace(".", "/") if matlab else name)
        except KeyError as error:
            part, group = error.args
            names = [str(k) for k in group] if isinstance(group, h5py.Group) else []
            raise AbsentVariable(part, [k for k in names if not k.startswith("#")]) from None
        if not isinstance(where, h5py.Dataset):
            raise NotAnArray(name, [str(k) for k in where])
        if where.size is not None:
            _require_room(path, name, where.shape)
        if not texts and not counts:
            _require_plain_values(path, where, unit)
        value = where[()] if texts else _without_missing(where)
        if matlab and where.attrs.get("MATLAB_class") == b"logical":
            value = value.astype(bool)
        if texts and matlab and value.dtype.kind in "Ou":
            if value.dtype == object:  # references to arrays of characters
                file: Any = opened
                cells: list[Any] = []
                for reference in value.ravel(order="F"):
                    cell = file[reference]
                    require_own_data(path, cell)
                    _require_room(path, name, cell.shape)
                    cells.append(np.asarray(cell[()]))
            else:
                cells = list(np.atleast_2d(value.T))
            joined = ["".join(map(chr, cell.ravel(order="F"))) for cell in cells]
            return np.array(joined, dtype=object)
        if h5py.check_ref_dtype(where.dtype) is not None:  # not a number, and cannot be pickled
            return np.full(where.shape, "reference", dtype=object)
    return value.T if matlab and isinstance(value, np.ndarray) else value


def _without_missing(item: Any) -> Any:
    """Numbers of a data set, NaN where its attributes call them missing, by the CF conventions."""
    value = item[()]
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "iuf":
        return value
    stated = {
        key: np.ravel(item.attrs[key])
        for key in ("_FillValue", "missing_value", "valid_min", "valid_max", "valid_range")
        if key in item.attrs and np.asarray(item.attrs[key]).dtype.kind in "iuf"
    }
    low, high = stated.get("valid_range", np.array([-np.inf, np.inf]))[[0, -1]]
    low = max(low, *stated.get("valid_min", [-np.inf]), -np.inf)
    high = min(high, *stated.get("valid_max", [np.inf]), np.inf)
    missing = [one for key in ("_FillValue", "missing_value") for one in stated.get(key, ())]
    lost = np.isin(value, missing) | (value < low) | (value > high)
    return np.where(lost, np.nan, value) if lost.any() else value


def _require_plain_values(path: Path, item: Any, unit: str = "") -> None:
    """Raise DataError if attributes state a conversion of the numbers, or another unit than `unit`.

    Other programs multiply by them when they read the data set. A unit of another quantity, or one that
    is not known, is no contradiction.
    """
    for key, neutral in _NEUTRAL.items():
        value = item.attrs.get(key)
        if value is not None and not np.all(np.asarray(value) == neutral):
            raise DataError(
                f"{path.name}: {item.name!r} has the attribute {key} = {value}, by which its numbers "
                "are to be converted; expected `step` and `zero` in the sidecar, of which the value is "
                "step * (number - zero) in its unit."
            )
    for key in _UNITS if unit else ():
        stated = item.attrs.get(key)
        stated = stated.decode("utf-8", "replace") if isinstance(stated, bytes) else stated
        if isinstance(stated, str):
            _require_unit(path, item, key, stated, unit)


def _require_unit(path: Path, item: Any, key: str, stated: str, unit: str) -> None:
    from emgface.schema.units import quantity_of, spelling  # xarray, only where a unit is stated

    other = quantity_of(stated) is not None and spelling(stated) != spelling(unit)
    if other and quantity_of(stated) == quantity_of(unit):
        raise DataError(
            f"{path.name}: {item.name!r} is in {spelling(stated)} by its attribute {key}, and in "
            f"{spelling(unit)} by the sidecar; expected the same unit: correct the sidecar."
        )


def parse_contents(path: Path) -> dict[str, Any]:
    """Return the variables of a MATLAB or HDF5 file.

    ``variables`` contains shape and kind (``f``, ``i``, ``u``, ``O`` for texts) by name,
    ``numbers`` the variables and attributes that are a single number, ``statements`` the texts and
    numbers of those with few values.
    """
    statements: dict[str, list[float | str]] = {}
    variables: dict[str, tuple[tuple[int, ...], str]] = {}
    numbers: dict[str, float] = {}
    with path.open("rb") as stream:
        start = stream.read(520)
    if b"\x89HDF\r\n\x1a\n" in start or start.startswith(b"MATLAB 7.3"):
        import h5py

        matlab = start.startswith(b"MATLAB")

        from emgface.schema.hdf5 import require_own_data

        def visit(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset):
                require_own_data(path, item)
            for key, value in item.attrs.items():
                place = f"{name}/{key}".lstrip("/")
                statements[place] = _stated_values(value)
                if np.size(value) == 1 and np.asarray(value).dtype.kind in "iuf":
                    numbers[place] = float(np.ravel(value)[0])
            if isinstance(item, h5py.Dataset) and not name.startswith("#"):
                shape = tuple(reversed(item.shape)) if matlab else tuple(item.shape)
                kind = "O" if item.dtype.kind in "OSU" else item.dtype.kind
                variables[name] = (shape, kind)
                if item.size is not None and item.size <= MOST_STATED:
                    statements[name] = _stated_values(_characters(item) if matlab else item[()])
                if item.size == 1 and kind in "iuf":
                    numbers[name] = float(np.ravel(item[()])[0])

        with h5py.File(path, "r") as opened:
            visit("", opened)
            opened.visititems(visit)
        return {"variables": variables, "numbers": numbers, "statements": statements}
    import scipy.io

    kinds = {"cell": "O", "char": "U", "struct": "V", "logical": "b", "sparse": "V"}
    listing: list[Any] = scipy.io.whosmat(str(path), appendmat=False)
    for name, shape, kind in listing:
        variables[name] = (tuple(shape), kinds.get(kind, "f"))
    small = [name for name, shape, _ in listing if np.prod(shape) <= MOST_STATED]
    content = scipy.io.loadmat(str(path), appendmat=False, variable_names=small)
    for name, (shape, kind) in list(variables.items()):
        if name not in content:
            continue
        value = np.asarray(content[name])
        statements[name] = _stated_values(value)
        if int(np.prod(shape)) != 1:
            continue
        if kind == "f" and value.dtype.kind in "iuf":
            numbers[name] = float(value.ravel()[0])
        for part in value.dtype.names or ():  # a structure
            inner = np.asarray(value[part].ravel()[0])
            variables[f"{name}.{part}"] = (inner.shape, inner.dtype.kind)
            statements[f"{name}.{part}"] = _stated_values(inner)
            if inner.size == 1 and inner.dtype.kind in "iuf":
                numbers[f"{name}.{part}"] = float(inner.ravel()[0])
    return {"variables": variables, "numbers": numbers, "statements": statements}


def _stated_values(value: Any) -> list[float | str]:
    """Texts and finite numbers of a variable or attribute; empty for many or for other contents."""
    array = np.asarray(value)
    if array.dtype.names is not None or array.size > MOST_STATED:
        return []
    values: list[float | str] = []
    for item in array.ravel():
        if isinstance(item, np.ndarray):
            values += _stated_values(item)
        elif isinstance(item, bytes):
            values.append(item.decode("utf-8", "replace").strip("\x00 "))
        elif isinstance(item, str):
            values.append(item.strip())
        elif isinstance(item, np.number | np.bool_ | float | int) and np.isfinite(float(item.real)):
            values.append(float(item.real))
    return values


def _characters(item: Any) -> Any:
    """Value of a data set of MATLAB, a text if it contains characters, or the texts of a cell array."""
    import h5py

    value = item[()]
    if item.attrs.get("MATLAB_class") == b"char" and value.dtype.kind == "u":
        return "".join(map(chr, value.ravel(order="F")))
    if h5py.check_ref_dtype(item.dtype) is None:
        return value
    cells = [item.file[one] for one in value.ravel(order="F") if one]
    small = [c for c in cells if isinstance(c, h5py.Dataset) and (c.size or 0) <= MOST_STATED]
    return [str(_characters(cell)) for cell in small]


def _require_room(path: Path, name: str, shape: tuple[int, ...]) -> None:
    """Refuse an array that is larger than its file can contain."""
    if np.prod(np.array(shape, float)) > VALUES_PER_BYTE * path.stat().st_size:
        raise DataError(
            f"{path.name}: {name!r} has the shape {shape} in a file of {path.stat().st_size} "
            "bytes; expected an array no larger than the file: it is damaged."
        )


def parse_xdf(path: Path) -> list[dict[str, Any]]:
    """Return the streams of an XDF file, with synchronised clocks and the jitter of their times.

    The dict of each numeric stream contains ``name``, ``type``, ``rate`` (nominal [Hz]),
    ``announced`` (samples by the footer, None without one), ``channels`` (dicts of texts), ``values``
    (samples, channels) and ``time`` [s]; that of a stream of texts ``name``, ``texts`` and ``time``. The
    chunks of the file have been checked; ValueError is raised if a part cannot be read.
    """
    import logging

    import pyxdf

    errors: list[str] = []

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            errors.append(record.getMessage())

    # pyxdf omits parts that it cannot read and reports this by logging only.
    collector = Collector(logging.ERROR)
    logging.getLogger("pyxdf").addHandler(collector)
    try:
        # Fitting lines through the times would distribute lost samples over the recording.
        streams, _ = pyxdf.load_xdf(str(path), dejitter_timestamps=False)
    finally:
        logging.getLogger("pyxdf").removeHandler(collector)
    if errors:
        raise ValueError(errors[0])
    result: list[dict[str, Any]] = []
    for stream in streams:
        info = stream["info"]
        values = np.asarray(stream["time_series"])
        time = np.asarray(stream["time_stamps"], dtype=np.float64)
        if values.dtype.kind not in "iuf":
            texts = [" ".join(map(str, np.ravel(row))) for row in values]
            result.append({"name": str(info["name"][0]), "texts": texts, "time": time})
            continue
        described = (info.get("desc") or [None])[0] or {}
        channels = ((described.get("channels") or [None])[0] or {}).get("channel") or []
        footer = stream.get("footer", {}).get("info", {}).get("sample_count")
        result.append(
            {
                "name": str(info["name"][0]),
                "type": str(info["type"][0]),
                "rate": float(info["nominal_srate"][0]),
                "announced": None if not footer else int(footer[0]),
                "channels": [
                    {key: str(value[0]) for key, value in channel.items() if value and value[0]}
                    for channel in channels
                ],
                "values": values.astype(np.float64),
                "time": time,
            }
        )
    return result
