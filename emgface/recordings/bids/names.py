"""Names of files in a BIDS dataset: ``sub-V01_task-A_run-01_emg.bdf``."""

import re
from pathlib import Path

from emgface.errors import DataError
from emgface.recordings.findings import Finding

LABEL = re.compile(r"[0-9A-Za-z+]+")  #: allowed values of an entity, after its key and hyphen
ENTITY_ORDER = ("sub", "ses", "task", "tracksys", "acq", "run", "recording")
"""Entities of EMG and motion files, in the order of the specification."""
TRIAL_ENTITIES = ("sub", "ses", "task", "acq", "run")
"""Entities that are equal for EMG and motion of one trial."""


def labels_in_name(path: Path) -> dict[str, list[str]]:
    """Return the labels of every entity in the name of a file, in order; empty for other names.

    An entity that occurs twice has two labels, which `require_bids_name` refuses.

    Examples
    --------
    >>> labels_in_name(Path("sub-V01_run-01_run-02_emg.bdf"))
    {'sub': ['V01'], 'run': ['01', '02']}
    """
    pairs = [part.partition("-") for part in _parts(path)]
    if any(not hyphen or not label for _, hyphen, label in pairs):
        return {}
    labels: dict[str, list[str]] = {}
    for key, _, label in pairs:
        labels.setdefault(key, []).append(label)
    return labels


def _parts(path: Path) -> list[str]:
    """Parts of a name that are to be entities, without the suffix."""
    return path.name.split(".")[0].split("_")[:-1]


def faults(path: Path) -> list[str]:
    """Return one clause for each entity of a file by which its trial cannot be identified.

    These are parts of the name without key and label, entities that occur twice, a run that is no
    number, and a volunteer or session that differs from that of the folder. A name without the
    entity ``sub`` is none of BIDS and has no faults.
    """
    parts = _parts(path)
    if not any(part.startswith("sub-") for part in parts):
        return []
    clauses = [
        f"contains {part!r}, which is no entity; expected key and label, such as 'run-01'"
        for part in parts
        if not part.partition("-")[2] and _in_dataset(path)
    ]
    for key, values in labels_in_name(path).items():
        if len(values) > 1:
            shown = " and ".join(f"{key}-{value}" for value in values)
            clauses.append(f"contains {shown}; expected the entity {key!r} once")
        clauses += [
            f"contains run-{value}; expected a number, such as run-01"
            for value in values
            if key == "run" and not (value.isascii() and value.isdecimal())
        ]
        folder = _folder_of(path, key) if key in ("sub", "ses") else None
        if folder is not None and [folder] != values[:1]:
            clauses.append(f"contains {key}-{values[0]}, but is in the folder {key}-{folder}")
    return clauses


def _in_dataset(path: Path) -> bool:
    return bool(path.parent.name in ("emg", "motion") or _folder_of(path, "sub"))


def _folder_of(path: Path, key: str) -> str | None:
    """Label of an entity in the nearest folder of that kind, which is at most three above a file."""
    for folder in list(path.absolute().parents)[:3]:
        start, _, label = folder.name.partition("-")
        if start == key and LABEL.fullmatch(label):
            return label
    return None


def require_bids_name(path: Path) -> None:
    """Refuse a file whose name does not identify its trial, or contradicts its folder (DataError)."""
    clauses = faults(path)
    if clauses:
        raise DataError(
            f"{path.name} {'; it '.join(clauses)}: rename it, or move it to its folder."
        )


def name_findings(path: Path, task_name: object = None) -> list[Finding]:
    """Return the findings on a name that BIDS allows: run-0, and a task other than in its sidecar.

    `task_name` is the ``TaskName`` of the sidecar, if it states one.
    """
    own, findings = entities(path), list[Finding]()
    label = own.get("run", "1")
    if label.isdecimal() and int(label) == 0:
        findings.append(Finding("no_repetition", values={"label": label}))
    if other_task(path, task_name):
        findings.append(
            Finding("task", values={"stated": str(task_name)[:80], "label": own["task"]})
        )
    return findings


def other_task(path: Path, task_name: object) -> bool:
    """Return True if the task in a name is not that of its sidecar.

    The label consists of the letters, digits and plus signs of ``TaskName`` (BIDS 1.10, task events);
    case is ignored.
    """
    label = entities(path).get("task")
    if label is None or not isinstance(task_name, str) or task_name.strip() in ("", "n/a"):
        return False
    return "".join(LABEL.findall(task_name)).casefold() != label.casefold()


def entities(path: Path) -> dict[str, str]:
    """Return the entities in the name of a file of a BIDS dataset; empty for other names.

    Examples
    --------
    >>> entities(Path("sub-V01_task-A_run-01_emg.bdf"))
    {'sub': 'V01', 'task': 'A', 'run': '01'}
    """
    return {key: values[-1] for key, values in labels_in_name(path).items()}


def may_describe(path: Path, own: dict[str, str]) -> bool:
    """Return True if every entity of a file has the label of another file, `own`, also if twice."""
    return all(own.get(key) in values for key, values in labels_in_name(path).items())


def file_name(labels: dict[str, str], ending: str) -> str:
    """Compose a name from entities that have a value, and an ending such as ``emg.bdf``.

    Raises DataError if a label contains anything but letters and digits.

    Examples
    --------
    >>> file_name({"run": "01", "sub": "V01", "task": "A"}, "emg.bdf")
    'sub-V01_task-A_run-01_emg.bdf'
    """
    for key, label in labels.items():
        if not LABEL.fullmatch(label):
            raise DataError(
                f"{label!r} cannot be the label of {key!r} in a BIDS name; expected letters and "
                "digits only: rename it in the recording's attributes."
            )
    return "_".join([*(f"{key}-{labels[key]}" for key in ENTITY_ORDER if key in labels), ending])


def trial_of(path: Path) -> dict[str, str | int]:
    """Return volunteer, instruction and repetition (sub, task and run) from the name of a file.

    Raises DataError if the name does not identify the trial, or contradicts its folder.
    """
    require_bids_name(path)
    labels = entities(path)
    trial: dict[str, str | int] = {}
    if "sub" in labels:
        trial["volunteer"] = labels["sub"]
    if "task" in labels:
        trial["instruction"] = labels["task"]
    if labels.get("run", "").isdecimal() and int(labels["run"]) > 0:
        trial["repetition"] = int(labels["run"])
    return trial
