"""The run table: every trial a study consists of, and those that a complete design would have."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import xarray as xr

from emgface.errors import DataError
from emgface.muscles import INSTRUCTIONS
from emgface.study.configuration import RecordingsConfiguration


@dataclass(frozen=True)
class Recording:
    """A recording that takes part.

    Attributes
    ----------
    volunteer, instruction, repetition
        Its place in the design.
    dataset : Dataset
        Validated recording.
    digest : str
        Digest of its content.
    path : Path
        Where it came from.
    """

    volunteer: str
    instruction: str
    repetition: int
    dataset: xr.Dataset
    digest: str
    path: Path

    @property
    def label(self) -> str:
        """Words for a reader."""
        return f"{self.volunteer} {self.instruction} {self.repetition}"


@dataclass(frozen=True)
class Trial:
    """One cell of the cube: a recording, or none, under one strategy."""

    volunteer: str
    instruction: str
    repetition: int
    strategy: str
    recording: Recording | None

    @property
    def label(self) -> str:
        """Words for a reader."""
        return f"{self.volunteer} {self.instruction} {self.repetition} {self.strategy}"


def read_recordings(configuration: RecordingsConfiguration) -> list[Recording]:
    """Read the recordings a configuration selects, in the order of the design.

    Parameters
    ----------
    configuration : RecordingsConfiguration
        Folder, pattern and selection.

    Returns
    -------
    list of Recording

    Raises
    ------
    DataError
        If the folder holds no recording of the selection, two files are the same trial, or a file
        cannot be read or does not follow the schema of a study's recording.
    """
    from emgface.dataset import read_recording
    from emgface.schema import validate
    from emgface.study.store import dataset_digest

    paths = sorted(p for p in configuration.folder.glob(configuration.pattern) if p.is_file())
    if not paths:
        raise DataError(
            f"no recording matches {configuration.pattern!r} in {configuration.folder}: check "
            "recordings.folder and recordings.pattern, or make some with 'emgface volunteers'"
        )
    found: dict[tuple[str, str, int], Recording] = {}
    for path in paths:
        dataset = read_recording(path)
        try:
            dataset = validate(dataset, "recording", study=True)
        except DataError as error:
            raise type(error)(f"{path.name}: {error}") from error
        place = (
            str(dataset.attrs["volunteer"]),
            str(dataset.attrs["instruction"]),
            int(dataset.attrs["repetition"]),
        )
        if not _selected(place, configuration):
            continue
        if place in found:
            raise DataError(
                f"{path.name} and {found[place].path.name} are both volunteer {place[0]}, "
                f"instruction {place[1]}, repetition {place[2]}: remove or relabel one"
            )
        found[place] = Recording(*place, dataset, dataset_digest(dataset), path)
    if not found:
        raise DataError(
            f"none of {len(paths)} recordings in {configuration.folder} is of the selected "
            "volunteers, instructions and repetitions: widen the selection"
        )
    order = list(INSTRUCTIONS)
    return sorted(
        found.values(), key=lambda r: (r.volunteer, order.index(r.instruction), r.repetition)
    )


def _selected(place: tuple[str, str, int], configuration: RecordingsConfiguration) -> bool:
    volunteer, instruction, repetition = place
    return (
        (configuration.volunteers is None or volunteer in configuration.volunteers)
        and instruction in configuration.instructions
        and (configuration.repetitions is None or repetition in configuration.repetitions)
    )


def run_table(recordings: Sequence[Recording], strategies: Sequence[str]) -> list[Trial]:
    """Cross volunteers, instructions, repetitions and strategies.

    Parameters
    ----------
    recordings : sequence of Recording
        What there is.
    strategies : sequence of str
        What is compared.

    Returns
    -------
    list of Trial
        Every cell of the complete design; a cell without a recording has ``recording = None``.
    """
    known = {(r.volunteer, r.instruction, r.repetition): r for r in recordings}
    volunteers = sorted({r.volunteer for r in recordings})
    instructions = [i for i in INSTRUCTIONS if i in {r.instruction for r in recordings}]
    repetitions = sorted({r.repetition for r in recordings})
    return [
        Trial(*place, strategy, known.get(place))
        for place in product(volunteers, instructions, repetitions)
        for strategy in strategies
    ]
