"""Figures of a report, drawn by other processes beside the work of this one."""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Final

from emgface.report import figures
from emgface.report.figures import Drawn
from emgface.report.results import Results, open_results, study_cube
from emgface.study.parallel import run_jobs

PARTS: Final = ("trial_figures", "score_figures", "baseline_figure", "formant_figure")
"""Functions of `emgface.report.figures` that depend on the folder of a study alone."""

Figures = dict[str, list[Drawn]]


def begin_figures(results: Results, workers: int) -> Future[Figures]:
    """Begin to draw the figures of `PARTS`, with notes in `results` about those that fail.

    With one worker they are drawn at once, in this process.
    """
    if workers == 1:
        done: Future[Figures] = Future()
        done.set_result({name: getattr(figures, name)(results) for name in PARTS})
        return done
    thread = ThreadPoolExecutor(1, "figures")
    begun = thread.submit(_drawn, results, [(name, results.folder) for name in PARTS], workers)
    thread.shutdown(wait=False)
    return begun


def _drawn(results: Results, jobs: Sequence[tuple[str, Path]], workers: int) -> Figures:
    made: Figures = {}
    for index, (drawn, notes) in run_jobs(_part, jobs, workers, begin=_begin, arguments=()):
        made[jobs[index][0]] = drawn
        results.notes += notes
    return made


def _begin() -> None:
    """Every job reads its results from the folder."""


def _part(job: tuple[str, Path]) -> tuple[list[Drawn], list[str]]:
    """Figures of one part, and notes about those that fail."""
    name, folder = job
    # The other parts require the cube alone; recordings and face take a second.
    whole = name == "trial_figures"
    results = open_results(folder) if whole else Results(folder, study_cube(folder))
    before = len(results.notes)
    return getattr(figures, name)(results), results.notes[before:]
