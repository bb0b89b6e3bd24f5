"""Processor and wall time of every part of the page from an empty store, and their limit."""

import csv
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pandas as pd

from benchmarks.report import markdown
from studies.science.setup import plan

LIMIT: Final = 30.0
"""Largest time of the whole page on two cores [min]."""
COLUMNS: Final = ("wall", "own", "workers")
UNKNOWN: Final = "not measured"
PROCESSES: Final = Path("/proc")


def processor_time() -> tuple[float, float]:
    """Processor time [s] of this process, and of all processes that it has started.

    The latter are descendants, because workers are copies of a server process. Where the system does
    not list processes (``/proc``), only those that have ended and are children are counted.
    """
    user, system, children_user, children_system, _ = os.times()
    if not PROCESSES.is_dir():
        return user + system, children_user + children_system
    ticks = os.sysconf("SC_CLK_TCK")
    parents: dict[int, int] = {}
    used: dict[int, float] = {}
    for folder in PROCESSES.iterdir():
        if folder.name.isdecimal():
            try:
                fields = (folder / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
            except OSError:
                continue  # it has ended meanwhile
            parents[int(folder.name)] = int(fields[1])
            used[int(folder.name)] = sum(int(value) for value in fields[11:15]) / ticks
    own = os.getpid()
    below = children_user + children_system
    for process, spent in used.items():
        above = process
        while (above := parents.get(above, 0)) not in (0, own):
            pass
        below += spent if above == own else 0.0
    return user + system, below


@contextmanager
def timed(part: str) -> Iterator[None]:
    """Append wall time and processor times of a part of the page to the table of the store.

    The table says if the part was finished. Processes of `kept_processes` must end after the part.
    """
    started, before, done = time.monotonic(), processor_time(), False
    try:
        yield
        done = True
    finally:
        after = processor_time()
        spent = time.monotonic() - started, after[0] - before[0], after[1] - before[1]
        plan.store.mkdir(parents=True, exist_ok=True)
        with (plan.store / "times.csv").open("a", newline="", encoding="utf-8") as file:
            csv.writer(file).writerow((part, *(f"{one:.1f}" for one in spent), int(done)))


def times(store: Path) -> pd.DataFrame:
    """Times [s] of every finished part: those of its first run and of interrupted ones before it.

    Later runs of a part find stored results, so that their times are not those of the page.
    """
    path = store / "times.csv"
    if not path.is_file():
        return pd.DataFrame(columns=list(COLUMNS), index=pd.Index([], name="part"))
    rows = pd.read_csv(path, names=["part", *COLUMNS, "done"])
    earlier = rows.groupby("part")["done"].cumsum() - rows["done"]
    known = rows.groupby("part")["done"].transform("max") > 0
    first = rows[(earlier == 0) & known]
    return first.groupby("part", sort=False)[list(COLUMNS)].sum()


def measured(out: Path) -> pd.DataFrame:
    """Times of the parts of the page [s], those of this store in place of stored ones; written."""
    path, now = out / "cost.csv", times(plan.store)
    if path.is_file():
        before = pd.read_csv(path, index_col="part")
        now = now.combine_first(before).loc[list(dict.fromkeys([*before.index, *now.index]))]
    now.round(1).to_csv(path)
    return now


def on_two_cores(spent: pd.DataFrame) -> float:
    """Time of all parts with two processes on two cores [min].

    The sum of the processor time of the command itself and half of that of its workers; it is an upper
    bound if workers are equally busy, because the command and its workers may compute simultaneously.
    A part whose processor time was not measured counts with its wall time.
    """
    processor = spent["own"] + 0.5 * spent["workers"]
    return float(processor.fillna(spent["wall"]).sum()) / 60.0


def cost(spent: pd.DataFrame) -> str:
    """Section on the measured run time of the page, against the limit on two cores."""
    both = on_two_cores(spent)
    minutes = spent / 60.0
    rows = [
        {
            "part": name,
            "wall [min]": f"{wall:.1f}",
            "processor, command [min]": f"{own:.1f}" if own == own else UNKNOWN,
            "processor, workers [min]": f"{workers:.1f}" if workers == workers else UNKNOWN,
        }
        for name, (wall, own, workers) in zip(
            minutes.index, minutes[list(COLUMNS)].to_numpy(), strict=True
        )
    ]
    unknown = spent[["own", "workers"]].isna().any(axis=1)
    more = ", and the wall time of parts whose processor time was not measured" * bool(
        unknown.any()
    )
    verdict = "met" if both <= LIMIT else "not met"
    return (
        "## Cost\n\n"
        f"On two cores the whole page takes {both:.0f} minutes: the sum of the processor time of the "
        f"command and of half of that of its two workers{more}. The limit of {LIMIT:g} minutes is "
        f"{verdict}. Runs that find stored results of a part do not count. Wall times, "
        f"{minutes['wall'].sum():.0f} minutes in total, were measured while other programs used the "
        "same cores. A part that is the first to require volunteers or motions includes them.\n\n"
        f"{markdown(pd.DataFrame(rows))}\n"
    )
