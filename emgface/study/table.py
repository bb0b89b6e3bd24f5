"""Run table: all trials of a study, including those missing from a complete design."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path

import xarray as xr

from emgface.errors import DataError, EmgfaceError
from emgface.muscles import INSTRUCTIONS
from emgface.recordings.dataset import read_recording, read_recordings
from emgface.schema.validation import validate
from emgface.study.configuration import RecordingsConfiguration
from emgface.study.digest import dataset_digest
from emgface.study.exclusions import Exclusion, Place, reason_to_exclude


@dataclass(frozen=True)
class Recording:
    """Recording included in a study, of which only the description is kept in memory."""

    place: Place  #: volunteer, instruction, repetition
    digest: str  #: digest of its content
    path: Path
    mapping: Path | None  #: file that maps its labels to names
    origin: str  #: measured or simulated
    world: str  #: world of a simulated volunteer, otherwise empty
    channels: tuple[str, ...]  #: recorded channels of the EMG
    error: EmgfaceError | None = None  #: reason why it cannot be used, although it is identified
    excluded: str = ""  #: reason for its exclusion; empty if it is not excluded

    @property
    def dataset(self) -> xr.Dataset:
        """Content, read from the file; the last few recordings are kept.

        Raises DataError if the file has changed since it was included.
        """
        return _content(self.path, self.mapping, self.digest)

    @property
    def label(self) -> str:
        """Readable label."""
        return " ".join(map(str, self.place))


@dataclass(frozen=True)
class PlannedTrial:
    """One cell of the cube: a recording, or none, with one strategy."""

    place: Place
    strategy: str
    recording: Recording | None

    @property
    def label(self) -> str:
        """Readable label."""
        return " ".join(map(str, (*self.place, self.strategy)))


@dataclass(frozen=True)
class Intake:
    """Identified recordings of a folder, in the order of the design, and the unreadable files."""

    recordings: tuple[Recording, ...]
    unreadable: dict[Path, EmgfaceError]

    @property
    def origin(self) -> str:
        """Origin of the recordings, measured or simulated, equal for all."""
        return self.recordings[0].origin

    @property
    def world(self) -> str:
        """World of simulated volunteers; empty for measured recordings."""
        return self.recordings[0].world

    def of(self, volunteer: str) -> tuple[Recording, ...]:
        """Return the usable recordings of one volunteer."""
        usable = (r for r in self.recordings if r.error is None and not r.excluded)
        return tuple(r for r in usable if r.place[0] == volunteer)


def take_in(configuration: RecordingsConfiguration, exclude: Sequence[Exclusion] = ()) -> Intake:
    """Read the recordings selected by a configuration, in the order of the design.

    A recording that identifies its trial but lacks something required by the study is included with
    the error; its trials fail, the others are computed. Trials in `exclude` are included with the
    reason and not computed. Raises DataError if the folder contains no recording, none of the
    selection, or two of the same trial, and ConfigurationError if the mapping contains an unknown
    entry.
    """
    found: dict[Place, Recording] = {}
    unreadable: dict[Path, EmgfaceError] = {}
    n_files = 0
    for path, given in read_recordings(configuration.folder, mapping=configuration.mapping):
        n_files += 1
        if isinstance(given, EmgfaceError):
            unreadable[path] = given
            continue
        try:
            place, error = place_of(given, path.name), None
        except DataError as unplaced:
            unreadable[path] = unplaced
            continue
        if not _selected(place, configuration):
            continue
        if place in found:
            raise DataError(
                f"{path.name} and {found[place].path.name} are both volunteer {place[0]}, "
                f"instruction {place[1]}, repetition {place[2]}: remove or relabel one"
            )
        try:
            given = _checked(given)
        except DataError as lacking:
            error = type(lacking)(f"{path.name}: {lacking}")
        why = reason_to_exclude(place, exclude)
        found[place] = as_recording(given, path, configuration.mapping, error, why)
    if not found and unreadable:
        path, first = next(iter(unreadable.items()))
        more = f" (and {len(unreadable) - 1} more files)" if len(unreadable) > 1 else ""
        raise type(first)(f"{first}{more}") from first
    if not found:
        raise DataError(
            f"none of {n_files} recordings in {configuration.folder} is of the selected "
            "volunteers, instructions and repetitions: extend the selection"
        )
    origins = {r.origin for r in found.values()}
    if len(origins) > 1:
        raise DataError(
            f"{configuration.folder} contains measured and simulated recordings, which "
            "cannot share a cube: run a study of each"
        )
    worlds = {r.world for r in found.values()}
    if len(worlds) > 1:
        raise DataError(
            f"{configuration.folder} contains volunteers of several worlds "
            f"({', '.join(sorted(world or 'without a name' for world in worlds))}), which "
            "cannot share a cube: run a study of each"
        )
    order = list(INSTRUCTIONS)
    places = sorted(found, key=lambda p: (p[0], order.index(p[1]), p[2]))
    return Intake(tuple(found[place] for place in places), unreadable)


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


def plan_trials(recordings: Sequence[Recording], strategies: Sequence[str]) -> list[PlannedTrial]:
    """Combine volunteers, instructions, repetitions and strategies to a complete design.

    A cell of the design without a recording has ``recording = None``.
    """
    known = {r.place: r for r in recordings}
    volunteers = sorted({place[0] for place in known})
    instructions = [i for i in INSTRUCTIONS if i in {place[1] for place in known}]
    repetitions = sorted({place[2] for place in known})
    return [
        PlannedTrial(place, strategy, known.get(place))
        for place in product(volunteers, instructions, repetitions)
        for strategy in strategies
    ]


def load_recording(path: Path, configuration: RecordingsConfiguration) -> Recording:
    """Describe one recording as `take_in` does."""
    return as_recording(
        _checked(read_recording(path, mapping=configuration.mapping)), path, configuration.mapping
    )


def as_recording(
    dataset: xr.Dataset,
    path: Path,
    mapping: Path | None,
    error: EmgfaceError | None = None,
    excluded: str = "",
) -> Recording:
    """Describe a recording in memory that was read from a file."""
    channels = dataset["channel"].values.tolist() if "channel" in dataset.coords else []
    return Recording(
        place_of(dataset, path.name),
        dataset_digest(dataset),
        path.absolute(),  # workers may have another working folder
        None if mapping is None else mapping.absolute(),
        str(dataset.attrs["origin"]),
        str(dataset.attrs.get("world", "")),
        tuple(map(str, channels)),
        error,
        excluded,
    )


@lru_cache(maxsize=4)
def _content(path: Path, mapping: Path | None, digest: str) -> xr.Dataset:
    dataset = _checked(read_recording(path, mapping=mapping))
    if dataset_digest(dataset) != digest:
        raise DataError(
            f"{path.name} has changed since the study began, expected the same content: run the "
            "study again"
        )
    return dataset


def _checked(recording: xr.Dataset) -> xr.Dataset:
    """Check a recording for a study; the montage treats missing channels."""
    return validate(recording, "recording", study=True, partial=("channel",))


def place_of(recording: xr.Dataset, name: str) -> Place:
    """Return volunteer, instruction and repetition of a recording, called `name` in messages.

    Raises DataError if one of them is absent, or the instruction is unknown.
    """
    lacking = [n for n in ("volunteer", "instruction", "repetition") if n not in recording.attrs]
    if lacking:
        raise DataError(
            f"{name} does not specify its {' and '.join(lacking)}, expected all three: set "
            "the attributes or specify them in a mapping"
        )
    attrs = recording.attrs
    place = (str(attrs["volunteer"]), str(attrs["instruction"]), int(attrs["repetition"]))
    if place[1] not in INSTRUCTIONS:
        raise DataError(
            f"{name} is of instruction {place[1]!r}, expected one of "
            f"{', '.join(INSTRUCTIONS)}: relabel it"
        )
    return place


def _selected(place: Place, configuration: RecordingsConfiguration) -> bool:
    volunteer, instruction, repetition = place
    return (
        (configuration.volunteers is None or volunteer in configuration.volunteers)
        and instruction in configuration.instructions
        and (configuration.repetitions is None or repetition in configuration.repetitions)
    )
