"""Start of further Python processes: their command and their environment.

A Python process that is started with ``-c`` or ``-m`` imports modules from the current folder first,
so that a file ``numpy.py`` next to a recording would be executed. Every process that this package
starts therefore has the option ``-P`` or, where `multiprocessing` composes the command, the variable
PYTHONSAFEPATH of the same effect; and it searches no folder that this process does not search
by an absolute name.
"""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

SAFE_PATH: Final = "PYTHONSAFEPATH"
PACKAGE_FOLDER: Final = Path(__file__).resolve().parents[1]  #: folder that contains this package
IGNORED: Final = (
    "PYTHONPATH", "PYTHONSTARTUP", "PYTHONINSPECT", "PYTHONBREAKPOINT",
)  # fmt: skip
"""Variables that would let a child process execute or search something else."""


def python_command(*arguments: str) -> list[str]:
    """Command of a Python process with `arguments`, such as ``-c`` and a text or ``-m`` and a module."""
    return [sys.executable, "-P", *arguments]


def search_path() -> list[str]:
    """Folders that this process searches for modules, without the current one.

    The current folder is kept only if it contains this package, which could not be imported otherwise.
    """
    here = Path.cwd().resolve()
    return [
        entry
        for entry in dict.fromkeys([*sys.path, str(PACKAGE_FOLDER)])
        if os.path.isabs(entry) and (Path(entry).resolve() != here or here == PACKAGE_FOLDER)
    ]


def child_environment(search: Sequence[str | os.PathLike[str]] | None = None) -> dict[str, str]:
    """Environment of a Python process that searches the folders `search`, by default `search_path`."""
    kept = {name: value for name, value in os.environ.items() if name not in IGNORED}
    folders = search_path() if search is None else [os.fspath(folder) for folder in search]
    return kept | {SAFE_PATH: "1", "PYTHONPATH": os.pathsep.join(folders)}


@contextmanager
def safe_children(**variables: str) -> Iterator[None]:
    """Let processes that `multiprocessing` starts in the block not search the current folder.

    `variables` are further variables of their environment.
    """
    given = {SAFE_PATH: "1", **variables}
    before = {name: os.environ.get(name) for name in given}
    os.environ.update(given)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
