"""Independent jobs in several processes of one thread each.

Small meshes do not benefit from threads; independent trials benefit fully from processes. On Linux
these are copies of one process that has imported the modules of their work, which takes seconds;
elsewhere libraries may not survive being copied, and every process imports them.
"""

import importlib
import itertools
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Hashable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from typing import Any, TypeVar

Job = TypeVar("Job")
Done = TypeVar("Done")

THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


class _Processes:
    """Processes that begin their work when it arrives, and stop at once or after their jobs."""

    def __init__(self, workers: int, modules: Sequence[str]) -> None:
        self._others = {child.pid for child in multiprocessing.active_children()}
        context = multiprocessing.get_context("forkserver" if sys.platform == "linux" else "spawn")
        context.set_forkserver_preload(list(modules))  # pyright: ignore[reportAttributeAccessIssue]
        self._pool = ProcessPoolExecutor(workers, context, _prepare)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Give a job to the next free process."""
        return self._pool.submit(function, *arguments)

    def stop(self) -> None:
        """Stop all jobs at once."""
        for child in multiprocessing.active_children():
            if child.pid not in self._others:
                child.terminate()

    def end(self) -> None:
        """End the processes after the jobs that they have begun."""
        self._pool.shutdown(wait=True, cancel_futures=True)


_kept: _Processes | None = None
_calls = itertools.count()


@contextmanager
def kept_processes(workers: int, modules: Sequence[str] = ()) -> Iterator[None]:
    """Let all calls of `in_processes` in the block share their processes.

    Parameters
    ----------
    workers : int
        Number of processes.
    modules : sequence of str
        Modules that they import immediately, while this process continues.
    """
    global _kept
    if workers == 1:
        yield
        return
    _kept = _Processes(workers, modules)
    try:
        with single_threaded_children():
            for _ in range(workers):
                _kept.submit(_import, tuple(modules))
        yield
    finally:
        kept, _kept = _kept, None
        kept.end()


def in_processes(
    work: Callable[[Job], Done],
    jobs: Sequence[Job],
    workers: int,
    *,
    begin: Callable[..., None],
    arguments: tuple[Any, ...],
    group: Callable[[Job], Hashable] = lambda job: None,
) -> Iterator[tuple[int, Done]]:
    """Run jobs in several processes; yield index and result of each job when it finishes.

    `work` is a module-level function of one job, which is pickled; `begin` is called once in every
    process before its first job, with `arguments`. A process that has finished a job continues, if
    possible, with one of the same `group`, for which it has prepared itself. The processes are those
    of `kept_processes`, or `workers` new ones. If the caller stops (interruption, error), they are
    stopped at once. Results are stored completely or not at all, so that no partial result remains.
    """
    call, processes = next(_calls), _kept or _Processes(workers, [work.__module__])
    waiting, running = list(range(len(jobs))), dict[Future[Done], int]()

    def start(last: Hashable = None) -> None:
        """Begin the first job of the group `last`, of a group without a process, or of any."""
        taken = {group(jobs[index]) for index in running.values()}
        same = (index for index in waiting if group(jobs[index]) == last)
        free = (index for index in waiting if group(jobs[index]) not in taken)
        index = next(same, next(free, waiting[0]))
        waiting.remove(index)
        running[processes.submit(_run, call, begin, arguments, work, jobs[index])] = index

    with single_threaded_children():
        try:
            for _ in range(min(workers, len(jobs))):
                start()
            while running:
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    index = running.pop(future)
                    if waiting:
                        start(group(jobs[index]))
                    yield index, future.result()
        except BaseException:
            processes.stop()
            raise
        finally:
            if processes is not _kept:
                processes.end()


@contextmanager
def single_threaded_children() -> Iterator[None]:
    """Restrict processes started in the block to one thread each."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name)
            else:
                os.environ[name] = value


def _prepare() -> None:
    # The parent receives the interruption and stops the workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _import(modules: tuple[str, ...]) -> None:
    for module in modules:
        importlib.import_module(module)


_begun: int | None = None
"""Call of `in_processes` that this process has begun to work for."""


def _run(
    call: int,
    begin: Callable[..., None],
    arguments: tuple[Any, ...],
    work: Callable[[Job], Done],
    job: Job,
) -> Done:
    global _begun
    if _begun != call:
        begin(*arguments)
        _begun = call
    return work(job)


def _end_with_parent() -> None:
    """End this process if its parent has been killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
