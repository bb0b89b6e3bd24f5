"""Studies over many workers: overhead, throughput and faults.

    python -m benchmarks scale FOLDER PART

PART is one of

    many        10 000 stub trials: memory of the driver, status, resumption, cube
    throughput  stub trials of 0.1 s with 1, 2 and 4 processes, and dask workers started by hand
    faults      killed processes, full disk, damaged files and others: what happens to the results
    kills       a small real study, killed (-9) --trials times at random
    statistics  all tests of a study with 50 to 10 000 volunteers

Except in `kills`, trials are stubs (`benchmarks.scale.stub`): execution, journal and store are those
of a study, and the computation is replaced by waiting. Results are written to FOLDER/PART.json.
"""

import json
import resource
import subprocess
import time
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.report import markdown
from benchmarks.scale.cluster import StartedByHand
from benchmarks.scale.cube import limited
from benchmarks.scale.faults import faults
from benchmarks.scale.kills import kills
from benchmarks.scale.statistics import statistics
from benchmarks.scale.stub import run
from emgface.children import child_environment, python_command
from emgface.run.cluster import DaskWorkers
from emgface.run.state import read_state

PARTS = ("many", "throughput", "faults", "kills", "statistics")


def main(folder: Path, part: str, trials: int = 10_000) -> None:
    """Measure one part and print it as a table."""
    if part not in PARTS:
        raise SystemExit(f"there is no part {part!r}, expected one of {', '.join(PARTS)}")
    folder.mkdir(parents=True, exist_ok=True)
    rows = {
        "many": lambda: many(folder / "many", trials),
        "throughput": lambda: throughput(folder / "throughput"),
        "faults": lambda: faults(folder / "faults"),
        "kills": lambda: kills(folder / "kills", min(trials, 50)),
        "statistics": statistics,
    }[part]()
    (folder / f"{part}.json").write_text(json.dumps(rows, indent=1))
    print(markdown(pd.DataFrame(rows, dtype=object), ".3g"))


def many(folder: Path, trials: int) -> list[dict[str, Any]]:
    """Many stub trials: memory of the driver, time of status and of resumption."""
    made = run(folder, trials, 1)
    began = time.perf_counter()
    code = "from emgface.cli import main; main()"
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    status = subprocess.run(
        python_command("-c", code, "study", "status", str(folder)),
        env=child_environment(),
        check=True,
        capture_output=True,
    )
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    spent = time.process_time()
    read_state(folder)
    state_cpu = time.process_time() - spent
    spent = time.process_time()
    again = run(folder, trials, 1)
    resumed = time.process_time() - spent
    new = trials - made["known"]
    size = sum(path.stat().st_size for path in (folder / "runs").iterdir())
    ways, some = (16, 10**6), trials // 2
    small, large = ([limited(folder, n, k, 0) for k in ways] for n in (some // 2, some))
    assert all(small) and all(large), "the memory of this machine does not suffice"
    limit = round((large[0]["memory_MB"] + large[1]["memory_MB"]) / 2)
    allowed = [bool(limited(folder, some, k, limit)) for k in ways]
    rows = [
        ("trials computed in this call", new),
        ("processor time per trial, driver and store [ms]", 1e3 * made["driver_cpu_s"] / max(new, 1)),
        ("memory of the driver at the start [MB]", made["memory_MB"][0]),
        ("memory after each thousand trials [MB]", made["memory_MB"][1:]),
        ("journal per trial [kB]", size / 1e3 / trials),
        ("state read, processor [s]", state_cpu),
        ("'emgface study status', new process, wall / processor [s]", f"{wall:.2f} / {cpu:.2f}"),
        ("resumption, until done, wall / processor [s]", f"{again['wall_s']:.2f} / {resumed:.2f}"),
        *((f"memory of the cube of {some // 2} / {some} trials, {way} [MB]",
           f"{few['memory_MB']:.0f} / {many['memory_MB']:.0f}")
          for way, few, many in zip(("in parts", "at once"), small, large, strict=True)),
        (f"cube of {some} trials in {limit} MB, in parts / at once",
         " / ".join("written" if one else "not enough memory" for one in allowed)),
        ("cube, processor time per trial [ms]", 1e3 * large[0]["seconds"] / some),
    ]  # fmt: skip
    print(status.stdout.decode())
    return [{"quantity": name, "value": value} for name, value in rows]


def throughput(folder: Path, trials: int = 60, seconds: float = 0.1) -> list[dict[str, Any]]:
    """Trials per second by the number of workers; trials wait instead of computing."""
    rows: list[dict[str, Any]] = []

    def add(name: str, workers: int, measured: dict[str, Any]) -> None:
        rate = trials / measured["wall_s"]
        rows.append({
            "workers": name, "number": workers, "trials per second": rate,
            "of the ideal": rate * seconds / workers,
            "driver, processor ms per trial": 1e3 * measured["driver_cpu_s"] / trials,
        })  # fmt: skip

    for workers in (1, 2, 4):
        name = "in this process" if workers == 1 else "processes"
        add(name, workers, run(folder / f"local_{workers}", trials, workers, seconds))
    try:
        import distributed  # noqa: F401  # pyright: ignore[reportMissingImports]
    except ImportError:
        return rows
    for workers in (1, 2, 4):
        with StartedByHand(folder, workers) as started:
            chosen = DaskWorkers(started.address)
            while chosen.threads < workers:
                time.sleep(1.0)
            run(folder / f"warm_{workers}", 2 * workers, chosen)
            add("dask", workers, run(folder / f"dask_{workers}", trials, chosen, seconds))
            chosen.end()
    return rows
