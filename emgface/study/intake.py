"""Recordings of a study, identified by the workers and known again by name, size and times."""

import os
import re
import time
import unicodedata
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Final

import xarray as xr

from emgface.errors import DataError, EmgfaceError, FeatureWarning, listed
from emgface.files import absence
from emgface.muscles import INSTRUCTIONS
from emgface.plugins import plugins
from emgface.recordings.dataset import candidates, none_found, read_recordings
from emgface.recordings.exclusions import Exclusion, Place, reason_to_exclude
from emgface.recordings.labels import read_label_map
from emgface.recordings.trial_names import is_pattern
from emgface.run.digest import code_version, file_digest, text_digest
from emgface.run.lines import Line, journal_files, lines_of
from emgface.run.observer import Observer, Silent
from emgface.run.provenance import CODE
from emgface.run.runner import Workers, run_jobs
from emgface.schema.validation import schema_folder
from emgface.study.configuration import RecordingsConfiguration
from emgface.study.outcomes import begin_reading, identified
from emgface.study.table import Recording

PER_JOB: Final = 32  #: recordings that a worker reads at a time; fewer are read in this process
SETTLED_AGE: Final = 2.0
"""Age [s] from which a change of a file is visible in its times, also on coarse file systems."""
ALONE: Final = (".nc",)
"""Suffixes of recordings without further files, which are not read again if they are unchanged."""

File = tuple[str, int, int, int]
"""Path, size [bytes], and times of the last change of content and of the entry [ns]."""


@dataclass(frozen=True)
class Intake:
    """Identified recordings of a folder, in the order of the design, and the unreadable files."""

    recordings: tuple[Recording, ...]
    unreadable: dict[Path, EmgfaceError]
    #: fields of the lines of the journal by which a later run knows the recordings read now
    read: list[Line] = field(default_factory=list[Line])

    @property
    def origin(self) -> str:
        """Origin of the recordings, measured or simulated, equal for all."""
        return self.recordings[0].origin

    @property
    def world(self) -> str:
        """World of simulated volunteers; empty for measured recordings."""
        return self.recordings[0].world

    @cached_property
    def usable(self) -> dict[str, list[Recording]]:
        """Usable recordings by volunteer."""
        volunteers: dict[str, list[Recording]] = {}
        for one in self.recordings:
            if one.error is None and not one.excluded:
                volunteers.setdefault(one.place[0], []).append(one)
        return volunteers


def take_in(
    configuration: RecordingsConfiguration,
    exclude: Sequence[Exclusion] = (),
    *,
    study: Path | None = None,
    workers: int | Workers = 1,
    observer: Observer | None = None,
    stopping: Callable[[], bool] = lambda: False,
) -> Intake:
    """Identify the recordings selected by a configuration, in the order of the design.

    A recording that identifies its trial but lacks something required by the study is included with
    the error; its trials fail, the others are computed. Trials in `exclude` are included with the
    reason and not computed. Recordings are read by `workers`, except those that the journal in the
    folder `study` knows; a file whose content changed without its size and times is noticed when a
    trial is computed from it.

    Raises DataError if the folder contains no recording, none of the selection, or two of the same
    trial, ConfigurationError if the mapping contains an unknown entry, and KeyboardInterrupt if
    `stopping` returns True.
    """
    read_label_map(configuration.mapping)
    listed = time.time()
    listed_files = candidates(configuration.folder)
    files = [recorded_file(path) for path in listed_files if path.exists()]
    reader = reader_digest(configuration.mapping)
    known = {} if study is None else _known(study, reader, configuration.mapping)
    results: dict[File, Recording | EmgfaceError | None] = {
        file: known[file] for file in files if file in known
    }
    unread = [file for file in files if file not in results]
    new = _read(unread, configuration.mapping, workers, observer or Silent(), stopping)
    results.update(new)
    taken: dict[Place, Recording] = {}
    # Links to absent files.
    unreadable: dict[Path, EmgfaceError] = {
        path: DataError(absence(path, "a recording")) for path in listed_files if not path.exists()
    }
    n_files = len(unreadable)
    for file in files:
        path, given = Path(file[0]), results[file]
        if given is None:
            continue
        n_files += 1
        if isinstance(given, EmgfaceError):
            unreadable[path] = given
            continue
        place = given.place
        if not _selected(place, configuration):
            continue
        if place in taken:
            raise DataError(
                f"{_within(path, configuration.folder)} and "
                f"{_within(taken[place].path, configuration.folder)} are both volunteer {place[0]}, "
                f"instruction {place[1]}, repetition {place[2]}: remove or relabel one"
            )
        taken[place] = replace(given, excluded=reason_to_exclude(place, exclude))
    if not n_files:
        none_found(configuration.folder)
    if not taken and unreadable:
        path, first = next(iter(unreadable.items()))
        more = f" (and {len(unreadable) - 1} more files)" if len(unreadable) > 1 else ""
        raise type(first)(f"{first}{more}") from first
    if not taken:
        raise DataError(
            f"none of {n_files} recordings in {configuration.folder} is of the selected "
            "volunteers, instructions and repetitions: extend the selection"
        )
    _require_one_kind(taken.values(), configuration.folder)
    require_one_spelling(taken)
    for sentence in copies(taken.values(), configuration.folder):
        warnings.warn(sentence, FeatureWarning, stacklevel=2)
    order = list(INSTRUCTIONS)
    places = sorted(taken, key=lambda p: (p[0], order.index(p[1]), p[2]))
    lines = [
        _line(file, reader, given) for file, given in new.items() if _lasting(file, given, listed)
    ]
    return Intake(tuple(taken[place] for place in places), unreadable, lines)


def _within(path: Path, folder: Path) -> str:
    """Path of a file within the folder of the recordings."""
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else str(path)


def require_one_spelling(places: Iterable[Place]) -> None:
    """Refuse volunteers whose codes differ only in case, spaces or leading zeros (DataError).

    They would be counted as two independent persons.
    """
    spellings: dict[str, set[str]] = {}
    for volunteer, _, _ in places:
        folded = "".join(unicodedata.normalize("NFKC", volunteer).casefold().split())
        spellings.setdefault(re.sub(r"(?<!\d)0+(?=\d)", "", folded), set()).add(volunteer)
    for several in spellings.values():
        if len(several) > 1:
            raise DataError(
                f"the recordings state the volunteers {' and '.join(map(repr, sorted(several)))}, which "
                "would count as different persons: relabel them with one spelling, or, if they are "
                "different persons, with codes that differ in more than case, spaces and zeros"
            )


def copies(recordings: Iterable[Recording], folder: Path) -> list[str]:
    """Sentences on recordings with exactly the same samples, which would count as several trials."""
    same: dict[str, list[Recording]] = {}
    for one in recordings:
        if one.signals and not one.excluded and one.error is None:
            same.setdefault(one.signals, []).append(one)
    return [
        f"{listed([f'{_within(one.path, folder)} ({one.label})' for one in group])} contain the same "
        "samples, so that one trial would count several times: remove the copies, or exclude them"
        for group in same.values()
        if len(group) > 1
    ]


def _read(
    files: Sequence[File],
    mapping: Path | None,
    workers: int | Workers,
    observer: Observer,
    stopping: Callable[[], bool],
) -> dict[File, Recording | EmgfaceError | None]:
    """Read files by the workers; None for those that are not recordings."""
    jobs = [files[start : start + PER_JOB] for start in range(0, len(files), PER_JOB)]

    def starting(index: int) -> bool:
        observer.working(f"recording {PER_JOB * index + 1} of {len(files)}")
        return not stopping()

    outcomes: dict[File, Recording | EmgfaceError | None] = {}
    done = run_jobs(
        identified,
        [[Path(file[0]) for file in job] for job in jobs],
        workers if len(jobs) > 1 else 1,
        begin=begin_reading,
        arguments=(mapping, code_version(CODE)),
        starting=starting,
    )
    for index, results in done:
        outcomes.update(zip(jobs[index], results, strict=True))
    if len(outcomes) < len(files):
        raise KeyboardInterrupt
    return outcomes


def recorded_file(path: Path) -> File:
    """Describe a file without opening it."""
    path = path.absolute()  # workers may have another working folder
    try:
        status = path.stat()
    except OSError as error:
        raise DataError(
            f"{path} cannot be read ({error.strerror}), expected a recording: check its permissions"
        ) from error
    return str(path), status.st_size, status.st_mtime_ns, status.st_ctime_ns


def _mapping_digest(mapping: Path | None) -> str:
    if mapping is None:
        return ""
    return text_digest(str(mapping)) if is_pattern(mapping) else file_digest(mapping)


def reader_digest(mapping: Path | None) -> str:
    """Digest of what determines the description of a recording besides its file."""
    code = code_version(("emgface.recordings", "emgface.schema", "emgface.study.table"))
    code += "".join(f" {one.version()}" for one in plugins("reader").values())
    declared = file_digest(schema_folder() / "recording.json")
    return text_digest(f"{code} {declared} {_mapping_digest(mapping)}")


def _lasting(file: File, given: Recording | EmgfaceError | None, listed: float) -> bool:
    """Return True if a usable recording can be known again by its file, listed at a time [s]."""
    return (
        isinstance(given, Recording)
        and given.error is None
        and os.path.splitext(file[0])[1].lower() in ALONE
        and abs(listed - 1e-9 * file[3]) > SETTLED_AGE
    )


def _line(file: File, reader: str, given: Recording | EmgfaceError | None) -> Line:
    assert isinstance(given, Recording), "only recordings are noted"
    return {
        "file": file,
        "reader": reader,
        "place": given.place,
        "digest": given.digest,
        "origin": given.origin,
        "world": given.world,
        "channels": given.channels,
        "signals": given.signals,
    }


def _known(study: Path, reader: str, mapping: Path | None) -> dict[File, Recording]:
    """Recordings in the journal of a study that were read in the same way."""
    recordings: dict[File, Recording] = {}
    for path in journal_files(study):
        for _, line in lines_of(path, "recording"):
            if line["reader"] == reader:
                name, size, modified, changed = line["file"]
                volunteer, instruction, repetition = line["place"]
                recordings[name, size, modified, changed] = Recording(
                    (volunteer, instruction, repetition),
                    line["digest"],
                    Path(name),
                    None if mapping is None else mapping.absolute(),
                    line["origin"],
                    line["world"],
                    tuple(line["channels"]),
                    line["signals"],
                )
    return recordings


def _require_one_kind(recordings: Iterable[Recording], folder: Path) -> None:
    """Refuse recordings of several origins or worlds."""
    recordings = list(recordings)
    if len({r.origin for r in recordings}) > 1:
        raise DataError(
            f"{folder} contains measured and simulated recordings, which "
            "cannot share a cube: run a study of each"
        )
    worlds = {r.world for r in recordings}
    if len(worlds) > 1:
        raise DataError(
            f"{folder} contains volunteers of several worlds "
            f"({', '.join(sorted(world or 'without a name' for world in worlds))}), which "
            "cannot share a cube: run a study of each"
        )


def take_in_references(configuration: RecordingsConfiguration) -> dict[str, list[xr.Dataset]]:
    """Read the maximum-effort recordings, grouped by volunteer.

    Raises DataError if no reference folder is configured, or one of its files cannot be read.
    """
    if configuration.reference_folder is None:
        raise DataError(
            "normalisation over a reference requires maximum-effort recordings: set "
            "recordings.reference_folder"
        )
    grouped: dict[str, list[xr.Dataset]] = {}
    for path, given in read_recordings(
        configuration.reference_folder, mapping=configuration.mapping
    ):
        if isinstance(given, EmgfaceError):
            raise given
        volunteer = str(given.attrs.get("volunteer", ""))
        if not volunteer:
            raise DataError(f"{path.name} has no attribute volunteer: set it")
        grouped.setdefault(volunteer, []).append(given)
    return grouped


def _selected(place: Place, configuration: RecordingsConfiguration) -> bool:
    volunteer, instruction, repetition = place
    return (
        (configuration.volunteers is None or volunteer in configuration.volunteers)
        and instruction in configuration.instructions
        and (configuration.repetitions is None or repetition in configuration.repetitions)
    )
