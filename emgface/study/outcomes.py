"""Trials of one run: those that are known, and the record of those that are computed."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from emgface.run.journal import Entry, Journal, StoredFiles
from emgface.run.observer import Observer, Silent
from emgface.run.runner import Workers
from emgface.run.tasks import Done, Job, Outcome
from emgface.study.stages import Laboratory
from emgface.study.table import Place, PlannedTrial
from emgface.study.workers import Judged, on_laboratory

Entries = dict[tuple[str, str, int, str], Entry]
"""Outcomes of the trials by volunteer, instruction, repetition and strategy."""


@dataclass
class Run:
    """Journal and execution of one run, and the outcomes of all its trials.

    `stopping` returns True if no further trial should begin; `variant` is the label of the present
    variant of the study.
    """

    journal: Journal
    stored: StoredFiles
    workers: int | Workers
    observer: Observer
    stopping: Callable[[], bool]
    variant: str = ""
    entries: list[Entry] = field(default_factory=list)
    muted: set[Place] = field(default_factory=set)

    def label(self, trial: PlannedTrial) -> str:
        """Readable label of a trial of the present variant."""
        return f"{self.variant}: {trial.label}" if self.variant else trial.label

    @contextmanager
    def silently(self) -> Iterator[None]:
        """Do not count trials that are computed again as progress."""
        observer, self.observer = self.observer, Silent()
        try:
            yield
        finally:
            self.observer = observer

    def starting(self, trial: PlannedTrial) -> bool:
        """Note that a trial begins, unless the run is to stop."""
        if self.stopping():
            return False
        self.journal.write("begin", trial=[*trial.place, trial.strategy], variant=self.variant)
        self.observer.working(self.label(trial))
        return True

    def checkpoint(self) -> None:
        """Raise KeyboardInterrupt if the run is to stop."""
        if self.stopping():
            raise KeyboardInterrupt

    def computed(
        self,
        work: Callable[[Laboratory, Job], Outcome],
        laboratory: Laboratory,
        jobs: Sequence[Job],
        stage: str,
    ) -> list[Outcome]:
        """Return the outcomes of jobs of the workers that are not trials, in their order.

        The events of their results are added to those of `laboratory`. Raises KeyboardInterrupt if
        the run is to stop, and WorkerDied if several workers died of the same job.
        """
        found: dict[int, Outcome] = {}

        def starting(index: int) -> bool:
            self.observer.working(f"{stage} {index + 1} of {len(jobs)}")
            return not self.stopping()

        task = on_laboratory(work, laboratory, self.workers)
        for index, done in task.outcomes(jobs, self.workers, starting=starting):
            found[index] = done.outcome
            laboratory.store.events += done.events
            for text in done.messages:
                self.observer.message(text)
        if len(found) < len(jobs):
            raise KeyboardInterrupt
        return [found[index] for index in range(len(jobs))]

    def outcomes(
        self,
        trials: Sequence[PlannedTrial],
        keys: Sequence[str],
        compute_left: Callable[[list[PlannedTrial]], Iterator[tuple[PlannedTrial, Done[Judged]]]],
        store: Path,
    ) -> Entries:
        """Return the outcomes of trials, computed if they are unknown or their results damaged.

        `keys` are the digests of all inputs of the trials; `compute_left` yields trials and their
        outputs in any order, and `store` is the folder of their results. Raises KeyboardInterrupt
        if `compute_left` stops early, and StoreError if the journal cannot be written.
        """
        found: Entries = {}
        absent: dict[tuple[Place, str], str] = {}
        for trial, key in zip(trials, keys, strict=True):
            entry = self.journal.known.get(key)
            if entry is None or not entry.final or not self.stored.intact(entry):
                absent[trial.place, trial.strategy] = key
                continue
            found[*trial.place, trial.strategy] = entry
            if entry.muted:
                self.muted.add(trial.place)
            self.observer.finished(self.label(trial), entry.status)
        left = [trial for trial in trials if (trial.place, trial.strategy) in absent]
        for trial, done in compute_left(left):
            outcome, muted = done.outcome
            entry = self.journal.trial(
                absent[trial.place, trial.strategy],
                outcome,
                done.events,
                store,
                variant=self.variant,
                seconds=done.seconds,
                muted=muted,
            )
            found[*trial.place, trial.strategy] = entry
            if muted:
                self.muted.add(trial.place)
            for text in done.messages:
                self.observer.message(text)
            self.observer.finished(self.label(trial), outcome.status)
        if len(found) < len(trials):
            raise KeyboardInterrupt
        self.entries += found.values()
        return {(*t.place, t.strategy): found[*t.place, t.strategy] for t in trials}
