"""Reading of recordings of all formats as checked datasets, and writing as netCDF.

Raw files are read only here; the formats are modules of `emgface.recordings.readers`.
"""

import hashlib
import importlib
import json
import os
import pkgutil
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NoReturn, Protocol, cast

import xarray as xr

import emgface.recordings.readers
from emgface.errors import ConfigurationError, DataError, EmgfaceError
from emgface.files import existing_file
from emgface.plugins import Plugin, plugins
from emgface.recordings.fillers import without_fillers
from emgface.recordings.labels import LabelMap, apply_labels, constant_value, read_label_map
from emgface.recordings.readers._row_flags import named
from emgface.schema.netcdf import write_netcdf
from emgface.schema.rules import nearest, one_line
from emgface.schema.validation import validate

_UNNAMED = (".mat", ".h5", ".hdf5", ".dat")
"""Suffixes of files that require a sidecar."""

_OTHERS = {
    ".sto": "a storage file of OpenSim, which contains no recording; expected markers as .trc: "
    "export them, or describe a column as a table by a sidecar",
    ".mot": "a motion file of OpenSim, which contains no markers; expected markers as .trc: export them",
    ".acq": "in the own format of AcqKnowledge; expected a text export: save the graph as text (.txt)",
    ".hpf": "in the own format of EMGworks; expected a text export: convert it with the File Utility "
    "(.csv)",
    ".xlsx": "a workbook; expected a text table: save the sheet as CSV",
    ".xls": "a workbook; expected a text table: save the sheet as CSV",
    ".zip": "an archive; expected the recording in it: unpack it",
}  # fmt: skip
"""Files of programs of the field that are not read, and what to do."""


class Reader(Protocol):
    """A module of `emgface.recordings.readers`."""

    SUFFIXES: tuple[str, ...]
    FORMAT: str

    @staticmethod
    def read(path: Path, units: Mapping[str, str]) -> xr.Dataset:
        """Read a recording in SI units, with the labels of the file."""
        ...


@cache
def readers() -> dict[str, Reader]:
    """Return the readers by file suffix, also those of other packages (`emgface.plugins`).

    Examples
    --------
    >>> readers()[".c3d"].FORMAT
    'C3D'
    """
    by_suffix: dict[str, Reader] = {}
    for info in pkgutil.iter_modules(emgface.recordings.readers.__path__):
        if not info.name.startswith("_"):
            module = cast(
                Reader, importlib.import_module(f"emgface.recordings.readers.{info.name}")
            )
            by_suffix.update(dict.fromkeys(module.SUFFIXES, module))
    for name, plugin in plugins("reader").items():
        by_suffix[f".{name}"] = cast(Reader, _OfPackage(plugin, own=f".{name}" in by_suffix))
    return by_suffix


class _OfPackage:
    """Reader of another package, which is imported when it reads or examines a file."""

    def __init__(self, plugin: Plugin, own: bool) -> None:
        self._plugin, self._own = plugin, own
        self.SUFFIXES = (f".{plugin.name}",)
        self.FORMAT = f"{plugin.name} by {plugin.packages}"

    def __getattr__(self, name: str) -> Any:
        if self._own:
            raise ConfigurationError(
                f"the reader of .{self._plugin.name} of {self._plugin.packages} has the suffix of one "
                "of emgface, expected another suffix: uninstall the package"
            )
        module = self._plugin.load()
        if name == "read" and not callable(getattr(module, name, None)):
            raise ConfigurationError(
                f"the reader of .{self._plugin.name} of {self._plugin.packages} has no function "
                "read(path, units), expected one: uninstall the package"
            )
        return getattr(module, name)


def read_recording(
    path: str | Path,
    *,
    mapping: Mapping[str, Any] | LabelMap | str | Path | None = None,
    study: bool = False,
    folder: Path | None = None,
) -> xr.Dataset:
    """Read one trial in SI units, with gaps and values in place of lost samples as NaN.

    The suffix of the file determines the reader. Tables, MATLAB and HDF5 arrays are specified by
    their TOML sidecar (`emgface.recordings.readers.csv_toml`), BrainVision recordings by their
    header, trials of a BIDS dataset by their EMG file, or by ``*_motion.tsv`` without EMG.
    `mapping` contains the tables ``channels`` and ``markers`` from the labels of the file to names,
    ``units`` if the file does not state them, and ``volunteer``, ``instruction``, ``repetition``,
    ``names``, a pattern of file names that state these three, and tables ``files`` with entries of
    single files; or it is a TOML file with the same, or the pattern alone; without it the labels
    are unchanged. `study` requires all channels and markers of the study
    (`emgface.schema.validation.validate`). `folder` contains the files that a sidecar specifies, by
    default that of the sidecar.

    Attributes of the result are ``source`` (file name), ``source_digest`` (SHA-256 of all files),
    ``device`` if stated in the file, and as JSON ``original_names``, ``original_units``,
    ``dropped`` and ``flagged`` (included although constant). Raises DataError if the file is
    absent, damaged, of unknown format, or does not fulfil the declaration (`SchemaError`,
    `UnitsError`), and ConfigurationError if the mapping or sidecar contains an unknown entry.
    """
    path = existing_file(path, "a recording")
    reader = readers().get(path.suffix.lower())
    if reader is None:
        raise DataError(_unknown_format(path))
    labels = read_label_map(mapping).of_file(path)
    try:
        options: dict[str, Any] = {} if folder is None else {"folder": folder}
        with named({"channel": labels.channels or {}, "marker": labels.markers or {}}):
            recording = reader.read(path, labels.units, **options)
        recording = without_fillers(recording)
        recording = apply_labels(recording, labels)
        if "source" not in recording.attrs:
            recording.attrs.update(source=path.name, source_digest=source_digest(path, **options))
        return validate(_flag_constant(recording), "recording", study=study)
    except DataError as error:
        # Errors of libraries may have several lines.
        message = " ".join(line.strip() for line in str(error).splitlines())
        message = message if path.name in message else f"{path.name}: {message}"
        if message == str(error):
            raise
        raise type(error)(message) from error
    except EmgfaceError:
        raise
    except Exception as error:
        raise DataError(
            f"{path.name} caused its reader to fail ({one_line(error)}); expected a {reader.FORMAT} "
            "file: it is damaged or of an unsupported kind, export it again and report it."
        ) from error


def write_recording(recording: xr.Dataset, path: str | Path) -> Path:
    """Check one trial and write it as netCDF to a file with the suffix ``.nc``.

    An existing file is replaced. Raises DataError if the suffix differs, the recording does not
    fulfil its declaration, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".nc":
        raise DataError(
            f"{path.name} ends in {path.suffix!r}; expected '.nc': recordings are written as "
            "netCDF."
        )
    return write_netcdf(recording, path, "recording")


def find_recordings(folder: str | Path) -> list[Path]:
    """Return the files of a folder and its subfolders that may be recordings, sorted.

    Files that declare another kind are omitted, damaged ones are not. Raises DataError if a folder
    is absent or cannot be read, or contains none.
    """
    recordings = [path for path in candidates(folder) if may_be_recording(path)]
    return recordings if recordings else none_found(folder)


def candidates(folder: str | Path) -> list[Path]:
    """Return the files of `find_recordings` and others with the same suffixes, without opening them."""
    folder = Path(folder)
    if not folder.is_dir():
        raise DataError(f"No folder {folder}; expected recordings in it: check the path.")
    known, paths, left = readers(), list[Path](), [folder]
    try:
        while left:
            with os.scandir(left.pop()) as entries:
                for entry in entries:
                    if entry.is_dir(follow_symlinks=False):
                        left.append(Path(entry.path))
                    elif os.path.splitext(entry.name)[1].lower() in known:
                        # A link to an absent file is listed, so that its recording is missed.
                        if entry.is_file() or (entry.is_symlink() and not os.path.exists(entry)):
                            paths.append(Path(entry.path))
    except OSError as error:
        raise DataError(
            f"{error.filename} cannot be read ({error.strerror}); expected a folder of recordings: "
            "change its permissions, or move it elsewhere."
        ) from error
    return sorted(
        (path for path in paths if not path.name.startswith(".")), key=lambda path: path.parts
    )


def none_found(folder: str | Path) -> NoReturn:
    """Raise DataError for a folder without recordings."""
    raise DataError(
        f"No recording in {folder}; expected files ending in {', '.join(sorted(readers()))}: "
        "check the path, or convert the files."
    )


def may_be_recording(path: Path) -> bool:
    """Return False for a file that declares another kind; one that cannot be opened may be one."""
    if not path.exists():
        return True
    try:
        test = getattr(readers()[path.suffix.lower()], "is_recording", None)
        return test is None or test(path)
    except Exception:
        return True


def read_recordings(
    *paths: str | Path,
    mapping: Mapping[str, Any] | LabelMap | str | Path | None = None,
    study: bool = False,
) -> Iterator[tuple[Path, xr.Dataset | EmgfaceError]]:
    """Read trials one by one, continuing after an invalid one.

    `paths` are files, and folders that are searched by `find_recordings`. Yields each file with its
    recording, or with the error. Other arguments as for `read_recording`. Raises DataError if a
    folder contains no recording.
    """
    labels = read_label_map(mapping)
    given = [Path(path) for path in paths]
    for path in (
        file for each in given for file in (find_recordings(each) if each.is_dir() else [each])
    ):
        try:
            yield path, read_recording(path, mapping=labels, study=study)
        except EmgfaceError as error:
            yield path, error


def _flag_constant(recording: xr.Dataset) -> xr.Dataset:
    """Flag constant channels: a loose electrode, or a socket without a sensor."""
    if "emg" not in recording or "channel" not in recording.coords:
        return recording
    flagged: dict[str, str] = {}
    for label, values in zip(recording["channel"].values, recording["emg"].values, strict=True):
        still = constant_value(values)
        if still is not None:
            flagged[str(label)] = f"constant at {still:g} V"
    if flagged:
        return recording.assign_attrs(flagged=json.dumps(flagged, ensure_ascii=False))
    recording.attrs.pop("flagged", None)  # the mapping omits its channel
    return recording


def source_digest(path: Path, **options: Any) -> str:
    """Digest of a recording: SHA-256 of its file and of the others that its reader opens, in order.

    `options` are those of the reader. A file that no reader opens is digested alone.
    """
    reader = readers().get(path.suffix.lower())
    others = getattr(reader, "companions", None) if may_be_recording(path) else None
    digest = hashlib.sha256()
    for file in [path, *(others(path, **options) if others else [])]:
        with file.open("rb") as stream:
            hashlib.file_digest(stream, lambda: digest)
    return digest.hexdigest()


def _unknown_format(path: Path) -> str:
    known = readers()
    if path.suffix.lower() in _UNNAMED:
        sidecar = path.with_suffix(".toml")
        named = f"specify {sidecar.name}, which is in the same folder"
        return (
            f"{path.name} does not specify its contents, rate and units; expected a TOML "
            f"sidecar that does: {named if sidecar.is_file() else 'write one'} instead."
        )
    if own := _OTHERS.get(path.suffix.lower()):
        return f"{path.name} is {own}."
    formats = ", ".join(f"{suffix} ({known[suffix].FORMAT})" for suffix in sorted(known))
    near = nearest(path.suffix, known, cutoff=0.75)
    meant = f" (did you mean {near!r}?)" if near else ""
    return (
        f"{path.name} has the unknown suffix {path.suffix!r}{meant}; expected {formats}: convert the "
        "file."
    )
