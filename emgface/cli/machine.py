"""Properties of the machine: cores, threads, compiled kernels."""

import os
import sys
import webbrowser
from pathlib import Path

from emgface.cli.console import say


def cores() -> int:
    """Number of cores available to this process."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def use_one_blas_thread() -> None:
    """Restrict numerical libraries to one thread for linear algebra, unless configured.

    The matrices are small, so that further threads would only wait. Threads of the element loops
    are separate (`sim.threads`).
    """
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def announce_compilation() -> None:
    """Print a message if the numerical kernels have to be compiled first."""
    from sim._kernels.cache import cache_root, kernels_are_compiled

    if not kernels_are_compiled():
        say(
            "Compiling the numerical kernels; this is done once and takes about ten seconds "
            f"(stored in {cache_root()})."
        )


def show_page(page: Path) -> None:
    """Open a page in the browser if the session is interactive and has a display."""
    from emgface.errors import DataError
    from emgface.pictures.show import check_display

    try:
        check_display()
    except DataError:
        return
    if sys.stdout.isatty():
        webbrowser.open(page.resolve().as_uri())
