"""Cube of a study of stub trials, written with a limit of the memory.

    python -m benchmarks.scale.cube FOLDER TRIALS VOLUNTEERS_AT_A_TIME LIMIT

FOLDER contains the journal of `benchmarks.scale.stub`; LIMIT [MB] is the memory allowed in addition
to that of the imported modules and of the journal, 0 for none. One line of JSON is printed.
"""

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from benchmarks.scale.stub import STRATEGIES, memory, planned
from emgface.children import child_environment, python_command
from emgface.run.journal import Entry
from emgface.run.lines import lines, run_files
from emgface.study import assembly
from emgface.study.configuration import StudyConfiguration
from emgface.study.intake import Intake
from emgface.study.outcomes import Entries
from emgface.study.table import PlannedTrial, Recording


def stub_cube(
    path: Path,
    trials: Sequence[PlannedTrial],
    entries: Entries,
    checkpoint: Callable[[], None] = lambda: None,
) -> Path:
    """Write the cube of stub trials, which have neither face nor baselines."""
    recordings = tuple(
        Recording(place, "digest", Path("_".join(map(str, place)) + ".nc"), None, "simulated", "w", ())
        for place in dict.fromkeys(trial.place for trial in trials)
    )  # fmt: skip
    laboratory: Any = SimpleNamespace(
        face=SimpleNamespace(attrs={"name": "none", "origin": "generated"}),
        face_digest="none",
        study=SimpleNamespace(strategy_names=STRATEGIES),
    )
    computed = assembly.Computed((), laboratory, entries, {}, None)
    study = StudyConfiguration(name="stub")
    return assembly.write_cube(path, study, [computed], Intake(recordings, {}), trials, checkpoint)


def limited(folder: Path, trials: int, at_a_time: int, limit: int) -> dict[str, float]:
    """Write the cube in a new process; its measurements, none if the memory did not suffice."""
    done = subprocess.run(
        python_command("-W", "ignore", "-m", __name__, *map(str, (folder, trials, at_a_time, limit))),
        env=child_environment(), capture_output=True, text=True,
    )  # fmt: skip
    if done.returncode and "MemoryError" not in done.stderr:
        raise RuntimeError(done.stderr[-2000:])
    return json.loads(done.stdout) if done.returncode == 0 else {}


def main(folder: Path, count: int, at_a_time: int, limit: int) -> None:
    """Write the cube and print time and memory."""
    trials = planned(count)
    entries = {
        tuple(line["trial"]): Entry.from_line(path, offset, line)
        for path in run_files(folder)
        for offset, line in lines(path)
        if line["event"] == "trial"
    }
    stub_cube(folder / "first.nc", trials[:72], entries)  # imports what writing requires
    assembly.AT_A_TIME = at_a_time  # pyright: ignore[reportAttributeAccessIssue]
    before, began = memory(), time.process_time()
    if limit:
        status = Path("/proc/self/status").read_text()
        in_use = 1024 * int(status.split("VmData:")[1].split()[0])
        most = in_use + limit * 10**6
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    path = stub_cube(folder / f"cube_{at_a_time}.nc", trials, entries)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
    print(json.dumps({
        "memory_MB": peak - before, "seconds": time.process_time() - began,
        "file_MB": os.path.getsize(path) / 1e6,
    }))  # fmt: skip


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
