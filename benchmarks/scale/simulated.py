"""Driver of a study against 1000 simulated workers, whose trials only take time."""

import heapq
import itertools
import threading
import time
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.scale import stub
from emgface.run.journal import Journal, StoredFiles
from emgface.run.observer import Silent
from emgface.run.runner import run_jobs
from emgface.run.tasks import Done
from emgface.study.outcomes import Run
from emgface.study.table import PlannedTrial


class SimulatedWorkers:
    """Workers that finish a job after a random time, exponential with a mean of `seconds`.

    A single thread waits for all of them; the functions of the jobs are not called.
    """

    tries = 1

    def __init__(self, workers: int, seconds: float) -> None:
        self.slots, self._mean = workers, seconds
        self._rng, self._count = np.random.default_rng(0), itertools.count()
        self._due: list[tuple[float, int, Future[Done], PlannedTrial]] = []
        self._changed, self._open = threading.Condition(), True
        threading.Thread(target=self._finish, daemon=True).start()

    def submit(self, function: Any, *arguments: Any) -> Future[Done]:
        """Begin a job."""
        future: Future[Done] = Future()
        due = time.perf_counter() + self._rng.exponential(self._mean)
        with self._changed:
            heapq.heappush(self._due, (due, next(self._count), future, arguments[-1]))
            self._changed.notify()
        return future

    def _finish(self) -> None:
        while self._open:
            with self._changed:
                now = time.perf_counter()
                if not self._due or self._due[0][0] > now:
                    self._changed.wait(self._due[0][0] - now if self._due else 1.0)
                    continue
                _, _, future, trial = heapq.heappop(self._due)
            future.set_result(Done((stub.outcome(trial), False), [], [], self._mean))

    def result(self, future: Future[Done]) -> Done:
        """Return the output of a job."""
        return future.result()

    def stop(self) -> None:
        """Do nothing."""

    def end(self) -> None:
        """End the thread."""
        self._open = False


def thousand(folder: Path, workers: int = 1000, lasting: float = 8.0) -> list[dict[str, Any]]:
    """Throughput of 1000 workers and processor time of the driver, by the duration of a trial.

    Every row lasts `lasting` seconds. Durations are exponential, so that trials end at a constant
    rate from the start.
    """
    rows: list[dict[str, Any]] = []
    for seconds in (20.0, 5.0, 2.0, 0.5):
        trials = stub.planned(workers + int(1.5 * workers * lasting / seconds))
        simulated, place = SimulatedWorkers(workers, seconds), folder / f"{seconds:g}"
        facts = {"study": "simulated workers", "trials": len(trials), "store": "store", "code": ""}
        journal = Journal(place, facts | {"workers": workers})
        study = Run(journal, StoredFiles(place), simulated, Silent(), lambda: False)
        jobs = run_jobs(stub.work, trials, simulated, begin=stub.begin, arguments=(place, 0.0),
                        starting=lambda k, of=trials, study=study: study.starting(of[k]))  # fmt: skip
        began, spent, done = time.perf_counter(), time.process_time(), 0
        for index, output in jobs:
            journal.trial(
                str(index), output.outcome, [], place, variant="", seconds=seconds, muted=False
            )
            done += 1
            if time.perf_counter() > began + lasting:
                break
        wall, used = time.perf_counter() - began, time.process_time() - spent
        simulated.end()
        rows.append({
            "mean duration of a trial [s]": seconds, "trials": done,
            "demanded [1/s]": workers / seconds, "recorded [1/s]": done / wall,
            "driver, processor ms per trial": 1e3 * used / done,
            "driver, share of a core": used / wall,
        })  # fmt: skip
    return rows
