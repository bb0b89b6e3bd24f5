"""Workers of a small contract: this process, or several processes of this machine."""

import gc
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Final, Protocol

from emgface.children import safe_children
from emgface.errors import WorkerDied

BLAS: Final = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
ELEMENTS: Final = "NUMBA_NUM_THREADS"
"""Environment variables of the number of threads of a process."""


class Workers(Protocol):
    """Interface of what executes jobs."""

    tries: int  #: number of workers that may die of the same job before it is given up

    @property
    def slots(self) -> int:
        """Number of jobs that may be submitted at a time; may change during a run."""
        ...

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Execute a module-level function in a worker."""
        ...

    def result(self, future: Future[Any]) -> Any:
        """Return the result of a finished job, or raise its error; WorkerDied if its worker died."""
        ...

    def stop(self) -> None:
        """Stop all jobs at once."""
        ...

    def end(self) -> None:
        """Release the workers after the jobs that they have begun."""
        ...


class InProcess:
    """Execution in this process, one job after another."""

    tries, slots = 1, 1

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Execute a function at once; an interruption is raised here."""
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future

    def result(self, future: Future[Any]) -> Any:
        """Return the result of a job, or raise its error."""
        return future.result()

    def stop(self) -> None:
        """Do nothing."""

    def end(self) -> None:
        """Do nothing."""


class LocalProcesses:
    """Processes of this machine, each with an equal share of its threads.

    Every process has its own pool, so that a process that dies (killed, out of memory) affects only
    the job that it executed; the next job starts another one.
    """

    tries = 3

    def __init__(self, workers: int, modules: Sequence[str]) -> None:
        self.slots = workers
        self._context = multiprocessing.get_context(
            "forkserver" if sys.platform == "linux" else "spawn"
        )
        self._context.set_forkserver_preload(list(modules))  # pyright: ignore[reportAttributeAccessIssue]
        self._pools = [self._pool() for _ in range(workers)]
        self._pending, self._lock = [0] * workers, threading.Lock()
        self._starting: threading.Thread | None = None

    def _pool(self) -> ProcessPoolExecutor:
        with safe_children():  # its semaphores start a process of `multiprocessing`
            return ProcessPoolExecutor(1, self._context, _prepare, (share_of_threads(self.slots),))

    def each(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Give a job to every process, before any other.

        A request for a copy of the process with the imported modules is answered after its imports.
        A thread waits for the answer, so that this process continues.
        """

        def give() -> None:
            for pool in self._pools:
                pool.submit(function, *arguments)

        with safe_children(**dict.fromkeys(BLAS, "1")):
            if sys.platform != "linux":
                give()
                return
            from multiprocessing import forkserver

            # copies inherit the environment that this process has here
            forkserver.ensure_running()
        self._starting = threading.Thread(target=give, daemon=True)
        self._starting.start()

    def _started(self) -> None:
        """Wait until every process has its first job."""
        if self._starting is not None:
            self._starting.join()
            self._starting = None

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Give a job to the process with the fewest jobs."""
        with self._lock:
            self._started()
            number = self._pending.index(min(self._pending))
            self._pending[number] += 1
            with safe_children(**dict.fromkeys(BLAS, "1")):
                try:
                    future = self._pools[number].submit(function, *arguments)
                except BrokenProcessPool:
                    self._pools[number] = self._pool()
                    future = self._pools[number].submit(function, *arguments)
        future.add_done_callback(lambda _: self._ended(number))
        return future

    def _ended(self, number: int) -> None:
        with self._lock:
            self._pending[number] -= 1

    def result(self, future: Future[Any]) -> Any:
        """Return the result of a job, or raise its error."""
        try:
            return future.result()
        except BrokenProcessPool as error:
            raise WorkerDied(
                "a process ended while it computed (killed, or out of memory): use fewer "
                "--workers or a coarser face if this recurs"
            ) from error

    def stop(self) -> None:
        """Stop all jobs at once."""
        self._started()
        for pool in self._pools:
            # the other children of this process are not ours; executors have no public list of theirs
            for process in list((pool._processes or {}).values()):
                process.kill()

    def end(self) -> None:
        """End the processes after the jobs that they have begun."""
        self._started()
        for pool in self._pools:
            pool.shutdown(wait=True, cancel_futures=True)


def share_of_threads(workers: int) -> int:
    """Threads of each of several processes: its share of the cores, or of NUMBA_NUM_THREADS."""
    named = os.environ.get(ELEMENTS, "")
    affinity = getattr(os, "sched_getaffinity", None)
    cores = len(affinity(0)) if affinity is not None else os.cpu_count() or 1
    return max(1, (int(named) if named.isdecimal() else cores) // workers)


def _prepare(threads: int) -> None:
    """Set the threads of the element loops; the parent receives all signals and stops its workers."""
    os.environ[ELEMENTS] = str(threads)
    if (loops := sys.modules.get("sim.threads")) is not None:
        loops.set_thread_count(threads)
    gc.freeze()  # searches for unreachable objects omit those of the imported modules
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process if its parent has been killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
