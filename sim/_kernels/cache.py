"""Cache of compiled kernels, named by a digest of their sources.

The key of numba's cache is the file of the kernel only, so that an edited law in another file would
have no effect. The folder is therefore named by a digest of all kernel sources and the versions of
Python and numba.
"""

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
import warnings
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numba.core.config
import platformdirs


class KernelCacheWarning(UserWarning):
    """The cache folder cannot be written, so kernels are compiled again in every process."""


def cache_root() -> Path:
    """Cache folder: EMGFACE_CACHE, or the user's cache folder."""
    named = os.environ.get("EMGFACE_CACHE")
    return Path(named) if named else Path(platformdirs.user_cache_dir("emgface", appauthor=False))


def source_digest(folder: Path) -> str:
    """Digest of the kernel sources below a folder, with the versions that compile them."""
    digest = hashlib.sha256(f"{sys.version}|{numba.__version__}".encode())
    for path in sorted(folder.glob("**/*.py")) if folder.is_dir() else [folder]:
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def cache_folder(sources: Path) -> Path:
    """Writable folder for the kernels compiled from these sources; temporary if none is."""
    folder = cache_root() / "kernels" / source_digest(sources)
    if _writable(folder):
        return folder
    temporary = Path(tempfile.mkdtemp(prefix="emgface-kernels-"))
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    warnings.warn(
        f"cannot write compiled kernels to {folder}: they are compiled again in every process; "
        "set EMGFACE_CACHE to a writable folder",
        KernelCacheWarning,
        stacklevel=2,
    )
    return temporary


@contextmanager
def kernel_cache(sources: Path) -> Generator[None]:
    """Cache the kernels decorated inside the block under the digest of their file or folder."""
    config: Any = numba.core.config  # numba defines its settings while it runs
    before = config.CACHE_DIR
    config.CACHE_DIR = str(cache_folder(sources))
    try:
        yield
    finally:
        config.CACHE_DIR = before


@contextmanager
def in_one_process(lock: Path) -> Generator[None]:
    """Run the block in one process at a time, where the system has advisory locks.

    All processes lock the same file, whose folder is created.
    """
    with ExitStack() as locks:
        try:
            import fcntl

            lock.parent.mkdir(parents=True, exist_ok=True)
            file = locks.enter_context(lock.open("a"))
            fcntl.flock(file, fcntl.LOCK_EX)  # released when the file is closed
        except (ImportError, OSError):
            pass  # another system, or a folder without locks: every process compiles its own kernels
        yield


def kernels_are_compiled(sources: Path = Path(__file__).parent) -> bool:
    """Test if compiled kernels of these sources exist."""
    folder = cache_root() / "kernels" / source_digest(sources)
    return any(folder.glob("**/*.nbc"))
