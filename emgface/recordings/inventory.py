"""Inventory of a folder: contents and findings of each file, or the reason of its refusal."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from emgface.characters import visible
from emgface.errors import DataError, EmgfaceError
from emgface.recordings.check import check_recording
from emgface.recordings.dataset import read_recording, readers
from emgface.recordings.labels import note
from emgface.schema.rules import one_line
from emgface.texts import read_toml

DESCRIBING_SUFFIXES = (".md", ".json", ".tsv", ".pdf", ".rst", ".license", "")
"""Suffixes of files that describe recordings; of these only ``*_motion.tsv`` contains signals."""
HEADER_COMPANIONS = (".eeg", ".dat", ".vmrk")
"""Suffixes of the files of a BrainVision recording, which is listed under its header."""
INVENTORY_COLUMNS = ("file", "format", "channels", "emg_rate", "markers", "marker_rate", "units",
                     "duration", "findings", "refusal")  # fmt: skip
_MOST = 3  #: largest number of findings of one kind that are listed


def inventory_table(folder: str | Path, *, sidecars: str | Path | None = None) -> pd.DataFrame:
    """Read and examine every file of a folder that may contain signals, in one row each.

    `sidecars` is a folder of TOML sidecars (`emgface.recordings.readers.csv_toml`) for tables and
    arrays, whose paths are relative to `folder`. Columns are ``file``, ``format``, number of
    ``channels`` and ``markers``, ``emg_rate`` and ``marker_rate`` [Hz], ``units`` of the source,
    ``duration`` [s], ``findings`` of the checks, or ``refusal``, the error message. Files that
    describe others (`DESCRIBING_SUFFIXES`) are omitted. Raises DataError if the folder is absent or
    contains no such file.
    """
    root = Path(folder)
    rows = [_row(path, root, result) for path, result in read_files(root, sidecars=sidecars)]
    if not rows:
        raise DataError(
            f"{root} contains no file with signals; expected recordings: check the path."
        )
    return pd.DataFrame(rows, columns=list(INVENTORY_COLUMNS))


def read_files(
    folder: str | Path, *, sidecars: str | Path | None = None
) -> Iterator[tuple[Path, xr.Dataset | EmgfaceError]]:
    """Read every file of a folder that may contain signals, one after the other.

    Arguments as for `inventory_table`. Yields each file with its recording, or with the error.
    Raises DataError if a folder is absent.
    """
    root = Path(folder)
    if not root.is_dir():
        raise DataError(f"No folder {root}; expected recordings in it: check the path.")
    by_file: dict[Path, Path] = {}
    if sidecars is not None:
        by_file, bad = _sidecars(root, Path(sidecars))
        yield from bad
    for path in _files(root):
        try:
            if path not in by_file:
                yield path, read_recording(path)
                continue
            recording = read_recording(by_file[path], folder=root)
            yield path, recording.assign_attrs(sidecar=by_file[path].name)
        except EmgfaceError as error:
            yield path, error


def _files(root: Path) -> Iterator[Path]:
    known = readers()
    for path in sorted(root.rglob("*")):
        suffix = path.suffix.lower()
        if path.name.startswith(".") or path.is_dir() and not path.is_symlink():
            continue
        if path.is_symlink() and not path.is_file():
            yield path  # a link to a folder is not followed, one to an absent file cannot be
            continue
        if not path.is_file():
            continue
        reader = known.get(suffix)
        if suffix in HEADER_COMPANIONS and _has_sibling(path, ".vhdr"):
            continue
        if suffix == ".tsv":
            if reader is not None and path.name.endswith("_motion.tsv"):
                yield path
        elif reader is not None:
            yield path
        elif suffix not in DESCRIBING_SUFFIXES and path.stem.lower() not in (
            "readme",
            "origin",
            "codebook",
        ):
            yield path


def _has_sibling(path: Path, suffix: str) -> bool:
    """Return True if a file of the same name has the suffix, in upper or lower case."""
    return any(path.with_suffix(s).is_file() for s in (suffix, suffix.upper()))


def _sidecars(root: Path, folder: Path) -> tuple[dict[Path, Path], list[tuple[Path, EmgfaceError]]]:
    """Sidecar of each file that one describes.

    Sidecars that cannot be read, or describe no file, are returned with the reason.
    """
    if not folder.is_dir():
        raise DataError(f"No folder {folder}; expected TOML sidecars in it: check the path.")
    by_file: dict[Path, Path] = {}
    bad: list[tuple[Path, EmgfaceError]] = []
    for path in sorted(p for p in folder.iterdir() if p.suffix.lower() == ".toml"):
        try:
            content = read_toml(path)
        except EmgfaceError as error:
            bad.append((path, DataError(str(error))))
            continue
        tables = [content.get(part) for part in ("emg", "position")]
        names = [table.get("file") for table in tables if isinstance(table, dict)]
        described = [root / name for name in names if isinstance(name, str)]
        if problem := _unusable(root, described, by_file):
            bad.append((path, DataError(f"{path.name} {problem}")))
            continue
        by_file |= dict.fromkeys(described, path)
    return by_file, bad


def _unusable(root: Path, described: list[Path], by_file: dict[Path, Path]) -> str:
    """Reason why a sidecar describes no file of a folder, or one that another describes."""
    if not described:
        return "describes no file; expected the entry 'file' in a table 'emg' or 'position'."
    for target in described:
        if not target.is_file():
            return f"describes {target.name}, which {root} lacks; expected a path relative to it."
        if target in by_file:
            return f"describes {target.name}, as another sidecar does; expected one: delete one."
    return ""


def _row(path: Path, root: Path, result: xr.Dataset | EmgfaceError) -> dict[str, Any]:
    reader = readers().get(path.suffix.lower())
    row: dict[str, Any] = dict.fromkeys(INVENTORY_COLUMNS)
    row["file"] = path.relative_to(root).as_posix() if path.is_relative_to(root) else path.name
    row["format"] = reader.FORMAT if reader else path.suffix.lower().removeprefix(".")
    if isinstance(result, EmgfaceError):
        row["refusal"] = " ".join(str(result).split()).replace(f"{path.parent.resolve()}/", "")
        return row
    if "sidecar" in result.attrs:
        row["format"] += " with a sidecar"
    try:
        return row | _measures(result) | {"findings": _findings(result)}
    except Exception as error:  # an invalid file must not stop the inventory
        return row | {"refusal": f"{path.name} could not be examined ({one_line(error)})."}


def _measures(recording: xr.Dataset) -> dict[str, Any]:
    measures: dict[str, Any] = {"duration": 0.0}
    for part, dim, count, rate in (
        ("emg", "channel", "channels", "emg_rate"),
        ("position", "marker", "markers", "marker_rate"),
    ):
        if part not in recording:
            continue
        time = recording["time_emg" if part == "emg" else "time_marker"].values
        step = (time[-1] - time[0]) / (time.size - 1) if time.size > 1 else float("nan")
        measures[count], measures[rate] = recording.sizes[dim], 1.0 / step
        measures["duration"] = max(measures["duration"], time.size * step)
    units = note(recording, "original_units")
    measures["units"] = ", ".join(f"{part} {unit}" for part, unit in units.items()) or "SI"
    return measures


def _findings(recording: xr.Dataset) -> str:
    """Describe the findings, with equal findings of several channels combined."""
    table = check_recording(recording)
    reasons: dict[tuple[str, str], list[str]] = {}
    for row in table[table["verdict"] != "ok"].to_dict("records"):
        for reason in str(row["reason"]).split("; "):
            # Findings that differ only in their numbers are combined.
            key = re.sub(r"-?\d+(\.\d+)?(e[-+]?\d+)?", "#", reason.partition(":")[0])
            reasons.setdefault((str(row["kind"]), key), []).append(f"{row['name']}|{reason}")
    clauses: list[str] = []
    for (kind, _), entries in reasons.items():
        name, _, first = entries[0].partition("|")
        first = first.partition(":")[0]
        if len(entries) == 1:
            clauses.append(f"{kind} {name}: {first}")
        else:
            names = ", ".join(one.partition("|")[0] for one in entries[:_MOST])
            more = f" and {len(entries) - _MOST} more" if len(entries) > _MOST else ""
            clauses.append(f"{len(entries)} {kind}s ({names}{more}): {first}")
    return "; ".join(clauses) or "no findings"


def markdown(table: pd.DataFrame) -> str:
    """Write an `inventory_table` in Markdown; the last column contains findings or the refusal."""
    heads = ("file", "format", "channels", "rate [Hz]", "units", "duration [s]", "findings")
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for row in table.to_dict("records"):
        counts = [
            f"{row[count]:g} {name}"
            for count, name in (("channels", "EMG"), ("markers", "markers"))
            if pd.notna(row[count])
        ]
        rates = [f"{row[rate]:.6g}" for rate in ("emg_rate", "marker_rate") if pd.notna(row[rate])]
        refused = pd.notna(row["refusal"])
        cells = (
            row["file"],
            row["format"],
            ", ".join(counts) or "-",
            ", ".join(rates) or "-",
            row["units"] if pd.notna(row["units"]) else "-",
            f"{row['duration']:.4g}" if pd.notna(row["duration"]) else "-",
            f"*refused: {row['refusal']}*" if refused else row["findings"],
        )
        lines.append(
            "| " + " | ".join(visible(str(cell)).replace("|", "\\|") for cell in cells) + " |"
        )
    return "\n".join(lines) + "\n"
