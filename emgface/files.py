"""Atomic writing of files, and the names of files that follow from data.

Names of volunteers, instructions and stages are read from files, which may come from others. They
become paths only by `named_file` and `result_file`, so that no content of a file leads out of the
folder that the user has specified.
"""

import errno
import hashlib
import os
import re
import shutil
import socket
import sys
import unicodedata
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Final

from emgface.errors import DataError, EmgfaceError, StoreError, listed

LEAST_SPACE = 2**20  #: free space [bytes] below which a disk counts as full


LONGEST_FILE_NAME: Final = 200  #: bytes of the name of a file; file systems allow 255
_UNSAFE: Final = re.compile(r"[^\w .+=()@,-]")
_DEVICES: Final = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")  # of Windows
_STAGE, _DIGEST = re.compile(r"[A-Za-z]\w*", re.ASCII), re.compile(r"[0-9A-Za-z]+", re.ASCII)


def named_file(folder: Path, *names: object, suffix: str) -> Path:
    """File in `folder` whose name consists of texts from data, joined by ``_``, and `suffix`.

    Everything but letters, digits, spaces and ``.+=()@,-`` is replaced by ``-``, as are a point or
    space at the beginning or end: the result lies directly in `folder`. Empty texts are omitted.
    Raises DataError if no text remains or the name is too long.
    """
    texts = [unicodedata.normalize("NFC", str(name)) for name in names]
    name = "_".join(_UNSAFE.sub("-", text) for text in texts if text.strip())
    name = re.sub(r"^[. ]|[. ]$", "-", name)
    if _DEVICES.fullmatch(name):
        name = f"{name}-"
    if not name or len(f"{name}{suffix}".encode()) > LONGEST_FILE_NAME:
        raise DataError(
            f"{listed([ascii(text)[:60] for text in texts]) or 'nothing'} cannot be the name of a file, "
            f"expected 1 to {LONGEST_FILE_NAME - len(suffix)} bytes: rename volunteer, instruction or "
            "repetition"
        )
    return folder / f"{name}{suffix}"


def result_file(store: Path, stage: str, digest: str, suffix: str = ".nc") -> Path:
    """File of a stored result, ``<store>/<stage>/<digest>.nc``.

    Stage and digest may have been read from a journal. Raises StoreError unless the stage is an
    identifier and the digest consists of letters and digits.
    """
    if not (_STAGE.fullmatch(stage) and _DIGEST.fullmatch(digest)):
        raise StoreError(
            f"found the stage {ascii(stage)[:80]} with the digest {ascii(digest)[:80]}, expected a name "
            "and hexadecimal digits: the journal is damaged, or was written by another program"
        )
    return store / stage / f"{digest}{suffix}"


def plain_files(folder: Path) -> Iterator[Path]:
    """Files in a folder and its subfolders, in order; links are neither followed nor returned."""
    if folder.is_symlink() or not folder.is_dir():
        return
    for path in sorted(folder.iterdir()):
        if path.is_symlink():
            continue
        if path.is_dir():
            yield from plain_files(path)
        elif path.is_file():
            yield path


def new_files(
    targets: Mapping[Path, object], *, replace: bool, sources: Iterable[Path] = ()
) -> None:
    """Check the files that a command is about to write, before it writes the first.

    `targets` contains what is written to each, and `sources` are the files from which it is computed.
    Raises DataError for a link, for a source, and unless `replace` for a file that exists.
    """
    lost = [
        path.name
        for path in targets
        if path.exists() and any(path.samefile(source) for source in sources)
    ]
    if lost and replace:
        raise DataError(
            f"{listed(lost)} of {next(iter(targets)).parent} would be replaced by what is computed "
            "from it, expected that recordings are kept: specify another folder"
        )
    taken = [path.name for path in targets if path.is_symlink() or (path.exists() and not replace)]
    if taken:
        raise DataError(
            f"{listed(taken)} of {next(iter(targets)).parent} exist, expected new files: specify "
            "another folder, or --force to write them again (links are never replaced)"
        )


def different_names(pairs: Iterable[tuple[Path, str]]) -> dict[Path, str]:
    """Return the origin of each target; DataError if two of them have the same target.

    Names are compared without case, as some file systems do.
    """
    origins: dict[str, tuple[Path, str]] = {}
    for path, origin in pairs:
        key = str(path).casefold()
        if key in origins:
            raise DataError(
                f"{origin} and {origins[key][1]} would both be written as {path.name}, expected "
                "different names: rename one of them, or use different folders"
            )
        origins[key] = path, origin
    return dict(origins.values())


def replace_file(path: Path, write: Callable[[Path], object]) -> None:
    """Write a temporary file by `write` and rename it to `path`; remove it on failure.

    Folders are created. Raises DataError if the file cannot be written.
    """
    temporary: Path | None = None
    path = file_to_write(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = new_part(path)
        temporary.touch(mode=0o600, exist_ok=False)
        write(temporary)
        with temporary.open("rb") as stream:
            os.fsync(stream.fileno())
        # The temporary file is private; the result has the usual mode of new files.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        temporary.replace(path)
    except (OSError, RuntimeError) as error:
        reason = why_not_written(error, path.parent, temporary)
        if reason is None:
            raise
        raise DataError(f"Cannot write {path}: {reason}.") from error
    finally:
        if temporary is not None:
            with suppress(OSError):  # of a file system that is read-only
                temporary.unlink(missing_ok=True)


_PART: Final = re.compile(r"\..*\.emgface-([0-9a-f]{8})-(\d+)-[0-9a-f]{8}\.part")


def new_part(path: Path) -> Path:
    """Name of a temporary file next to `path`, which states the process that writes it.

    At the first call for a folder, temporary files of processes of this machine that were killed are
    removed from it.
    """
    _remove_parts_of_killed(path.parent)
    # A long name leaves no room for the rest, and is replaced by its digest.
    name = path.name if len(os.fsencode(path.name)) <= LONGEST_FILE_NAME else _digest(path.name)
    return path.with_name(f".{name}.emgface-{_machine()}-{os.getpid()}-{os.urandom(4).hex()}.part")


@cache
def _remove_parts_of_killed(folder: Path) -> None:
    """Remove the temporary files of a folder whose process no longer exists."""
    if sys.platform == "win32":
        return  # where a process cannot be asked whether it exists
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            match = _PART.fullmatch(entry.name)
            if match is None or match[1] != _machine() or entry.is_symlink():
                continue
            try:
                os.kill(int(match[2]), 0)
            except (ProcessLookupError, OverflowError):
                _remove(Path(entry.path))
            except OSError:  # a process of another user
                continue


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def is_part(path: Path) -> bool:
    """Return True for the temporary file of a process that writes, or was killed while it wrote."""
    return path.name.startswith(".") and path.suffix == ".part"


def new_folder(path: Path, fill: Callable[[Path], object]) -> None:
    """Fill a temporary folder by `fill` and rename it to `path`; remove it on failure.

    Raises DataError if `path` exists, and OSError if the folder cannot be made.
    """
    expressible(path)
    if path.exists() or path.is_symlink():
        raise DataError(f"{path} exists, expected a new folder: specify another one")
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = new_part(path)
    try:
        temporary.mkdir()
        fill(temporary)
        temporary.rename(path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@cache
def _machine() -> str:
    """Digest of the machine and of the namespace of its processes, whose numbers are unique there."""
    try:
        space = os.readlink("/proc/self/ns/pid")
    except OSError:
        space = ""
    return _digest(f"{socket.gethostname()} {space}")


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:8]


def file_to_write(path: object) -> Path:
    """Return the path of a file that can be written; DataError for a folder, and if it is no path."""
    path = expressible(path)
    if path.is_dir():
        raise DataError(f"{path} is a folder, expected the name of a file to write: add the name")
    return path


def existing_file(
    path: str | os.PathLike[str], expected: str, error: type[EmgfaceError] = DataError
) -> Path:
    """Return the path of a file that exists; raises `error` for a folder, and for none."""
    path = expressible(path)
    if not path.is_file():
        raise error(absence(path, expected))
    return path


def absence(path: Path, expected: str) -> str:
    """Return the message for a path that is no file: a folder, a link to nothing, or absent."""
    if path.is_dir():
        return f"{path} is a folder; expected {expected}: specify a file."
    if path.is_symlink():
        return (
            f"{path} is a link to {os.readlink(path)}, which is not there; expected {expected}: copy "
            "the file to its place, or delete the link."
        )
    return f"No file {path}; expected {expected}: check the path."


def expressible(path: object) -> Path:
    """Return a path; DataError if it is none, or its name is not in the encoding of file names.

    Python reads such names with placeholders for the bytes that it cannot decode. Libraries in C
    cannot open them, and no text file in UTF-8 can contain them.
    """
    if not isinstance(path, str | os.PathLike):
        raise DataError(
            f"the path is of type {type(path).__name__}, expected a text or a pathlib.Path: pass the "
            "name of the file or folder"
        )
    path, encoding = Path(path), sys.getfilesystemencoding()
    try:
        wrong = "a null character" if "\0" in str(path) else ""
        str(path).encode(encoding)
    except UnicodeEncodeError as error:
        wrong = f"{ascii(error.object[error.start : error.end])[1:-1]}, which is not in {encoding}"
    if not wrong:
        return path
    locale = "" if encoding == "utf-8" else ", or set PYTHONUTF8=1 if names are in UTF-8"
    raise DataError(
        f"the path {ascii(str(path))} contains {wrong}; expected the encoding of file names: rename the "
        f"file or folder{locale}"
    )


@contextmanager
def locked(folder: Path) -> Generator[None]:
    """Run the block in one process at a time, where the system can lock folders; it is created."""
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as resources:
        try:
            import fcntl

            handle = os.open(folder, os.O_RDONLY)
            resources.callback(os.close, handle)
            fcntl.flock(handle, fcntl.LOCK_EX)  # released when it is closed
        except (ImportError, OSError):
            pass  # another system, or a file system without locks
        yield


def why_not_written(
    error: OSError | RuntimeError, folder: Path, part: Path | None = None
) -> str | None:
    """Return why a file could not be written, and what to try; None for an error of another cause.

    The number of the error decides, unless the temporary file `part` had been created in the folder:
    the netCDF library then reports a full disk, or a file that exceeds the limit of the process, as
    missing permission or "HDF error".
    """
    number = error.errno if isinstance(error, OSError) else None
    room = "expected a writable folder with enough space: free space or specify another one"
    unclear = part is not None and number in (None, errno.EACCES, errno.EPERM, errno.EIO)
    limit = _largest_file()
    if number == errno.EFBIG or (
        unclear and limit is not None and _size(part) + LEAST_SPACE >= limit and _size(part) > 0
    ):
        known = "" if limit is None else f" of {limit} bytes for this process"
        return (
            f"it exceeds the limit of the size of files{known}; expected a larger limit: raise it "
            "('ulimit -f'), or use a file system that allows such files"
        )
    if number in (errno.ENOSPC, errno.EDQUOT):
        full = "the disk is full" if number == errno.ENOSPC else "the quota of the disk is used up"
        return f"{full}; {room}"
    if unclear:
        usage = shutil.disk_usage(folder)
        if 0 < usage.total and usage.free < LEAST_SPACE:  # file systems such as /proc have no size
            return f"the disk is full; {room}"
    if number in (errno.EACCES, errno.EPERM):
        return f"there is no permission to write in its folder; {room}"
    if isinstance(error, OSError):
        return f"{error.strerror or error}; {room}"
    return None


def _largest_file() -> int | None:
    """Limit of the size of a file that this process may write [bytes], None if there is none."""
    if sys.platform == "win32":
        return None
    import resource

    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return None if limit == resource.RLIM_INFINITY else limit


def _size(path: Path | None) -> int:
    """Size of a file [bytes], 0 if it does not exist."""
    return path.stat().st_size if path is not None and path.exists() else 0


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
