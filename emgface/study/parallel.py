"""Independent jobs in several processes of one thread each.

Small meshes do not benefit from threads; independent trials benefit fully from processes.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Any, TypeVar

Job = TypeVar("Job")
Done = TypeVar("Done")

THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def in_processes(
    work: Callable[[Job], Done],
    jobs: Sequence[Job],
    workers: int,
    *,
    begin: Callable[..., None],
    arguments: tuple[Any, ...],
) -> Iterator[tuple[int, Done]]:
    """Run jobs in several processes; yield index and result of each job when it finishes.

    `work` is a module-level function of one job, which is pickled; `begin` is called once in every
    process with `arguments`. If the caller stops (interruption, error), the processes are stopped
    at once. Results are stored completely or not at all, so that no partial result remains.
    """
    mine = {child.pid for child in multiprocessing.active_children()}
    context = multiprocessing.get_context("spawn")
    with single_threaded_children():
        pool = ProcessPoolExecutor(workers, context, _begin, (begin, arguments))
        try:
            futures = {pool.submit(work, job): index for index, job in enumerate(jobs)}
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:
            for child in multiprocessing.active_children():
                if child.pid not in mine:
                    child.terminate()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


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


def _begin(begin: Callable[..., None], arguments: tuple[Any, ...]) -> None:
    # The parent receives the interruption and stops the workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    begin(*arguments)


def _end_with_parent() -> None:
    """End this process if its parent has been killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
