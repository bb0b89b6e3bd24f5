"""Damage files of every format at random, and see that each read ends in time, room and words.

    python benchmarks/mutations.py [--count 500] [--seed 0]

Every reader has a process of its own, whose memory is limited. A crash of a parser that runs in the
child process of its reader is counted as a typed error "after a crash"; any other crash ends the
process and is reported as FAILED. Prints, for each reader, how many damaged files were still valid
recordings, the typed errors by name, the most computing time of a read and the growth of memory.
"""

import argparse
import collections
import json
import multiprocessing
import random
import resource
import sys
import tempfile
import time
from pathlib import Path

from tests.data.test_mutations import FORMATS, attempt, mutated

ROOM = 1 << 30
"""Bytes that reading a file of a few kilobytes may add to the address space."""


def examine(name: str, count: int, seed: int) -> dict[str, object]:
    """Damage one file `count` times and read it."""
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
    """Examine one reader and leave the result in a file."""
    Path(place).write_text(json.dumps(examine(name, count, seed)))


def main() -> int:
    """Examine all readers."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    context = multiprocessing.get_context("spawn")
    faults = 0
    head = ("reader", "bytes", "valid", "typed", "CPU s most", "MiB grown", "errors")
    print(("{:20s} {:>6s} {:>6s} {:>6s} {:>10s} {:>10s}  {}").format(*head))
    for name in FORMATS:
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / "result.json"
            process = context.Process(
                target=child, args=(name, given.count, given.seed, str(place))
            )
            process.start()
            process.join()
            if not place.exists():
                print(f"{name:20s} FAILED, exit {process.exitcode}", flush=True)
                faults += 1
                continue
            found = json.loads(place.read_text())
        outcomes = found["outcomes"]
        valid = outcomes.pop("ok", 0)
        told = ", ".join(f"{key} {value}" for key, value in sorted(outcomes.items()))
        typed = sum(outcomes.values())
        print(f"{name:20s} {found['size']:6d} {valid:6d} {typed:6d} {found['longest']:10.3f} "
              f"{found['grown']:10.1f}  {told}", flush=True)  # fmt: skip
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
