"""Run tables other than the trials of a study: their journal, progress and outcomes."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

from emgface.study.digest import code_version
from emgface.study.journal import Journal
from emgface.study.observer import Observer
from emgface.study.processes import Workers
from emgface.study.provenance import CODE
from emgface.study.store import Done

Outcome = TypeVar("Outcome")
Labels = tuple[str, ...]


def run_table(
    execute: Callable[[Callable[[int], bool]], Iterator[tuple[int, Done[Outcome]]]],
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

    `execute` receives the function `starting` of `emgface.study.parallel.run_jobs` and yields index
    and output of each job when it finishes. The journal in ``out/runs`` is that of a study, so that
    the commands for the state of a study show `name`, the jobs by their `labels` and the results in
    `store`. `status` returns status and reason of an outcome, ``failed:Name`` for a failure;
    `finished` is called after each job. A repeated run finds its completed results in the store.

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

    found: dict[int, Outcome] = {}
    try:
        for index, done in execute(starting):
            found[index] = done.outcome
            how, why = status(done.outcome)
            journal.job(labels[index], done.events, store, done.seconds, how, why)
            for text in done.messages:
                observer.message(text)
            observer.finished(" ".join(labels[index]), how)
            finished(index, done.outcome)
        if len(found) < len(labels):
            raise KeyboardInterrupt
        outcome = "finished"
    except KeyboardInterrupt:
        outcome = "interrupted"
        raise
    finally:
        journal.end(outcome, [])
    return [found[index] for index in range(len(labels))]
