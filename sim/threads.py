"""Threads of the element loops and of dense linear algebra, with passive waiting.

Dense linear algebra uses one thread, so that the order of its sums does not depend on the machine.
"""

import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, wraps
from typing import Any, ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController  # pyright: ignore[reportMissingTypeStubs]

P = ParamSpec("P")
R = TypeVar("R")

VARIABLE = "NUMBA_NUM_THREADS"


def one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Restrict BLAS and LAPACK of NumPy, SciPy and MKL to one thread during a function.

    The division of a product or a factor, and therefore its rounding, depends on the number of
    threads. The dense matrices here are small; element loops use all threads (`sim.chunks`).
    """

    @wraps(function)
    def on_one_thread(*args: P.args, **kwargs: P.kwargs) -> R:
        with _controller(len(sys.modules)).limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return on_one_thread


@lru_cache(maxsize=1)
def _controller(modules: int) -> Any:
    """Libraries that are loaded; the search takes some milliseconds, and only an import loads one."""
    return ThreadpoolController()


class _Threads:
    """Number of threads of the element loops, and the additional threads, started on demand."""

    def __init__(self) -> None:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
        named = os.environ.get(VARIABLE, "")
        self.count = int(named) if named.isdecimal() and int(named) > 0 else cores or 1
        self._pool: ThreadPoolExecutor | None = None

    def pool(self) -> ThreadPoolExecutor:
        """Threads other than the calling one."""
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.count - 1, "elements")
        return self._pool

    def forget(self) -> None:
        """Reset the threads for another number or after a fork."""
        self._pool = None


_threads = _Threads()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_threads.forget)


def thread_count() -> int:
    """Threads of the element loops: `NUMBA_NUM_THREADS`, by default as many as there are cores."""
    return _threads.count


def set_thread_count(count: int) -> None:
    """Set the number of threads of the element loops, which does not affect results."""
    if count < 1:
        raise ValueError(f"the number of threads is {count}, expected at least 1")
    _threads.count = count
    _threads.forget()


def in_shares(
    work: Callable[..., None], first: int, last: int, least: int, arguments: tuple[Any, ...]
) -> None:
    """Call ``work(begin, end, *arguments)`` for equal parts of first..last, in threads.

    Parts contain at least `least`; with fewer than two of them, `work` is called once.
    """
    n = min(_threads.count, (last - first) // least)
    if n < 2:
        work(first, last, *arguments)
        return
    cut = [first + i * (last - first) // n for i in range(n + 1)]
    pool = _threads.pool()
    others = [pool.submit(work, a, b, *arguments) for a, b in zip(cut[1:-1], cut[2:], strict=True)]
    work(cut[0], cut[1], *arguments)
    for other in others:
        other.result()
