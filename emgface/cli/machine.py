"""What the machine offers: cores, threads, compiled kernels."""

import os
import sys

from emgface.cli.console import say


def cores() -> int:
    """Cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def use_one_thread() -> None:
    """Let numerical libraries that are not loaded yet use one thread, unless told otherwise."""
    if "numba" not in sys.modules and "numpy" not in sys.modules:
        for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
            os.environ.setdefault(name, "1")


def announce_compilation() -> None:
    """Say so when the numerical kernels have to be compiled first."""
    from sim._kernels.cache import cache_root, kernels_are_compiled

    if not kernels_are_compiled():
        say(
            "Compiling the numerical kernels; this happens once and takes about ten seconds "
            f"(kept in {cache_root()})."
        )
