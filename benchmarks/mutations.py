"""Read randomly damaged files of every format within limits of time and memory, and count the errors.

    python -m benchmarks mutations [--count 500] [--seed 0]

Every reader has a separate process of limited memory. A crash of a parser that runs in the child
process of its reader is counted as a typed error "after a crash"; any other crash ends the process
and is reported as FAILED. Prints, for each reader, the number of damaged files that were still
valid recordings, the typed errors by name, the largest computing time of a read and the growth of
memory.
"""

import collections
import json
import multiprocessing
import random
import resource
import tempfile
import time
from pathlib import Path

import pandas as pd

from benchmarks.report import markdown
from tests.data.test_mutations import FORMATS, attempt, mutated

ROOM = 1 << 30  #: largest growth of the address space [B] in reading a file of a few kilobytes


def examine(name: str, count: int, seed: int) -> dict[str, object]:
    """Damage one file `count` times and read each of the damaged files."""
    outcomes: collections.Counter[str] = collections.Counter()
    longest = 0.0
    with tempfile.TemporaryDirectory() as place:
        path, target = FORMATS[name](Path(place))
        assert attempt(path) == "ok"
        whole, rng = target.read_bytes(), random.Random(f"{name} {seed}")
        held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (held + ROOM, hard))
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for number in range(count):
            target.write_bytes(b"" if number == 0 else mutated(whole, rng))
            began = time.process_time()
            outcomes[attempt(path)] += 1
            longest = max(longest, time.process_time() - began)
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return {
        "size": len(whole),
        "outcomes": dict(outcomes),
        "longest": longest,
        "grown": grown / 1024,
    }


def child(name: str, count: int, seed: int, place: str) -> None:
    """Examine one reader and write the result to a file."""
    Path(place).write_text(json.dumps(examine(name, count, seed)))


def main(count: int = 500, seed: int = 0) -> None:
    """Examine all readers."""
    context = multiprocessing.get_context("spawn")
    rows: list[dict[str, object]] = []
    faults = 0
    for name in FORMATS:
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / "result.json"
            process = context.Process(target=child, args=(name, count, seed, str(place)))
            process.start()
            process.join()
            if not place.exists():
                rows.append({"reader": name, "errors": f"FAILED, exit {process.exitcode}"})
                faults += 1
                continue
            found = json.loads(place.read_text())
        outcomes = found["outcomes"]
        rows.append(
            {
                "reader": name,
                "bytes": found["size"],
                "valid": outcomes.pop("ok", 0),
                "typed": sum(outcomes.values()),
                "CPU s most": found["longest"],
                "MiB grown": found["grown"],
                "errors": ", ".join(f"{key} {value}" for key, value in sorted(outcomes.items())),
            }
        )
    print(markdown(pd.DataFrame(rows)))
    raise SystemExit(1 if faults else 0)
