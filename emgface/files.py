"""Atomic writing of files."""

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from emgface.errors import DataError

LEAST_SPACE = 2**20  #: free space [bytes] below which a disk counts as full


def replace_file(path: Path, write: Callable[[Path], object]) -> None:
    """Write a temporary file by `write` and rename it to `path`; remove it on failure.

    Folders are created. Raises DataError if the file cannot be written.
    """
    temporary: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
        os.close(handle)
        temporary = Path(name)
        write(temporary)
        with temporary.open("rb") as stream:
            os.fsync(stream.fileno())
        # mkstemp creates a private file; the result has the usual mode of new files.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        temporary.replace(path)
    except (OSError, RuntimeError) as error:
        # The netCDF library reports a full disk as missing permission or "HDF error".
        full = path.parent.is_dir() and shutil.disk_usage(path.parent).free < LEAST_SPACE
        if not (full or isinstance(error, OSError)):
            raise
        reason = "the disk is full" if full else getattr(error, "strerror", None) or error
        raise DataError(
            f"Cannot write {path}: {reason}; expected a writable folder "
            "with enough space: specify another one."
        ) from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8 as `replace_file`."""
    replace_file(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def refuse_existing(path: Path | None) -> None:
    """Raise DataError for a file that exists and may contain corrections of the user."""
    if path is not None and path.exists():
        raise DataError(
            f"{path} exists and may contain your own corrections, expected a new name: "
            "specify another one or delete it"
        )
