"""Properties of the machine: cores, threads, compiled kernels."""

import atexit
import gc
import os
import signal
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from emgface.cli.console import say

if TYPE_CHECKING:
    from emgface.run.runner import Workers


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


def collect_seldom() -> None:
    """Search for unreachable objects less often than Python does, and not at the end of the process.

    Each search visits hundreds of thousands of objects of the imported libraries. The data of a
    command are arrays, which are freed without a search.
    """
    gc.set_threshold(50_000)
    atexit.register(gc.freeze)


def unwind_when_terminated() -> None:
    """End the process at SIGTERM and SIGHUP by an exception, so that temporary files are removed.

    A batch system ends a job by SIGTERM, a closed connection by SIGHUP. A signal that is ignored,
    such as by nohup, remains so.
    """

    def end(number: int, _: object) -> None:
        raise SystemExit(128 + number)

    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, end)


def announce_compilation() -> None:
    """Print a message if the numerical kernels have to be compiled first."""
    from sim._kernels.cache import cache_root, kernels_are_compiled

    if not kernels_are_compiled():
        say(
            "Compiling the numerical kernels; this is done once and takes about ten seconds "
            f"(stored in {cache_root()})."
        )


@contextmanager
def graceful_stop(what: str = "trials") -> Iterator[Callable[[], bool]]:
    """Ask a long run to stop at the first Ctrl-C or SIGTERM, and interrupt it at the second.

    Yields a function that returns True after the first.
    """
    received: list[int] = []

    def receive(number: int, _: object) -> None:
        if received:
            raise KeyboardInterrupt
        received.append(number)
        say(f"Stopping after the {what} that have begun; press Ctrl-C again to stop at once.")

    if threading.current_thread() is not threading.main_thread():
        yield lambda: False  # only the main thread receives signals
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, receive) for number in numbers]
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


@contextmanager
def executing(workers: int | None, scheduler: str | None) -> "Iterator[int | Workers]":
    """Number of processes, by default one per core, or the workers of a scheduler until the end."""
    if scheduler is None:
        yield workers or cores()
        return
    from emgface.run.cluster import DaskWorkers

    chosen = DaskWorkers(scheduler)
    try:
        yield chosen
    finally:
        chosen.end()


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
