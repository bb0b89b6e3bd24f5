"""Files of a folder that are not read as recordings, each with the reason."""

import os
from pathlib import Path
from typing import Final

from emgface.errors import DataError
from emgface.recordings.dataset import may_be_recording, readers
from emgface.recordings.exports import SUFFIXES as TABLES
from emgface.recordings.readers._arrays import ARRAY_SUFFIXES
from emgface.recordings.readers.text_exports import described_files

DOCUMENTS: Final = ("readme", "license", "licence", "changes", "origin", "codebook", "requirements")
"""Names of text files that describe others."""


def left_out_files(folder: str | Path) -> dict[Path, str]:
    """Return the files that may contain signals and are not read, sorted, with the reasons.

    They are tables and arrays that no sidecar in their folder describes, files of other kinds in the
    formats of recordings, hidden ones, and links to folders, which are not followed. Files that are
    read, if only to be refused, are those of `emgface.recordings.dataset.find_recordings`.
    """
    root, reasons = Path(folder), dict[Path, str]()
    known = readers()
    for place, folders, files in os.walk(root):
        here = Path(place)
        for name in folders:
            if (here / name).is_symlink():
                reasons[here / name] = "a link to a folder, which is not followed"
        for name in files:
            path, suffix = here / name, os.path.splitext(name)[1].lower()
            if suffix not in known and suffix not in ARRAY_SUFFIXES:
                continue
            if reason := _reason(path, suffix):
                reasons[path] = reason
    return dict(sorted(reasons.items(), key=lambda item: item[0].parts))


def _reason(path: Path, suffix: str) -> str:
    """Reason why a file is left out; empty if it is read, or is part of a recording."""
    if suffix == ".toml" or (suffix == ".tsv" and not path.name.endswith("_motion.tsv")):
        return ""  # settings and tables of a dataset
    if path.name.startswith("."):
        return "hidden"
    if suffix in (*TABLES, *ARRAY_SUFFIXES):
        if path.stem.lower() in DOCUMENTS:
            return ""
        if path.exists() and path.resolve() in described_files(path.parent):
            return ""
        if suffix in ARRAY_SUFFIXES or (path.exists() and not may_be_recording(path)):
            return "no sidecar describes it"
        return ""
    if path.exists() and not may_be_recording(path):
        return "another kind of file" if suffix != ".tsv" else ""
    return ""


def left_out_sentence(folder: str | Path, most: int = 6) -> str:
    """Return a sentence that names the files that are left out; empty if there are none.

    Raises DataError if the folder is absent.
    """
    root = Path(folder)
    if not root.is_dir():
        raise DataError(f"No folder {root}; expected recordings in it: check the path.")
    reasons = left_out_files(root)
    if not reasons:
        return ""
    named = [f"{path.relative_to(root)} ({reason})" for path, reason in reasons.items()]
    more = f" and {len(named) - most} more" if len(named) > most else ""
    return f"Not read in {root}: {', '.join(named[:most])}{more}."
