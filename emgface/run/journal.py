"""Journal of the present run of a study, and the trials of earlier ones."""

import errno
import os
import socket
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from io import RawIOBase
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr

from analysis.trial import Trial
from emgface.errors import StoreError
from emgface.files import result_file, why_not_written
from emgface.run.lines import (
    FOLDER,
    LINE_FORMAT,
    Line,
    journal_files,
    lines,
    parsed,
    run_number,
    written,
)
from emgface.run.provenance import now
from emgface.run.store import Event, add_owner

NOT_FINAL: Final = ("WorkerDied", "StoreError", "ExecutionError", "RecordingChanged")
"""Failures of the machine, not of a trial: a later run computes the trial again."""
NOT_SYNCHRONISED: Final = ("begin", "recording")
"""Events without which a resumed run only repeats some work."""
SCALARS: Final = ("sigma_max", "steps", "run_time", "numerical_error", "motion", "reduced")


@dataclass(frozen=True, slots=True)
class Entry:
    """Position of the line of a trial, and what a resumed run needs to know of it."""

    path: Path
    offset: int
    status: str
    sigma_max: float
    muted: bool
    files: tuple[tuple[str, str, int, int], ...]
    """Stage, digest, size [bytes] and modification time [ns] of the stored results."""

    @classmethod
    def from_line(cls, path: Path, offset: int, line: Line) -> "Entry":
        """Describe the line of a trial."""
        sigma_max = line["sigma_max"]
        return cls(
            path,
            offset,
            line["status"],
            np.nan if sigma_max is None else sigma_max,
            line["muted"],
            tuple((sys.intern(s["stage"]), s["digest"], *s["file"]) for s in line["stages"]),
        )

    @property
    def final(self) -> bool:
        """Return True if the same computation would have the same outcome."""
        return self.status.removeprefix("failed:") not in NOT_FINAL


class Journal:
    """Events of one run, and the trials of all runs in the same folder.

    `folder` is that of the study; `facts` are written to the first line. Raises StoreError if the
    file cannot be written.
    """

    def __init__(self, folder: Path, facts: Mapping[str, Any]) -> None:
        self.known: dict[str, Entry] = {}
        earlier = journal_files(folder)
        for path in earlier:
            for offset, line in lines(path):
                if line["event"] == "trial" and line["key"]:
                    self.known[line["key"]] = Entry.from_line(path, offset, line)
        self._started, self._torn = time.monotonic(), False
        host, process = socket.gethostname(), os.getpid()
        day = now().replace(":", "").replace("-", "")
        # A clock may jump back and a process number recur; an existing file is never continued.
        self.path = folder / FOLDER / f"{day}-{host}-{process}-{os.urandom(3).hex()}.jsonl"
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = self.path.open("xb", buffering=0)
        except OSError as error:
            raise StoreError(
                f"the journal {self.path} cannot be written ({error.strerror}): specify a "
                "writable folder"
            ) from error
        if "store" in facts:
            add_owner(folder / str(facts["store"]), folder)
        number = 1 + max(map(run_number, earlier), default=0)
        self.write("run", format=LINE_FORMAT, number=number, host=host, process=process, **facts)

    def write(self, event: str, **fields: Any) -> int:
        """Write an event and return the position of its line."""
        at = round(time.monotonic() - self._started, 3)
        line = {"event": event, "time": now(), "at": at, **fields}
        data = written(line)
        try:
            if self._torn:
                data = b"\n" + data
            offset = self._stream.tell() + int(self._torn)
            self._torn = True
            written_whole(self._stream, data)
            self._torn = False
            if event not in NOT_SYNCHRONISED:
                os.fsync(self._stream.fileno())
        except OSError as error:
            raise StoreError(
                f"the journal {self.path} cannot be written: "
                f"{why_not_written(error, self.path.parent)}; completed results are stored, run the "
                "same command again to continue"
            ) from error
        return offset

    def trial(
        self,
        key: str,
        trial: Trial,
        events: list[Event],
        store: Path,
        *,
        variant: str,
        seconds: float,
        muted: bool,
    ) -> Entry:
        """Write the outcome of a trial and its stored results."""
        line: Line = {
            "trial": [trial.volunteer, trial.instruction, int(trial.repetition), trial.strategy],
            "variant": variant,
            "key": key,
            "status": trial.status,
            "reason": trial.reason,
            "origin": trial.origin,
            "computed": trial.computed,
            "environments": list(trial.environments),
            **{name: _number(getattr(trial, name)) for name in SCALARS},
            "seconds": round(seconds, 4),
            "muted": muted,
            "stages": _stages(events, store),
            "scores": None if trial.scores is None else _packed(trial.scores),
        }
        offset = self.write("trial", **line)
        entry = Entry.from_line(self.path, offset, line)
        if key:
            self.known[key] = entry
        return entry

    def job(
        self,
        labels: Sequence[str],
        events: list[Event],
        store: Path,
        seconds: float,
        status: str,
        reason: str,
    ) -> None:
        """Write the end of a job of another run table than that of a study, and its stored results.

        It counts as a trial in the state of its folder; a later run does not reuse it.
        """
        self.write(
            "trial",
            trial=labels,
            variant="",
            key="",
            status=status,
            reason=reason,
            seconds=round(seconds, 4),
            stages=_stages(events, store),
        )

    def end(self, outcome: str, events: list[Event]) -> None:
        """Write the outcome of the run and its results of no single trial, and close the file."""
        try:
            self.write("end", outcome=outcome, stages=[asdict(event) for event in events])
        except StoreError:
            if outcome == "finished":
                raise
        finally:
            self._stream.close()


def written_whole(stream: RawIOBase, data: bytes) -> None:
    """Write all bytes; what prevents the rest of a part is known only when it is written as well."""
    rest = memoryview(data)
    while rest:
        count = stream.write(rest)
        if not count:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        rest = rest[count:]


def read_line(entry: Entry) -> Line:
    """Read the line of a trial again; StoreError if it cannot be read any more."""
    try:
        with entry.path.open("rb") as stream:
            stream.seek(entry.offset)
            line = parsed(stream.readline())
    except OSError as error:
        raise StoreError(f"{entry.path} cannot be read ({error.strerror})") from error
    if line is None:
        raise StoreError(
            f"{entry.path} was changed while the study ran, expected that lines are only "
            "appended to it: run the "
            "study again"
        )
    return line


def events_of(entry: Entry, run: Path) -> list[Event]:
    """Results of a trial; those recorded by another run than `run` were reused."""
    if entry.path != run:
        return [Event(stage, digest, "", "reused", 0.0) for stage, digest, *_ in entry.files]
    names = ("stage", "digest", "label", "outcome", "seconds")
    return [Event(*(stage[name] for name in names)) for stage in read_line(entry)["stages"]]


def read_trial(entry: Entry) -> Trial:
    """Read the outcome of a trial again; StoreError if it cannot be read any more."""
    line = read_line(entry)
    volunteer, instruction, repetition, strategy = line["trial"]
    return Trial(
        volunteer,
        instruction,
        repetition,
        strategy,
        None if line["scores"] is None else _unpacked(line["scores"]),
        line["status"],
        line["reason"],
        # a journal of an earlier version does not have all of them
        **{name: np.nan if line.get(name) is None else line[name] for name in SCALARS},
        origin=line["origin"],
        computed=line["computed"],
        environments=tuple(line["environments"]),
    )


def _stages(events: list[Event], store: Path) -> list[Line]:
    """Stored results of a job with the sizes and modification times of their files."""
    return [
        asdict(event)
        | {
            "seconds": round(event.seconds, 4),
            "file": _stat(result_file(store, event.stage, event.digest)),
        }
        for event in events
    ]


def _stat(path: Path) -> tuple[int, int]:
    """Size [bytes] and modification time [ns] of a file, zeros if it does not exist."""
    try:
        status = path.stat()
    except OSError:
        return 0, 0
    return status.st_size, status.st_mtime_ns


class StoredFiles:
    """Sizes and modification times of all results of a store, from one listing of its folders."""

    def __init__(self, store: Path) -> None:
        self.files: dict[tuple[str, str], tuple[int, int]] = {}
        if not store.is_dir():
            return
        for stage in (entry for entry in os.scandir(store) if entry.is_dir()):
            for file in os.scandir(stage.path):
                name, dot, suffix = file.name.rpartition(".")
                if suffix == "nc" and dot and not name.startswith("."):
                    status = file.stat()
                    self.files[stage.name, name] = status.st_size, status.st_mtime_ns

    def intact(self, entry: Entry) -> bool:
        """Return True if the results of a trial are those that it recorded."""
        return all(self.files.get((s, d)) == (size, at) for s, d, size, at in entry.files)


def _number(value: float) -> float | None:
    return None if value != value else float(value)


def _plain(value: Any) -> Any:
    """Return values as JSON, NaN as null."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return _number(value) if isinstance(value, float) else value


def _packed(scores: xr.Dataset) -> Line:
    """Scores as JSON; every digit of a number is kept."""
    return {
        "attrs": {str(k): _plain(v) for k, v in scores.attrs.items()},
        "variables": {
            str(name): [
                list(v.dims),
                "U" if v.dtype.kind in "OUT" else v.dtype.str,
                _plain(v.values),
            ]
            for name, v in scores.variables.items()
        },
    }


def _unpacked(packed: Line) -> xr.Dataset:
    """Scores from `_packed`."""
    made: dict[str, Any] = {}
    for name, (dims, kind, values) in packed["variables"].items():
        made[name] = xr.Variable(dims, np.array(values, str if kind == "U" else np.dtype(kind)))
    dims = {dim for variable in made.values() for dim in variable.dims}
    coords = {name: made.pop(name) for name in [*made] if name in dims}
    return xr.Dataset(made, coords=coords, attrs=packed["attrs"])
