"""Rules of the specification for the check of a dataset of EMG and motion.

Source: BIDS specification 1.11, schema: rules/sidecars/{emg,motion},
rules/tabular_data/{emg,motion}, rules/files/raw/{emg,motion}, and the pages on electromyography and
motion.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import pandas as pd

from emgface.errors import DataError
from emgface.recordings.bids.names import ENTITY_ORDER, LABEL, entities, labels_in_name, other_task
from emgface.recordings.bids.sidecars import (
    IDENTIFYING_COLUMNS,
    read_json,
    read_tsv,
    row_names,
    sidecar_path,
)
from emgface.texts import read_text

BIDS_VERSION: Final = "1.11.0"
EMG_COLUMNS: Final = ("name", "type", "units")
MOTION_COLUMNS: Final = ("name", "component", "type", "tracked_point", "units")
PARTICIPANT_COLUMNS: Final = ("participant_id",)
SCAN_COLUMNS: Final = ("filename", "acq_time")
ELECTRODE_COLUMNS: Final = ("name", "x", "y")

EMG_KEYS: Final = (
    "TaskName", "EMGPlacementScheme", "EMGReference", "SamplingFrequency", "PowerLineFrequency",
    "SoftwareFilters",
)  # fmt: skip
MOTION_KEYS: Final = ("TaskName", "SamplingFrequency", "TrackingSystemName")
DATASET_KEYS: Final = ("Name", "BIDSVersion")
COORDINATE_KEYS: Final = ("EMGCoordinateSystem", "EMGCoordinateUnits")

CHANNEL_TYPES: Final = {
    "emg": {
        "VEOG", "HEOG", "EOG", "ECG", "EMG", "TRIG", "EYEGAZE", "PUPIL", "MISC", "SYSCLOCK", "ADC",
        "DAC", "REF", "OTHER", "EEG", "GSR", "RESP", "TEMP", "AUDIO", "PPG",
    },
    "motion": {
        "ACCEL", "ANGACCEL", "GYRO", "JNTANG", "LATENCY", "MAGN", "MISC", "ORNT", "POS", "VEL",
    },
}  # fmt: skip
COMPONENTS: Final = {"x", "y", "z", "quat_x", "quat_y", "quat_z", "quat_w", "n/a"}
_SIGNALS: Final = {"emg": ("emg.edf", "emg.bdf"), "motion": ("motion.tsv",)}


def bids_problems(root: str | Path) -> list[str]:
    """Return one sentence for each rule of BIDS that a dataset violates.

    It states file, problem, and requirement. Only EMG and motion are examined, and the tables
    common to all datasets. Raises DataError if the folder is absent.
    """
    root = Path(root)
    if not root.is_dir():
        raise DataError(f"No folder {root}; expected a BIDS dataset: check the path.")
    return [
        *_dataset(root),
        *_repeated(root),
        *(problem for kind in _SIGNALS for problem in _kind(root, kind)),
    ]


def _dataset(root: Path) -> Iterator[str]:
    description = root / "dataset_description.json"
    if description.is_file():
        yield from _keys(description, DATASET_KEYS)
    else:
        yield "dataset_description.json is missing"
    if not any((root / name).is_file() for name in ("README", "README.md", "README.txt")):
        yield "README is missing"
    participants = root / "participants.tsv"
    if participants.is_file():
        yield from _columns(participants, PARTICIPANT_COLUMNS)
        listed = set(_table(participants).iloc[:, 0])
        for folder in sorted(root.glob("sub-*")):
            if folder.is_dir() and folder.name not in listed:
                yield f"participants.tsv does not list {folder.name}"
    for scans in sorted(root.rglob("*_scans.tsv")):
        yield from _columns(scans, SCAN_COLUMNS[:1])
        for name in _table(scans).iloc[:, 0]:
            if not (scans.parent / str(name)).is_file():
                yield f"{scans.name} lists {name}, which does not exist"


def _repeated(root: Path) -> Iterator[str]:
    """Problems of tables that list a channel, an electrode, a participant or a file twice."""
    for ending, key in IDENTIFYING_COLUMNS.items():
        for path in sorted({*root.glob(ending), *root.rglob(f"*_{ending}")}):
            table = _table(path)
            names = row_names(table, key) if key in table.columns else []
            what = "the channel " if ending == "channels.tsv" else ""
            for name in sorted({name for name in names if names.count(name) > 1}):
                yield f"{path.name} lists {what}{name!r} more than once"


def _table(path: Path) -> pd.DataFrame:
    """Table whose repeated names are problems among others."""
    return read_tsv(path, repeated=True)


def _kind(root: Path, kind: str) -> Iterator[str]:
    """Problems of the files of EMG or of motion."""
    for ending in _SIGNALS[kind]:
        for path in sorted(root.rglob(f"*_{ending}")):
            yield from _name(path, root, kind)
            sidecar = sidecar_path(path, f"{kind}.json")
            if sidecar is None:
                yield f"{path.name} has no {kind}.json"
            else:
                yield from _keys(sidecar, EMG_KEYS if kind == "emg" else MOTION_KEYS)
                yield from _task(path, sidecar)
                yield from _values(sidecar, kind)
            table = sidecar_path(path, "channels.tsv")
            if table is not None:
                yield from _channels(path, table, kind)
            elif kind == "motion":
                yield f"{path.name} has no channels.tsv"
    if kind == "emg":
        for path in sorted(root.rglob("emg/*_electrodes.tsv")):
            yield from _columns(path, ELECTRODE_COLUMNS)
            if "coordinate_system" not in _table(path).columns:
                yield f"{path.name} lacks the column 'coordinate_system'"
            system = sidecar_path(path, "coordsystem.json")
            if system is None:
                yield f"{path.name} has no coordsystem.json"
            else:
                yield from _keys(system, COORDINATE_KEYS)


def _name(path: Path, root: Path, kind: str) -> Iterator[str]:
    """Problems of the name and folder of a file."""
    labels = entities(path)
    for key, values in labels_in_name(path).items():
        if len(values) > 1:
            yield f"{path.name} has the entity {key!r} {len(values)} times"
    keys = list(labels)
    if keys != [key for key in ENTITY_ORDER if key in labels]:
        yield f"{path.name} has the entities {', '.join(keys)}; expected {', '.join(ENTITY_ORDER)}"
    needed = ("sub", "task", "tracksys") if kind == "motion" else ("sub", "task")
    for key in needed:
        if key not in labels:
            yield f"{path.name} lacks the entity {key!r}"
    for key, label in labels.items():
        if not (label.isdecimal() if key == "run" else LABEL.fullmatch(label)):
            yield f"{path.name} has the label {label!r} for {key!r}"
    folders = [f"sub-{labels.get('sub')}"]
    folders += [f"ses-{labels['ses']}"] if "ses" in labels else []
    if path.parent.relative_to(root).parts != (*folders, kind):
        yield f"{path.name} is in {path.parent.relative_to(root)}, not in {'/'.join(folders)}/{kind}"


def _task(path: Path, sidecar: Path) -> Iterator[str]:
    """Problem of a task in a name that is not that of its sidecar."""
    task = read_json(sidecar).get("TaskName")
    if other_task(path, task):
        yield f"{path.name} has another task than its {sidecar.name}, TaskName {task!r}"


def _keys(path: Path, required: tuple[str, ...]) -> Iterator[str]:
    content = read_json(path)
    for key in required:
        if content.get(key) in (None, ""):
            yield f"{path.name} lacks the key {key!r}"


def _values(path: Path, kind: str) -> Iterator[str]:
    """Problems of the types of values in a sidecar."""
    content: Mapping[str, Any] = read_json(path)
    rate = content.get("SamplingFrequency")
    if not _positive(rate) and not (kind == "motion" and rate == "n/a"):
        yield f"{path.name} has SamplingFrequency {json.dumps(rate)}; expected a number above 0"
    if kind == "motion":
        return
    if content.get("EMGPlacementScheme") == "Other" and not content.get(
        "EMGPlacementSchemeDescription"
    ):
        yield f"{path.name} lacks the key 'EMGPlacementSchemeDescription', needed for 'Other'"
    line = content.get("PowerLineFrequency")
    if line != "n/a" and not _positive(line):
        yield f"{path.name} has PowerLineFrequency {json.dumps(line)}; expected a number or 'n/a'"
    filters = content.get("SoftwareFilters")
    if filters != "n/a" and not isinstance(filters, dict):
        yield f"{path.name} has SoftwareFilters {json.dumps(filters)}; expected an object or 'n/a'"


def _positive(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and value > 0


def _columns(path: Path, first: tuple[str, ...]) -> Iterator[str]:
    columns = [str(column) for column in _table(path).columns]
    if columns[: len(first)] != list(first):
        yield f"{path.name} begins with the columns {', '.join(columns)}; expected {', '.join(first)}"


def _channels(path: Path, table: Path, kind: str) -> Iterator[str]:
    """Problems of the table of channels, and of its agreement with the signals."""
    yield from _columns(table, EMG_COLUMNS if kind == "emg" else MOTION_COLUMNS)
    channels = _table(table)
    names = list(channels["name"])
    for kind_of in sorted(set(channels.get("type", ())) - CHANNEL_TYPES[kind]):
        yield f"{table.name} has the type {kind_of!r}; expected a keyword of the specification"
    if kind == "emg":
        return
    for component in sorted(set(channels.get("component", ())) - COMPONENTS):
        yield f"{table.name} has the component {component!r}; expected x, y, z, quat_* or n/a"
    first = read_text(path, fallback="latin-1").partition("\n")[0].rstrip("\r").split("\t")
    if len(first) != len(names):
        yield f"{path.name} has {len(first)} columns and {table.name} {len(names)} rows"
    if not all(_number(cell) for cell in first):
        yield f"{path.name} begins with a row of names; expected numbers alone"


def _number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell == "n/a"
    return True
