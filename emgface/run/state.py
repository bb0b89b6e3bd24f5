"""State of a study from the journal of its runs: trials, failures, throughput, size by stage."""

import os
import socket
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from emgface.errors import DataError
from emgface.run.lines import FOLDER, Line, damage, journal_files, lines

Name = tuple[str, tuple[str | int, ...]]
"""Variant, and volunteer, instruction, repetition and strategy."""


@dataclass
class Run:
    """One run: its first line, its trials by status, and those that have begun and not ended."""

    path: Path
    first: Line
    finished: Counter[str] = field(default_factory=Counter)
    begun: set[Name] = field(default_factory=set)
    outcome: str = ""
    last_at: float = 0.0
    last_time: str = ""

    @property
    def state(self) -> str:
        """Outcome of the run; "running", "killed", or "unknown" if it is on another machine."""
        if self.outcome:
            return self.outcome
        if self.first["host"] != socket.gethostname() or sys.platform == "win32":
            return f"unknown (on {self.first['host']}, last line of {self.last_time})"
        try:
            os.kill(int(self.first["process"]), 0)
        except ProcessLookupError:
            return "killed"
        except OSError:
            pass
        return "running"


@dataclass
class State:
    """State of a study."""

    total: int = 0  #: trials of the last run that began
    status: Counter[str] = field(default_factory=Counter)  #: trials by status
    #: trials of `status` whose runs had another configuration or code than the last run, and which it
    #: has not confirmed; they may be of another study
    earlier: int = 0
    #: label of a failed trial, and the first line of its reason
    failures: list[tuple[str, str]] = field(default_factory=list)
    #: number and bytes of the stored results of each stage
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict)
    runs: list[Run] = field(default_factory=list)  #: in order
    #: one sentence for each file of the journal with damaged lines, which are ignored
    damage: list[str] = field(default_factory=list)

    def store(self, folder: Path) -> Path:
        """Store of the last run of the study in a folder."""
        return store_of(folder, self.runs[-1].first)

    @property
    def running(self) -> list[str]:
        """Labels of trials that have begun in a run that goes on."""
        return [label(name) for run in self.runs if run.state == "running" for name in run.begun]

    @property
    def throughput(self) -> float:
        """Trials per second of the last run, 0 without any."""
        last = self.runs[-1]
        return sum(last.finished.values()) / last.last_at if last.last_at > 0 else 0.0

    @property
    def remaining(self) -> float | None:
        """Estimated time to the end of the last run [s], None if it cannot be estimated."""
        left = self.total - sum(self.status.values())
        known = left > 0 and self.throughput > 0 and not self.earlier
        return left / self.throughput if known else None


def store_of(folder: Path, facts: Line) -> Path:
    """Store of a run by the first line of its journal."""
    return folder / str(facts["store"])


def read_state(folder: Path) -> State:
    """Read the state of a study from the journal in its folder.

    Trials have the status of their last line; the status of trials computed by an earlier version
    of the study, that is, with other parameters, remains until they are computed again, and they are
    counted as `State.earlier`. Raises DataError if the folder has no journal.
    """
    files = journal_files(folder)
    if not files:
        raise DataError(
            f"{folder} has no journal ({FOLDER}/*.jsonl), expected the folder of a study: specify "
            "that of 'emgface study run --out'"
        )
    state = State(damage=damage(files))
    trials: dict[Name, tuple[str, str]] = {}
    basis: dict[Name, tuple[str, ...]] = {}
    stored: dict[tuple[str, str], int] = {}
    for path in files:
        run: Run | None = None
        for _, line in lines(path):
            if run is None:
                if line["event"] != "run":
                    break  # its first line, without which its store is unknown, is damaged
                run = Run(path, line)
            run.last_at, run.last_time = line["at"], line["time"]
            if line["event"] == "begin":
                run.begun.add(_name(line))
            elif line["event"] == "trial":
                name = _name(line)
                run.begun.discard(name)
                run.finished[line["status"]] += 1
                trials[name], basis[name] = (line["status"], line["reason"]), _basis(run)
                for stage in line["stages"]:
                    stored[stage["stage"], stage["digest"]] = stage["file"][0]
            elif line["event"] == "end":
                run.outcome = line["outcome"]
        if run is not None:
            state.runs.append(run)
    if not state.runs:
        raise DataError(
            f"the journal in {folder} is damaged or of another version of emgface, expected lines of "
            "JSON of this version: run the study again, or use that version"
        )
    state.total = state.runs[-1].first["trials"]
    state.status = Counter(status for status, _ in trials.values())
    last = state.runs[-1]
    state.earlier = sum(
        () not in (one, _basis(last)) and one != _basis(last) for one in basis.values()
    )
    if last.outcome == "finished":  # it has read all trials of its study
        state.earlier = min(state.earlier, max(0, len(trials) - state.total))
    state.failures = [
        (label(name), f"{status.removeprefix('failed:')}: {(reason.splitlines() or [''])[0]}")
        for name, (status, reason) in trials.items()
        if status.startswith("failed")
    ]
    for (stage, _), size in stored.items():
        count, total = state.sizes.get(stage, (0, 0))
        state.sizes[stage] = count + 1, total + size
    return state


def label(name: Name) -> str:
    """Readable label of a trial."""
    return " ".join(map(str, (f"{name[0]}:", *name[1]) if name[0] else name[1]))


def _basis(run: Run) -> tuple[str, ...]:
    """Configuration and code of a run; empty if its first line does not state them."""
    facts = [run.first.get(name) for name in ("configuration", "code")]
    return tuple(map(str, facts)) if all(facts) else ()


def _name(line: Line) -> Name:
    return line["variant"], tuple(line["trial"])
