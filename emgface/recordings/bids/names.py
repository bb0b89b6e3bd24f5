"""Names of files in a BIDS dataset: ``sub-V01_task-A_run-01_emg.bdf``."""

import re
from pathlib import Path

from emgface.errors import DataError

LABEL = re.compile(r"[0-9A-Za-z+]+")  #: allowed values of an entity, after its key and hyphen
ORDER = ("sub", "ses", "task", "tracksys", "acq", "run", "recording")
"""Entities of EMG and motion files, in the order of the specification."""
TRIAL = ("sub", "ses", "task", "acq", "run")
"""Entities that are equal for EMG and motion of one trial."""


def entities(path: Path) -> dict[str, str]:
    """Return the entities in the name of a file of a BIDS dataset; empty for other names.

    Examples
    --------
    >>> entities(Path("sub-V01_task-A_run-01_emg.bdf"))
    {'sub': 'V01', 'task': 'A', 'run': '01'}
    """
    parts = path.name.split(".")[0].split("_")
    pairs = [part.partition("-") for part in parts[:-1]]
    if not pairs or any(not hyphen or not label for _, hyphen, label in pairs):
        return {}
    return {key: label for key, _, label in pairs}


def file_name(found: dict[str, str], ending: str) -> str:
    """Compose a name from entities that have a value, and an ending such as ``emg.bdf``.

    Raises DataError if a label contains anything but letters and digits.

    Examples
    --------
    >>> file_name({"run": "01", "sub": "V01", "task": "A"}, "emg.bdf")
    'sub-V01_task-A_run-01_emg.bdf'
    """
    for key, label in found.items():
        if not LABEL.fullmatch(label):
            raise DataError(
                f"{label!r} cannot be the label of {key!r} in a BIDS name; expected letters and "
                "digits only: rename it in the recording's attributes."
            )
    return "_".join([*(f"{key}-{found[key]}" for key in ORDER if key in found), ending])


def trial_of(path: Path) -> dict[str, str | int]:
    """Return volunteer, instruction and repetition (sub, task and run) from the name of a file."""
    found = entities(path)
    trial: dict[str, str | int] = {}
    if "sub" in found:
        trial["volunteer"] = found["sub"]
    if "task" in found:
        trial["instruction"] = found["task"]
    if found.get("run", "").isdecimal() and int(found["run"]) > 0:
        trial["repetition"] = int(found["run"])
    return trial
