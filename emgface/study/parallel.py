"""Execution of independent jobs, in this process or by the workers of a small contract.

Small meshes do not benefit from threads; independent trials benefit fully from processes. On Linux
local processes are copies of one process that has imported the modules of their work, which takes
seconds; elsewhere libraries may not survive being copied, and every process imports them.
"""

import importlib
import queue
import threading
import uuid
from collections import deque
from collections.abc import Callable, Hashable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from typing import Any, Final, TypeVar

from emgface.errors import WorkerDied
from emgface.study.processes import InProcess, LocalProcesses, Workers

Job = TypeVar("Job")
Done = TypeVar("Done")

POLL: Final = 0.5
"""Seconds between two questions for new workers or a request to stop, while no job ends."""


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
