"""Compilation of kernels, and distribution of element loops among threads.

Only functions that Python calls are cached and have a wrapper for Python; functions inside a kernel are
always inlined. If one were called instead, its code would be optimised once in the process that compiles
it and twice in processes that load it, and their last digits would differ, because arithmetic may be
reordered. Threads are those of Python: a loop that numba runs in parallel is typed twice and optimised
three times, and its threads wait by spinning.
"""

# pyright: basic, reportCallIssue=false

import gc
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any

import numba as nb
from numba.core.compiler_lock import global_compiler_lock

from sim._kernels.cache import in_one_process
from sim.threads import in_shares

CHUNKS, LEAST_ROWS = 2, 512  # smallest share of a thread: chunks of elements, rows of a table

_ALL: dict[str, Any] = {
    "no_cfunc_wrapper": True,
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},  # not all flags, which exclude NaN
}
_BARE = {**_ALL, "_nrt": False}
_INNER: dict[str, Any] = {"no_cpython_wrapper": True, "forceinline": True}


@contextmanager
def _without_collection() -> Generator[None]:
    """Suspend the search for cycles of objects, a twelfth of the time of a compilation."""
    searching = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if searching:
            gc.enable()


def _compiled_once(dispatcher: Any) -> Any:
    """Let one process compile a kernel; others that require it wait and then load it."""
    compile_here = dispatcher.compile
    lock = Path(dispatcher.stats.cache_path) / f"{dispatcher.__module__}.{dispatcher.__name__}.lock"

    def compile_or_load(signature):
        # locks in this order in every thread
        with global_compiler_lock, in_one_process(lock), _without_collection():
            return compile_here(signature)

    dispatcher.compile = compile_or_load
    return dispatcher


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls, which releases the interpreter lock."""
    return _compiled_once(nb.njit(**_ALL, cache=True, nogil=True)(function))


def bare_kernel(function: Callable[..., Any]) -> Any:
    """As `kernel`, for a function that allocates no array.

    References to arrays are not counted. numba counts them for every access to a table of arrays, by
    atomic operations that it fails to remove between branches and loops: they took nine tenths of the
    time of line muscles. Slices of arrays may be read, but not assigned from arrays.
    """
    return _compiled_once(nb.njit(**_BARE, cache=True, nogil=True)(function))


def kernel_and_inner(function: Callable[..., Any]) -> Any:
    """Compile a function that both Python and kernels call."""
    return _compiled_once(nb.njit(**_ALL, cache=True, forceinline=True)(function))


def inner(function):
    """Function for kernels alone, without allocation; a call from Python raises TypeError.

    It has no wrapper for Python, and numba would jump to an invalid address. Compiled versions are
    therefore not entered in the table for calls from Python. References are not counted, as in
    `bare_kernel`: an evaluation of the elements of a reduced face took three times as long with them.
    """
    return _for_kernels(nb.njit(**_BARE, **_INNER)(function))


def allocating(function):
    """As `inner`, for a function that allocates arrays."""
    return _for_kernels(nb.njit(**_ALL, **_INNER)(function))


def _for_kernels(compiled):
    def refuse(*_, **__):
        raise TypeError(
            f"{compiled.py_func.__name__} can be called in kernels alone: call it in a function that "
            "is decorated with numba.njit"
        )

    def keep(version):
        compiled.overloads[tuple(version.signature.args)] = version

    compiled._compile_for_args, compiled.add_overload = refuse, keep
    return compiled


Ranges = Iterable[tuple[int, int]]


def by_colour(q, part, *_) -> Ranges:
    """Ranges of chunks, one colour after the other; chunks of one colour have no common node."""
    yield from zip(part.colour[:-1].tolist(), part.colour[1:].tolist(), strict=True)


def by_chunk(q, part, *_) -> Ranges:
    """All chunks as one range, for kernels that write only to their own elements."""
    yield 0, part.chunk.size - 1


def in_threads(ranges: Callable[..., Ranges], least: int = CHUNKS):
    """Turn a kernel over first..last into a function without these two arguments.

    It runs over all ranges that `ranges` finds in the arguments. Each range is divided among threads in
    parts of at least `least`; each entry of a result is written by one thread only.
    """

    def decorated(function: Callable[..., None]) -> Callable[..., None]:
        compiled = kernel(function)

        @wraps(function)
        def run(*arguments) -> None:
            for first, last in ranges(*arguments):
                in_shares(compiled, first, last, least, arguments)

        return run

    return decorated
