"""Studies that use a store: a list in the store, to which every run adds its own.

Results that no study of the list uses may be removed. The list consists of one small file per study
in the folder ``owners`` of the store, so that simultaneous runs do not affect each other. A
file contains the path of the study's folder relative to the store: both may be moved together.
"""

import os
from pathlib import Path
from typing import Final

from emgface.errors import DataError, StoreError
from emgface.files import plain_files, write_text
from emgface.study.digest import text_digest

FOLDER: Final = "owners"


def add_owner(store: Path, study: Path) -> None:
    """Add the folder of a study to the list of a store; StoreError if it cannot be written."""
    place = _relative(store, study)
    path = store / FOLDER / f"{text_digest(place)}.txt"
    if path.is_file():
        return
    try:
        write_text(path, f"{place}\n")
    except DataError as error:
        raise StoreError(str(error)) from error


def owners(store: Path) -> dict[Path, Path]:
    """Folders of the studies in the list of a store, each with its file in the list."""
    found: dict[Path, Path] = {}
    for path in plain_files(store / FOLDER):
        if path.suffix == ".txt":
            place = path.read_text(encoding="utf-8").strip()
            found[Path(os.path.normpath(store.resolve() / place))] = path
    return found


def _relative(store: Path, study: Path) -> str:
    store, study = store.resolve(), study.resolve()
    try:
        return Path(os.path.relpath(study, store)).as_posix()
    except ValueError:  # on another drive of Windows
        return study.as_posix()
