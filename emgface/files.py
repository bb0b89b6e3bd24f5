"""Atomic writing of files."""

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from emgface.errors import DataError


def replace_file(path: Path, write: Callable[[Path], object]) -> None:
    """Write a temporary file by `write` and rename it to `path`; remove it on failure.

    Parameters
    ----------
    path : Path
        File to write; its folder is made if need be.
    write : callable
        Takes the path of the temporary file and fills it.

    Raises
    ------
    DataError
        If the file cannot be written.
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
        # mkstemp makes the file private; the result has the mode of any newly made file.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        temporary.replace(path)
    except OSError as error:
        raise DataError(
            f"Cannot write {path}: {error.strerror or error}; expected a writable folder "
            "with enough space: specify another one."
        ) from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
