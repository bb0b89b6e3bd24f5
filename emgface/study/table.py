"""Run table: all trials of a study, including those missing from a complete design."""

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from emgface.errors import DataError, EmgfaceError, RecordingChanged
from emgface.muscles import INSTRUCTIONS, LETTERS
from emgface.recordings.dataset import read_recording
from emgface.recordings.exclusions import Place
from emgface.run.digest import dataset_digest
from emgface.schema.validation import validate

if TYPE_CHECKING:  # signals are checked without the mechanics
    from emgface.study.configuration import RecordingsConfiguration


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
    signals: str = ""  #: digest of the samples alone, without names and identity
    error: EmgfaceError | None = None  #: reason why it cannot be used, although it is identified
    excluded: str = ""  #: reason for its exclusion; empty if it is not excluded

    @property
    def dataset(self) -> xr.Dataset:
        """Content, read from the file; the last few recordings are kept.

        Raises RecordingChanged if the file has changed since it was included.
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
    sigma_max: float | None = None  #: initial value calibrated for the trial [Pa]

    @property
    def label(self) -> str:
        """Readable label."""
        return " ".join(map(str, (*self.place, self.strategy)))


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


def load_recording(path: Path, configuration: "RecordingsConfiguration") -> Recording:
    """Describe one recording as `take_in` does."""
    return as_recording(
        checked_recording(read_recording(path, mapping=configuration.mapping)),
        path,
        configuration.mapping,
    )


def as_recording(
    dataset: xr.Dataset,
    path: Path,
    mapping: Path | None,
    error: EmgfaceError | None = None,
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
        samples_digest(dataset),
        error,
    )


def samples_digest(dataset: xr.Dataset) -> str:
    """Digest of the samples of sEMG and positions; equal for copies with other names or identity."""
    digest = hashlib.sha256()
    for name in ("emg", "position"):
        if name in dataset:
            values = np.ascontiguousarray(dataset[name].values, dtype=np.float64)
            digest.update(f"{values.shape}".encode() + values.tobytes())
    return digest.hexdigest()


def refuse_copies(recordings: Iterable[xr.Dataset]) -> None:
    """Raise DataError if two recordings from which a value is calibrated contain the same samples."""
    first: dict[str, int] = {}
    for k, one in enumerate(recordings, 1):
        if (before := first.setdefault(samples_digest(one), k)) != k:
            raise DataError(
                f"recordings {before} and {k} of the calibration contain the same samples, which would "
                "count twice, expected different trials: leave one of them out"
            )


@lru_cache(maxsize=4)
def _content(path: Path, mapping: Path | None, digest: str) -> xr.Dataset:
    try:
        dataset = checked_recording(read_recording(path, mapping=mapping))
    except EmgfaceError as error:
        raise RecordingChanged(
            f"{path.name} could be read when the study began, and now it cannot ({error}): make it "
            "available and run the study again"
        ) from error
    if dataset_digest(dataset) != digest:
        raise RecordingChanged(
            f"{path.name} has changed since the study began, expected the same content: run the "
            "study again"
        )
    return dataset


def checked_recording(recording: xr.Dataset) -> xr.Dataset:
    """Check a recording for a study; the montage treats missing channels."""
    return validate(recording, "recording", study=True, partial=("channel",))


def place_of(recording: xr.Dataset, name: str) -> Place:
    """Return volunteer, instruction and repetition of a recording, called `name` in messages.

    Raises DataError if one of them is absent, or the instruction is unknown.
    """
    lacking = [n for n in ("volunteer", "instruction", "repetition") if n not in recording.attrs]
    if lacking:
        raise DataError(
            f"{name} does not specify its {' and '.join(lacking)}, expected all three: set the "
            "attributes, or let the mapping state them, for example by the names of the files "
            '(names = "{volunteer}_{instruction}_{repetition}")'
        )
    attrs = recording.attrs
    place = (str(attrs["volunteer"]), str(attrs["instruction"]), int(attrs["repetition"]))
    if place[1] not in INSTRUCTIONS:
        raise DataError(
            f"{name} is of instruction {place[1]!r}, expected one of "
            f"{LETTERS}: name the file accordingly, or let a mapping state the letter "
            f'([instructions], {json.dumps(place[1], ensure_ascii=False)} = "A")'
        )
    return place
