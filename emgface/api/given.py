"""Arguments of the public functions: files, datasets, parameter models or mappings."""

from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, Union

import xarray as xr
from pydantic import BaseModel

from emgface.choices import configure
from emgface.errors import ConfigurationError, SchemaError
from emgface.files import expressible, file_to_write
from emgface.recordings.dataset import read_recording
from emgface.recordings.fillers import without_fillers
from emgface.schema.in_memory import kind_in_memory, require_kind, usable
from emgface.schema.netcdf import kind_of, read_netcdf
from emgface.signals.parameters import SignalChain

# The mechanics are imported by the functions that use them: signals require none.
if TYPE_CHECKING:
    from emgface.face.simulation_parameters import SimulationParameters
    from emgface.study.configuration import StudyConfiguration

File = str | PathLike[str]
Data = xr.Dataset | File
Given = Union["StudyConfiguration", Mapping[str, Any], File, None]
"""Study: configuration, content of its file, path of its file, or None for the defaults."""

ModelT = TypeVar("ModelT", bound=BaseModel)


def signals_of(given: Given) -> SignalChain:
    """Return the signal chain of a study, as `study_of`; without a study, none is composed."""
    return SignalChain() if given is None else study_of(given).signals


def study_of(given: Given) -> "StudyConfiguration":
    """Return the configuration of a study file, of its content, or the default.

    Raises ConfigurationError if the file cannot be read, or a name or value in it is not valid.
    """
    from emgface.study.configuration import StudyConfiguration
    from emgface.study.file import check_axes, load_study

    if given is None:
        return StudyConfiguration()
    if isinstance(given, StudyConfiguration):
        return given
    if isinstance(given, Mapping):
        study = configure(StudyConfiguration, given, where="study")
        check_axes(study, where="study")
        return study
    return load_study(expressible(given))


def path_of(given: object, expected: str) -> Path:
    """Return a path; SchemaError if the argument is neither a path nor a dataset."""
    if not isinstance(given, str | PathLike):
        raise SchemaError(
            f"the argument is of type {type(given).__name__}, expected {expected} as a Dataset or "
            "the path of its file: pass one of them"
        )
    return expressible(given)


def path_or_none(given: File | None) -> Path | None:
    """Return the path of an optional argument; DataError if it is something else."""
    return None if given is None else expressible(given)


def target_or_none(given: File | None) -> Path | None:
    """Return the path of an optional file to write; DataError for a folder, and if it is no path."""
    return None if given is None else file_to_write(given)


def kind_of_given(given: Data, expected: str) -> str:
    """Return the kind of a dataset, or that which a netCDF file states, and "" for other files."""
    if isinstance(given, xr.Dataset):
        return kind_in_memory(given)
    path = path_of(given, expected)
    return kind_of(path) if path.suffix.lower() == ".nc" else ""


def dataset_of(given: Data, kind: str, variable: str) -> xr.Dataset:
    """Return a dataset of a kind, read from its netCDF file if a path is passed.

    Raises DataError if the file is absent, damaged or of another kind, or the dataset lacks the
    variable.
    """
    if not isinstance(given, xr.Dataset):
        return read_netcdf(path_of(given, f"a stored {kind}"), kind)
    require_kind(given, kind)
    if variable not in given:
        raise SchemaError(
            f"the dataset contains {', '.join(map(str, given.data_vars)) or 'no variable'}, expected "
            f"{variable}, as of a stored {kind}: pass the result of the preceding stage"
        )
    return usable(given, kind)


def recording_of(given: Data, mapping: Mapping[str, Any] | File | None) -> xr.Dataset:
    """Return a recording, read from a file of any supported format if a path is passed.

    Raises errors as `emgface.recordings.dataset.read_recording`.
    """
    if isinstance(given, xr.Dataset):
        if mapping is not None:
            raise ConfigurationError(
                "a mapping assigns names to the labels of a file, expected none for a recording in "
                "memory: leave it out, or pass the file"
            )
        return without_fillers(usable(given, "recording"))
    named = fspath(mapping) if isinstance(mapping, PathLike) else mapping
    return read_recording(path_of(given, "a recording"), mapping=named)


def face_of(given: Data | None, study: "StudyConfiguration") -> xr.Dataset:
    """Return the specified face, or that of the study.

    Raises FaceError or SchemaError if it is not valid, be it a file or a dataset.
    """
    from emgface.face.file import load_face
    from emgface.face.validity import check_face
    from emgface.study.file import study_face

    if given is None:
        return study_face(study.face)
    if not isinstance(given, xr.Dataset):
        return load_face(path_of(given, "a face model"))
    checked = check_face(usable(given, "face_model"))
    # a face that needs no change is itself, as a plan without effect returns it
    return given if not given.chunks and checked.identical(given) else checked


def changed(model: ModelT, tables: Mapping[str, Any], where: str) -> ModelT:
    """Return parameters with some of them replaced, including nested tables.

    Parameters that are not set keep their defaults; a parameter model may be passed for its table,
    and `where` is stated in messages. Raises ConfigurationError if a name is unknown (with the
    nearest valid one) or a value is invalid.
    """
    if not tables:
        return model
    values = merged(model.model_dump(exclude_unset=True), tables)
    return configure(type(model), values, where=where)


def simulation_of(
    parameters: "SimulationParameters", accuracy: str | None, choices: Mapping[str, Any]
) -> "SimulationParameters":
    """Return the simulation parameters with the specified accuracy and parameters.

    Raises ConfigurationError if the accuracy, a name or a value is not valid.
    """
    from emgface.face.accuracy import SET_BY_ACCURACY
    from emgface.face.simulation_parameters import SimulationParameters

    values = parameters.model_dump(exclude_unset=True)
    wanted = {} if accuracy is None else {"accuracy": accuracy}
    changes = merged(wanted, choices)
    if "accuracy" in changes:
        # Solver, step and tolerances of the parameters were determined by their own accuracy.
        values = {name: v for name, v in values.items() if name not in SET_BY_ACCURACY}
    elif "solver" in changes:
        # Schemes with one solution per step have no error control.
        values.pop("error_tolerance", None)
    if not changes:
        return parameters
    return configure(SimulationParameters, merged(values, changes), where="simulation")


def merged(values: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a nested mapping updated by another one."""
    result = dict(values)
    for name, change in changes.items():
        plain = change.model_dump(exclude_unset=True) if isinstance(change, BaseModel) else change
        below = result.get(name)
        if isinstance(plain, Mapping):
            result[name] = merged(below if isinstance(below, Mapping) else {}, plain)
        else:
            result[name] = plain
    return result
