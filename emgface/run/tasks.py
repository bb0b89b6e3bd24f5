"""Tasks of any kind, executed by workers: trials, inversions, sweeps and simulated volunteers.

A task consists of what its jobs share, which every process prepares once, and of one function of
that place and of a job. Its workers write results to a store and return a record of a few
kilobytes; the process of the caller notes them in a journal.
"""

import time
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Generic, Protocol, TypeVar

from analysis.errors import AnalysisError
from emgface.errors import EmgfaceError, ExecutionError, StoreError
from emgface.run.digest import code_version
from emgface.run.journal import Journal
from emgface.run.observer import Observer
from emgface.run.provenance import CODE, require_code
from emgface.run.runner import Workers, run_jobs
from emgface.run.store import Event, Store
from sim.errors import SimulationError

JOB_ERRORS: Final = (EmgfaceError, AnalysisError, SimulationError)
"""Errors of one job that do not stop the others."""
OF_THE_MACHINE: Final = (StoreError, ExecutionError)
"""Failures that the other jobs would share."""
PAUSE: Final = 1.0  #: seconds after which a result that could not be written is tried once more

Given = TypeVar("Given")
Job = TypeVar("Job")
Outcome = TypeVar("Outcome")
Labels = tuple[str, ...]


class Place(Protocol):
    """Data that a process prepares once and uses for all of its jobs."""

    @property
    def store(self) -> Store:
        """Store of the results."""
        ...


P = TypeVar("P", bound=Place)


@dataclass(frozen=True)
class Done(Generic[Outcome]):
    """Output of a worker: outcome of the job, stored results, messages and duration [s]."""

    outcome: Outcome
    events: list[Event]
    messages: list[str]
    seconds: float


@dataclass(frozen=True)
class Task(Generic[Given, P, Job, Outcome]):
    """Work on jobs, which are small because they are sent to the workers, as is `given`.

    Attributes
    ----------
    prepare : module-level function of `given` and of a receiver of messages; returns the place.
    given : data from which a process prepares its place.
    work : module-level function of place and job.
    group : a process that has finished a job continues, if possible, with one of the same group.
    failed : module-level function that returns the outcome of a job with one of the errors
        `JOB_ERRORS`, or of which several workers died (WorkerDied); by default the error is raised.
    """

    prepare: Callable[[Given, Callable[[str], None]], P]
    given: Given
    work: Callable[[P, Job], Outcome]
    group: Callable[[Job], Hashable] = lambda job: None
    failed: Callable[[Job, Exception], Outcome] | None = None

    def outcomes(
        self,
        jobs: Sequence[Job],
        workers: int | Workers,
        *,
        starting: Callable[[int], bool] = lambda index: True,
    ) -> Iterator[tuple[int, Done[Outcome]]]:
        """Execute jobs; yield index and output of each job when it finishes.

        `starting` is that of `run_jobs`. Raises ExecutionError if the workers cannot compute.
        """
        if not jobs:
            return
        yield from run_jobs(
            _work,
            [(self.work, job, self.failed) for job in jobs],
            workers,
            begin=_begin,
            arguments=(self.prepare, self.given, code_version(CODE)),
            group=lambda given: self.group(given[1]),
            lost=_failed,
            starting=starting,
        )


_place: Place | None = None
_messages: list[str] = []
"""Place of a process, and the messages of its present job."""


def _begin(prepare: Callable[..., Place], given: Any, code: str) -> None:
    """Prepare a process, which must have the code of the caller."""
    global _place
    require_code(code)
    _place = prepare(given, _messages.append)


Given_ = tuple[Callable[..., Any], Any, Callable[..., Any] | None]


def _failed(given: Given_, error: Exception) -> Done[Any]:
    """Output of a job with an error."""
    _, job, failed = given
    if failed is None:
        raise error
    return Done(failed(job, error), [], [], 0.0)


def _work(given: Given_) -> Done[Any]:
    """Execute one job in the place of this process."""
    assert _place is not None, "the place of a worker is not prepared"
    work, job, _ = given
    store, _messages[:], started = _place.store, [], time.perf_counter()
    before = len(store.events)
    try:
        try:
            outcome = work(_place, job)
        except StoreError:
            # File systems of clusters fail for moments; a full disk fails again.
            time.sleep(PAUSE)
            outcome = work(_place, job)
    except OF_THE_MACHINE:
        raise
    except JOB_ERRORS as error:
        outcome = _failed(given, error).outcome
    events = store.events[before:]
    del store.events[before:]
    return Done(outcome, events, list(_messages), time.perf_counter() - started)


def run_table(
    task: Task[Given, P, Job, Outcome],
    jobs: Sequence[Job],
    labels: Sequence[Labels],
    *,
    name: str,
    out: Path,
    store: Path,
    workers: int | Workers,
    observer: Observer,
    stopping: Callable[[], bool],
    status: Callable[[Outcome], tuple[str, str]] = lambda outcome: ("ok", ""),
    finished: Callable[[int, Outcome], None] = lambda index, outcome: None,
) -> list[Outcome]:
    """Execute the jobs of a table, note them in a journal and return their outcomes in order.

    The journal in ``out/runs`` is that of a study, so that the commands for the state of a study
    show `name`, the jobs by their `labels` and the results in `store`. `status` returns status and
    reason of an outcome, ``failed:Name`` for a failure; `finished` is called after each job. A
    repeated run finds its completed results in the store.

    Raises KeyboardInterrupt if `stopping` returns True, after the jobs that have begun, and
    StoreError if the journal cannot be written.
    """
    observer.begin(len(labels))
    own = store.resolve() == (out / "store").resolve()
    facts = {
        "study": name,
        "trials": len(labels),
        "workers": workers if isinstance(workers, int) else type(workers).__name__,
        "store": "store" if own else str(store.resolve()),
        "code": code_version(CODE),
    }
    journal, outcome = Journal(out, facts), "failed"

    def starting(index: int) -> bool:
        if stopping():
            return False
        journal.write("begin", trial=labels[index], variant="")
        observer.working(" ".join(labels[index]))
        return True

    outcomes: dict[int, Outcome] = {}
    try:
        for index, done in task.outcomes(jobs, workers, starting=starting):
            outcomes[index] = done.outcome
            how, why = status(done.outcome)
            journal.job(labels[index], done.events, store, done.seconds, how, why)
            for text in done.messages:
                observer.message(text)
            observer.finished(" ".join(labels[index]), how)
            finished(index, done.outcome)
        if len(outcomes) < len(labels):
            raise KeyboardInterrupt
        outcome = "finished"
    except KeyboardInterrupt:
        outcome = "interrupted"
        raise
    finally:
        journal.end(outcome, [])
    return [outcomes[index] for index in range(len(labels))]
