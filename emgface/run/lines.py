"""Journal of the runs of a study: one line of JSON per event, in one file per run.

A run writes ``runs/<date>-<host>-<process>.jsonl`` in the folder of its study, and no other process
writes to that file, so that simultaneous runs do not affect each other. Lines are written and
synchronised when they happen. The last field of a line, ``check``, is a checksum of the others: a
line that was cut off or damaged is ignored, and its trial is computed or read again.

The line of a recording contains its digest and the size and times of its file, by which a later run
knows it. The line of a trial contains its outcome with its scores, a few kilobytes, and names its stored
results with their sizes. A later run with the same key (`Laboratory.trial_key`) reuses the trial
without opening these results, as long as their sizes and modification times are the recorded ones.
Dates are for the reader, ``at`` counts seconds from the start of the run, and ``number`` of a run is
larger than those of the runs that it found: clocks that differ or jump do not change their order.
"""

import json
import os
import warnings
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Final

from emgface.errors import JournalWarning

FOLDER: Final = "runs"
LINE_FORMAT: Final = 1
"""Version of the fields of the lines; runs of another one are ignored, and their results read again."""
Line = dict[str, Any]
_EVENT: Final = b'{"event":"%b",'
_CHECK: Final = b',"check":"'


def run_files(folder: Path) -> list[Path]:
    """Files of the runs of a study in order; of simultaneous ones, that changed last at the end."""
    files = (folder / FOLDER).glob("*.jsonl")
    return sorted(files, key=lambda path: (run_number(path), path.stat().st_mtime_ns))


def journal_files(folder: Path) -> list[Path]:
    """Files of the runs of a study as `run_files`, for reading; warns of lines that will be ignored.

    Every reader of a journal obtains its files here, so that none ignores damage in silence.
    """
    files = run_files(folder)
    for sentence in damage(files):
        warnings.warn(sentence, JournalWarning, stacklevel=1)
    return files


def damage(files: Iterable[Path]) -> list[str]:
    """One sentence for each file of a journal that has damaged lines."""
    sentences: list[str] = []
    for path in files:
        numbers = damaged_lines(path)
        if not numbers:
            continue
        shown = ", ".join(map(str, numbers[:5])) + (", …" if len(numbers) > 5 else "")
        one = len(numbers) == 1
        sentences.append(
            f"{'line' if one else 'lines'} {shown} of {path} "
            f"{'is' if one else 'are'} damaged or of another version of emgface, expected lines with "
            "their checksums: what they state is ignored, and the next 'emgface study run' reads or "
            "computes it again"
        )
    return sentences


def run_number(path: Path) -> int:
    """Number of a run, 0 if it is not known."""
    with path.open("rb") as stream:
        first = parsed(stream.readline())
    return 0 if first is None else int(first.get("number", 0))


def lines(path: Path) -> Iterator[tuple[int, Line]]:
    """Read the events of trials and runs with their positions, without scores and damaged lines."""
    return _lines(path, lambda data: not data.startswith(_EVENT % b"recording"))


def lines_of(path: Path, event: str) -> Iterator[tuple[int, Line]]:
    """Read the events of one kind with their positions."""
    begins = _EVENT % event.encode()
    return _lines(path, lambda data: data.startswith(begins))


def _lines(path: Path, wanted: Callable[[bytes], bool]) -> Iterator[tuple[int, Line]]:
    offset = 0
    with path.open("rb") as stream:
        if (parsed(stream.readline()) or {}).get("format", LINE_FORMAT) != LINE_FORMAT:
            return
        stream.seek(0)
        for data in stream:
            if wanted(data) and (line := parsed(data, scores=False)) is not None:
                yield offset, line
            offset += len(data)


def damaged_lines(path: Path) -> list[int]:
    """Numbers, from 1 on, of the lines of a run that are damaged, or of another version.

    The last line may have been cut off when its run was killed; it is not among them.
    """
    with path.open("rb") as stream:
        if (parsed(stream.readline()) or {}).get("format") != LINE_FORMAT:
            return [1]
        stream.seek(0)
        return [
            number
            for number, data in enumerate(stream, 1)
            if data.strip() and parsed(data, scores=False) is None and data.endswith(b"\n")
        ]


def is_cut_off(path: Path) -> bool:
    """Return True if the last line of a run is incomplete."""
    with path.open("rb") as stream:
        stream.seek(0, os.SEEK_END)
        if stream.tell() == 0:
            return True
        stream.seek(-1, os.SEEK_END)
        return stream.read(1) != b"\n"


def written(line: Line) -> bytes:
    """Line of an event with its checksum; scores, if any, are to be its last field."""
    text = json.dumps(line, separators=(",", ":"), allow_nan=False)[:-1].encode()
    return text + _check(text)


def parsed(data: bytes, *, scores: bool = True) -> Line | None:
    """Event of a line, or None if it is damaged or incomplete.

    Without `scores`, which are most of the line, they are not decoded. A quotation mark within a
    text is escaped, so that the names of fields are found in no text.
    """
    text, mark, tail = data.rpartition(_CHECK)
    if mark + tail != _check(text):
        return None
    if not scores and (stages := text.find(b',"stages":[')) >= 0:
        end = text.find(b',"scores":', stages)  # earlier in lines of version 0.2
        text = text[: end if end >= 0 else None]
    return json.loads(text + b"}")


def _check(text: bytes) -> bytes:
    """End of a line: checksum (CRC-32) of the other fields."""
    return b'%b%08x"}\n' % (_CHECK, zlib.crc32(b"}", zlib.crc32(text)))
