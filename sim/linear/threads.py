"""Number of threads of the direct solver of MKL, one unless a simulation asks for more."""

from collections.abc import Generator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from threadpoolctl import ThreadpoolController  # pyright: ignore[reportMissingTypeStubs]

from sim.errors import SceneError

ACTIVE_MS = 200  #: time for which threads without work wait actively [ms]
NOTE = (
    "the linear solver used {} threads: the last digits of results differ between processes, and "
    "from those of one thread"
)

_count: ContextVar[int] = ContextVar("solver_threads", default=1)


def thread_count() -> int:
    """Threads of a factorisation or a solution that begins now in this thread of Python."""
    return _count.get()


@contextmanager
def solver_threads(count: int, solver: str) -> Generator[None]:
    """Factorise and solve with `count` threads in the calling thread, by PARDISO.

    With more than one, the threads wait actively, since a factorisation has hundreds of waits of some
    microseconds, and the order of sums is that in which the threads finish: results differ in the
    last digits between processes.

    Raises SceneError if `count` is not positive, or is larger than one for another `solver`.
    """
    if count < 1:
        raise SceneError(f"the number of solver threads is {count}, expected at least 1")
    if count > 1 and "pardiso" not in solver:
        raise SceneError(
            f"the linear solver {solver!r} has one thread, expected solver_threads = 1 instead of "
            f"{count}, or PARDISO"
        )
    token = _count.set(count)
    before = _blocktime(ACTIVE_MS) if count > 1 else None
    try:
        yield
    finally:
        _count.reset(token)
        if before is not None:
            _blocktime(before)


def _blocktime(milliseconds: int) -> int | None:
    """Set the time of active waiting of Intel's OpenMP; that before, or None if it is not loaded."""
    loaded: Any = ThreadpoolController()
    for dynamic in [library.dynlib for library in loaded.lib_controllers]:
        if hasattr(dynamic, "kmp_set_blocktime"):
            before = int(dynamic.kmp_get_blocktime())
            dynamic.kmp_set_blocktime(milliseconds)
            return before
    return None
