"""Stub trials: the execution, journal and store of a study without its computation.

    python -m benchmarks.scale.stub FOLDER TRIALS [--workers N] [--scheduler ADDRESS] [--seconds S]

Every trial writes one trajectory of ten markers to the store and returns scores of ten markers. The
command runs or resumes such a study and prints its measurements as one line of JSON.
"""

import json
import os
import resource
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import xarray as xr

from analysis.trial import Trial
from emgface.cli.machine import graceful_stop
from emgface.errors import EmgfaceError, StoreError, WorkerDied
from emgface.muscles import LIP_MARKERS
from emgface.run.cluster import DaskWorkers
from emgface.run.digest import text_digest
from emgface.run.journal import Journal, StoredFiles
from emgface.run.observer import Silent
from emgface.run.runner import Workers, run_jobs
from emgface.run.store import Stage, Store
from emgface.run.tasks import PAUSE, Done
from emgface.study.outcomes import StudyRun
from emgface.study.table import PlannedTrial

MOTION = Stage("motion", ("benchmarks.scale.stub",))
STRATEGIES = ("act_all", "act_3", "act_rel")
_store: Store | None = None
_seconds = 0.0


def planned(count: int) -> list[PlannedTrial]:
    """Trials of as many volunteers as needed, with 6 instructions, 4 repetitions, 3 strategies."""
    trials: list[PlannedTrial] = []
    for k in range(count):
        rest, strategy = divmod(k, 3)
        rest, repetition = divmod(rest, 4)
        volunteer, instruction = divmod(rest, 6)
        place = (f"S{volunteer + 1:05d}", "ABCDEF"[instruction], repetition + 1)
        trials.append(PlannedTrial(place, STRATEGIES[strategy], None))
    return trials


def outcome(trial: PlannedTrial) -> Trial:
    """Scores with all variables of a real trial, from the label of the trial."""
    rng = np.random.default_rng(int(text_digest(trial.label)[:8], 16))
    scores = xr.Dataset(
        {name: ("marker", rng.uniform(size=10)) for name in ("rho", "amplitude_ratio", "rmse")}
        | {f"scalar_{k}": ((), rng.uniform()) for k in range(20)},
        coords={"marker": list(LIP_MARKERS)},
        attrs={"origin": "simulated", "form": "consistent"},
    )
    return Trial(*trial.place, trial.strategy, scores, sigma_max=3e5, steps=160, run_time=1.0)


def begin(folder: Path, seconds: float) -> None:
    """Open the store of a worker."""
    global _store, _seconds
    _store, _seconds = Store(folder, report=lambda text: print(text, file=sys.stderr)), seconds


def work(trial: PlannedTrial) -> Done:
    """Store the motion of a trial and return its outcome."""
    assert _store is not None, "begin was not called"

    def compute() -> xr.Dataset:
        time.sleep(_seconds)
        rng = np.random.default_rng(int(text_digest(trial.label)[:8], 16))
        values = rng.normal(size=(10, 3, 40))
        return xr.Dataset({"position": (("marker", "axis", "time"), values)})

    started, before = time.perf_counter(), len(_store.events)
    try:
        _store.get_or_compute(MOTION, {"trial": trial.label}, {}, compute, label=trial.label)
    except StoreError:
        time.sleep(PAUSE)
        _store.get_or_compute(MOTION, {"trial": trial.label}, {}, compute, label=trial.label)
    events = _store.events[before:]
    del _store.events[before:]
    return Done((outcome(trial), False), events, [], time.perf_counter() - started)


def lost(trial: PlannedTrial, error: WorkerDied) -> Done:
    """Failure of a trial whose workers died."""
    return Done((Trial.failed(*trial.place, trial.strategy, error), False), [], [], 0.0)


def memory() -> float:
    """Memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


class Watch(Silent):
    """Memory of the driver at every thousandth trial."""

    def __init__(self) -> None:
        self.done, self.memory = 0, [memory()]

    def finished(self, label: str, status: str) -> None:
        """Count a trial."""
        self.done += 1
        if self.done % 1000 == 0:
            self.memory.append(memory())


def run(folder: Path, count: int, workers: int | Workers, seconds: float = 0.0) -> dict[str, Any]:
    """Run or resume a study of stub trials; measured times [s] and memory [MB]."""
    began, spent = time.perf_counter(), _processor()
    store = folder.resolve() / "store"
    store.mkdir(parents=True, exist_ok=True)
    trials = planned(count)
    facts = {"study": "stub trials", "trials": count, "store": "store", "code": "",
             "workers": workers if isinstance(workers, int) else type(workers).__name__}  # fmt: skip
    journal, watch = Journal(folder, facts), Watch()
    first: list[float] = []

    def compute(left: list[PlannedTrial]) -> Iterator[tuple[PlannedTrial, Done]]:
        first.append(time.perf_counter() - began)
        jobs = run_jobs(work, left, workers, begin=begin, arguments=(store, seconds), lost=lost,
                        starting=lambda k: study.starting(left[k]))  # fmt: skip
        for index, done in jobs:
            yield left[index], done

    outcome_ = "failed"
    with graceful_stop() as stopping:
        study = StudyRun(journal, StoredFiles(store), workers, watch, stopping)
        known = len(journal.known)
        try:
            keys = [text_digest(trial.label) for trial in trials]
            entries = study.outcomes(trials, keys, compute, store)
            outcome_ = "finished"
        except KeyboardInterrupt:
            outcome_ = "interrupted"
            raise
        finally:
            journal.end(outcome_, [])
    wall, used = time.perf_counter() - began, _processor()
    return {
        "trials": count, "known": known, "status": sorted({e.status for e in entries.values()}),
        "wall_s": wall, "until_first_trial_s": first[0],
        "driver_cpu_s": used[0] - spent[0], "workers_cpu_s": used[1] - spent[1],
        "memory_MB": [round(value, 1) for value in watch.memory],
    }  # fmt: skip


def _processor() -> tuple[float, float]:
    """Processor time of this process, and of its children that have ended [s]."""
    own, children = (
        resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return own.ru_utime + own.ru_stime, children.ru_utime + children.ru_stime


def main(
    folder: Path,
    count: int,
    workers: Annotated[int, typer.Option()] = 1,
    scheduler: Annotated[str | None, typer.Option()] = None,
    seconds: Annotated[float, typer.Option()] = 0.0,
    user: Annotated[int | None, typer.Option(help="Effective user, if started by root.")] = None,
) -> None:
    """Run or resume a study of stub trials and print its measurements."""
    if user is not None:
        import multiprocessing.pool  # the user may not read the library of Python # noqa: F401

        os.seteuid(user)
    chosen: int | Workers = workers
    try:
        chosen = DaskWorkers(scheduler) if scheduler else workers
        print(json.dumps(run(folder, count, chosen, seconds)))
    except EmgfaceError as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    finally:
        if not isinstance(chosen, int):
            chosen.end()


if __name__ == "__main__":
    from benchmarks.scale.stub import main as named  # dask pickles functions of __main__ by value

    typer.run(named)
