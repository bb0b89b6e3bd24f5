"""Time from the start of a process to its first result, and the memory required.

Every measurement is a separate process that prints the end of each phase; its parent measures the
time. Kernels are loaded from disk, because a first process is not counted.
"""

import json
import statistics
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import pandas as pd

from benchmarks.first_output import PHASES
from benchmarks.report import finish, say
from emgface.children import child_environment, python_command
from emgface.errors import DataError

VOLUMES: Final = ("pointwise", "element", "nodal", "hard")
IMPORTED: Final = (
    "numpy, scipy.sparse, numba, xarray",
    "sim",
    "emgface.face.motion",
    "emgface.cli",
)
"""Packages whose import time is measured."""


def import_seconds(what: str) -> float:
    """Wall time of a fresh interpreter that imports modules and ends [s]."""
    start = time.perf_counter()
    command = python_command("-c", f"import {what}")
    subprocess.run(command, env=child_environment(), check=True, capture_output=True)
    return time.perf_counter() - start


def first_result(face: Path | None, volume: str) -> tuple[dict[str, float], float]:
    """Seconds of every phase of a new process until its first output, and its peak memory [B].

    The face is the coarse template face if no file is given. Raises `DataError` if the process
    fails.
    """
    task = json.dumps({"face": None if face is None else str(face), "volume": volume})
    start = time.perf_counter()
    child = subprocess.Popen(
        python_command("-m", "benchmarks.first_output", task),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=child_environment() | {"PYTHONUNBUFFERED": "1"},
    )
    assert child.stdout is not None and child.stderr is not None
    seconds: dict[str, float] = {}
    peak = float("nan")
    for line in child.stdout:
        word, _, value = line.strip().partition("=")
        if word == "peak":
            peak = float(value)
        elif word in PHASES:
            now = time.perf_counter()
            seconds[word], start = now - start, now
    printed = child.stderr.read()
    if child.wait() != 0 or set(seconds) != set(PHASES):
        last = (printed.strip().splitlines() or ["it printed nothing"])[-1]
        raise DataError(f"a new process failed: {last}; expected it to simulate the face")
    return seconds, peak


def measure(
    face: Path | None = None, *, volumes: Sequence[str] = VOLUMES, repeats: int = 3
) -> pd.DataFrame:
    """Time new processes, `repeats` per case, for every treatment of the volume and imported module.

    Times are medians, memory is the largest, after 0.1 s of motion. Raises `DataError` if a process
    fails.
    """
    rows: list[dict[str, object]] = []
    for volume in volumes:
        say(f"{volume}, first run")
        first_result(face, volume)
        runs: list[tuple[dict[str, float], float]] = []
        for k in range(repeats):
            say(f"{volume}, {k + 1} of {repeats}")
            runs.append(first_result(face, volume))
        seconds = {p: statistics.median(run[p] for run, _ in runs) for p in PHASES}
        row = {f"{phase} s": value for phase, value in seconds.items()}
        row |= {"first result s": sum(seconds.values()), "peak MB": max(p for _, p in runs) / 1e6}
        rows.append({"process": f"first output, {volume}", **row})
    for what in IMPORTED:
        say(f"import {what}")
        taken = statistics.median(import_seconds(what) for _ in range(repeats))
        rows.append({"process": f"import {what}", "first result s": taken})
    return pd.DataFrame(rows)


def main(out: Path = Path("bench"), face: Path | None = None) -> None:
    """Measure, print and store."""
    finish("start", measure(face), out)
