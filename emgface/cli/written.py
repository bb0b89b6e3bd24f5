"""Files that a command writes, checked at one place before it runs, so that no input is lost."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

import typer

from emgface.errors import DataError
from emgface.files import expressible

_OWN = (
    "cube exclude figure log movie page picture plain plot report save table vtk waypoints".split()
)
WRITTEN_OPTIONS = {
    "out_path": "--out",
    "out_folder": "--out",
    "out_files": "--out",
    "out_table": "--out",
    "wave": "--out",
    **{name: f"--{name}" for name in _OWN},
}
"""Option of every parameter that states what a command writes; other paths are read."""

FOLDER_PARAMETERS = ("out_folder", "out_files", "vtk", "waypoints")
"""Parameters that name a folder, or (`out_files`) a file or a folder; the others name a file."""

_DATA = ".nc .h5 .hdf5 .mat .npz .c3d .trc .edf .bdf .poly5 .xdf .vhdr .eeg".split()
_TEXT_OR_PICTURE = set(_OWN) - {"cube", "log"}


def spare_inputs(values: Mapping[str, object]) -> None:
    """Raise BadParameter if a command would write a file that it reads, one twice, or a wrong kind.

    `values` are the arguments of the command. No path may have a name that the encoding of file
    names lacks. Links count as the file to which they lead. Folders
    may be both read and written, because the names of the files in them differ. Tables, pages and
    pictures are not written under suffixes of data, under which no command could read them.
    """
    for path in (path for value in values.values() for path in _paths(value)):
        try:
            expressible(path)
        except DataError as error:
            raise typer.BadParameter(str(error)) from error
    read = [
        path
        for name, value in values.items()
        if name not in WRITTEN_OPTIONS
        for path in _paths(Path(value) if name == "source" and isinstance(value, str) else value)
        if os.path.isfile(path)  # also False for a text that is longer than a name can be
    ]
    seen: dict[Path, str] = {}
    for name, option in WRITTEN_OPTIONS.items():
        for path in _paths(values.get(name)):
            if any(path.exists() and path.samefile(source) for source in read):
                raise typer.BadParameter(
                    f"{option} {path} is a file that the command reads and would be lost, "
                    "expected another name: specify a new file"
                )
            other = seen.setdefault(path.resolve(), option)
            if other != option:
                raise typer.BadParameter(
                    f"{other} and {option} are both {path}, so that one would replace the other, "
                    "expected different names: rename one of them"
                )
            _require_suffix(name, option, path)
            if name not in FOLDER_PARAMETERS and path.is_dir():
                raise typer.BadParameter(
                    f"{option} {path} is a folder, expected the name of a file to write: add the name"
                )


def _require_suffix(name: str, option: str, path: Path) -> None:
    suffix = path.suffix.lower()
    if name == "out_table" and suffix != ".csv":
        raise typer.BadParameter(
            f"{option} {path} is a table, expected a name that ends in .csv: specify another name"
        )
    if name in _TEXT_OR_PICTURE and suffix in _DATA:
        raise typer.BadParameter(
            f"{option} {path} has the suffix of a file of data, but a table, page or picture is "
            "written, expected its own suffix, such as .csv, .html or .png: specify another name"
        )


def _paths(value: object) -> Iterable[Path]:
    """Paths among the values of one parameter, also of lists of texts such as jaw=jaw.stl."""
    every = value if isinstance(value, list | tuple) else (value,)
    named = (Path(one.partition("=")[2]) for one in every if isinstance(one, str) and "=" in one)
    return [*(one for one in every if isinstance(one, Path)), *named]
