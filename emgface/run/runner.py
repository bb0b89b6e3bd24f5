"""Execution of independent jobs, in this process, by processes of this machine or a scheduler.

Small meshes do not benefit from threads; independent trials benefit fully from processes. On Linux
local processes are copies of one process that has imported the modules of their work, which takes
seconds; elsewhere libraries may not survive being copied, and every process imports them.
"""

import gc
import importlib
import multiprocessing
import os
import queue
import signal
import sys
import threading
import uuid
from collections import deque
from collections.abc import Callable, Hashable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, Final, Protocol, TypeVar

from emgface.children import safe_children
from emgface.errors import WorkerDied

Job = TypeVar("Job")
Done = TypeVar("Done")

POLL: Final = 0.5
"""Seconds between two questions for new workers or a request to stop, while no job ends."""
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


_kept: LocalProcesses | None = None


@contextmanager
def kept_processes(workers: int, modules: Sequence[str] = ()) -> Iterator[None]:
    """Let all calls of `run_jobs` in the block that ask for processes share them.

    The processes import `modules` immediately, while this process continues.
    """
    global _kept
    if workers == 1:
        yield
        return
    _kept = LocalProcesses(workers, modules)
    try:
        _kept.each(_import, tuple(modules))
        yield
    finally:
        kept, _kept = _kept, None
        kept.end()


def run_jobs(
    work: Callable[[Job], Done],
    jobs: Sequence[Job],
    workers: int | Workers,
    *,
    begin: Callable[..., None],
    arguments: tuple[Any, ...],
    group: Callable[[Job], Hashable] = lambda job: None,
    lost: Callable[[Job, WorkerDied], Done] | None = None,
    starting: Callable[[int], bool] = lambda index: True,
) -> Iterator[tuple[int, Done]]:
    """Execute jobs; yield index and result of each job when it finishes.

    `work` is a module-level function of one job, which is pickled. `workers` is a number of
    processes (those of `kept_processes`, or new ones; 1 is this process), or workers. `begin` is
    called with `arguments` once in every process before its first job; arguments should be small,
    because they travel with every job. A process that has finished a job continues, if possible,
    with one of the same `group`, for which it has prepared itself. `lost` returns the result of a
    job of which `Workers.tries` workers have died; by default WorkerDied is raised. `starting`
    receives the index of a job that is about to begin; if it returns False, no further job begins,
    and the iteration ends after those that have begun.

    If the caller stops (interruption, error), all jobs are stopped at once. Results are stored
    completely or not at all, so that no partial result remains.
    """
    own = isinstance(workers, int) and (workers == 1 or _kept is None)
    executing = _workers(workers, work) if isinstance(workers, int) else workers
    call, finished = uuid.uuid4().hex, queue.SimpleQueue[Future[Done]]()
    waiting: dict[Hashable, deque[int]] = {}
    for index, job in enumerate(jobs):
        waiting.setdefault(group(job), deque()).append(index)
    running, tries = dict[Future[Done], int](), dict[int, int]()

    def following(last: Hashable) -> int | None:
        """Take a job of the group `last`, of a group without a worker, or of any."""
        if not waiting:
            return None
        taken = {group(jobs[index]) for index in running.values()} if len(waiting) > 1 else set()
        chosen = next((g for g in waiting if g not in taken), next(iter(waiting)))
        chosen = last if last in waiting else chosen
        index = waiting[chosen].popleft()
        if not waiting[chosen]:
            del waiting[chosen]
        return index

    def submit(index: int) -> None:
        future = executing.submit(_run, call, begin, arguments, work, jobs[index])
        running[future] = index
        future.add_done_callback(finished.put)

    def fill(last: Hashable = None) -> None:
        while len(running) < executing.slots and (index := following(last)) is not None:
            if not starting(index):
                waiting.clear()
                return
            submit(index)

    try:
        fill()
        while running:
            try:
                future = finished.get(timeout=POLL)
            except queue.Empty:
                fill()
                continue
            index = running.pop(future)
            try:
                done = executing.result(future)
            except WorkerDied as error:
                tries[index] = tries.get(index, 0) + 1
                if tries[index] < executing.tries and starting(index):
                    submit(index)
                    continue
                if lost is None:
                    raise
                done = lost(jobs[index], error)
            if not isinstance(executing, InProcess):
                fill(group(jobs[index]))
            yield index, done
            fill(group(jobs[index]))
    except BaseException:
        executing.stop()
        raise
    finally:
        if own:
            executing.end()


def _workers(count: int, work: Callable[..., Any]) -> Workers:
    """Workers of a number of processes."""
    if count == 1:
        return InProcess()
    return _kept or LocalProcesses(count, [work.__module__])


def _import(modules: tuple[str, ...]) -> None:
    for module in modules:
        importlib.import_module(module)


_begun: str | None = None  #: call of `run_jobs` that this process has begun to work for
_one_at_a_time = threading.RLock()
"""Held by the job of this process; the netCDF library is not safe for several threads."""


def _run(
    call: str,
    begin: Callable[..., None],
    arguments: tuple[Any, ...],
    work: Callable[[Job], Done],
    job: Job,
) -> Done:
    global _begun
    with _one_at_a_time:
        if _begun != call:
            begin(*arguments)
            _begun = call
        return work(job)
