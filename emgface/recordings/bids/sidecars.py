"""Tables and JSON files that describe the signals of a BIDS dataset."""

import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, Final, NamedTuple

import pandas as pd

from emgface.errors import DataError, UnitsError
from emgface.recordings.bids.names import (
    ENTITY_ORDER,
    entities,
    file_name,
    may_describe,
    require_bids_name,
    trial_of,
)
from emgface.recordings.findings import Finding
from emgface.schema.rules import one_line
from emgface.schema.units import spelling
from emgface.texts import json_in, open_text, read_text

IDENTIFYING_COLUMNS: Final = {
    "channels.tsv": "name",
    "electrodes.tsv": "name",
    "participants.tsv": "participant_id",
    "scans.tsv": "filename",
}
"""Column of each table, by its ending, whose cells identify the rows."""


class EmgSidecars(NamedTuple):
    """Contents of the table of `channels` and of the JSON file (`description`) of an EMG file."""

    path: Path
    channels: pd.DataFrame
    description: dict[str, Any]

    def names(self, labels: Sequence[str]) -> list[str]:
        """Return the names in the table, in the order of the labels of the signal file.

        Those labels may be truncated at 16 characters. Raises DataError if the table has another
        number of channels.
        """
        listed = [str(name) for name in self.channels["name"]]
        if len(listed) != len(labels):
            raise DataError(
                f"{self.path.name} contains {len(labels)} channels, and its channels.tsv "
                f"lists {len(listed)}; expected one row each: repair the table."
            )
        keys, own = ([_key(name) for name in names] for names in (listed, labels))
        # Labels are used only if the order of the table differs from that of the file.
        if sorted(keys) == sorted(own) and len(set(keys)) == len(keys):
            return [listed[keys.index(key)] for key in own]
        for place, key in enumerate(own):
            if key in keys and keys[place] != key and own.count(key) == keys.count(key) == 1:
                row = keys.index(key)
                raise DataError(
                    f"{self.path.name}: channel {place + 1} is {labels[place]!r}, and row {row + 1} of "
                    f"its channels.tsv is {listed[row]!r}; expected the same order or the same names: "
                    "repair the table."
                )
        return listed

    def type_of(self, label: str) -> str:
        """Return the type of a channel in capital letters, EMG if the table specifies none."""
        rows = self.channels.loc[self.channels["name"] == label]
        if rows.empty or "type" not in rows:
            return "EMG"
        return str(rows["type"].iloc[0])

    def units(self, labels: Sequence[str], own: Sequence[str]) -> list[str]:
        """Return the unit of each channel from the file (`own`), or otherwise from the table.

        Raises UnitsError if file and table state different units.
        """
        result: list[str] = []
        for label, unit in zip(labels, own, strict=True):
            rows = self.channels.loc[self.channels["name"] == label]
            stated = "" if rows.empty or "units" not in rows else str(rows["units"].iloc[0])
            stated = "" if stated == "n/a" else stated
            if unit and stated and spelling(unit) != spelling(stated):
                raise UnitsError(
                    f"{self.path.name}: channel {label!r} is in {unit!r}, and in {stated!r} in "
                    "its channels.tsv; expected one unit: repair the table, or specify the "
                    "correct one as emg in the table 'units' of the mapping."
                )
            result.append(unit or stated)
        return result

    def rates(self, labels: Sequence[str]) -> dict[str, float | None]:
        """Return the sampling rates [Hz] that the JSON file and the table state, by their place."""
        stated = self.description.get("SamplingFrequency")
        by_place = {"emg.json": positive_number(stated, "emg.json", "SamplingFrequency")}
        if "sampling_frequency" in self.channels:
            rows = self.channels.loc[self.channels["name"].isin(labels), "sampling_frequency"]
            rates = (positive_number(cell, "channels.tsv", "sampling_frequency") for cell in rows)
            listed_rates = [rate for rate in rates if rate is not None]
            if listed_rates:
                by_place["channels.tsv"] = max(listed_rates, key=listed_rates.count)
        return by_place

    @property
    def duration(self) -> float | None:
        """Duration of the recording [s], if it is specified."""
        return positive_number(
            self.description.get("RecordingDuration"), "emg.json", "RecordingDuration"
        )

    def pauses(self, seen: bool) -> list[Finding]:
        """Findings on pauses that the JSON file states, of which none was `seen` in the signal file.

        Raises DataError for epochs, which are no continuous recording.
        """
        kind = str(self.description.get("RecordingType", "")).lower()
        if kind == "epoched":
            raise DataError(
                f"{self.path.name} contains epochs, as emg.json states by RecordingType; expected one "
                "continuous recording: export the raw data, or each epoch as a separate file."
            )
        return [Finding("pauses", "channel")] if kind == "discontinuous" and not seen else []

    @property
    def origin(self) -> str:
        """Origin of the recording: measured or simulated."""
        return "simulated" if self.description.get("Origin") == "simulated" else "measured"

    @property
    def world(self) -> dict[str, str]:
        """Attribute with the world of simulated volunteers, if it is specified."""
        return world(self.description)

    @property
    def device(self) -> str:
        """Manufacturer and model, if they are specified."""
        return device(self.description)

    @property
    def trial(self) -> dict[str, str | int]:
        """Volunteer, instruction and repetition."""
        return trial_of(self.path)


def _key(name: str) -> str:
    """Part of a name that a signal file preserves, whose labels have at most 16 characters."""
    return name.strip().casefold()[:16].strip()


def positive_number(value: Any, where: str, name: str) -> float | None:
    """Return a number above 0 of a sidecar (a rate or a duration), None if it states none (n/a).

    All numbers of sidecars that reading depends on are converted here. Raises DataError for anything
    else than a number above 0 and below 1e9, also as a text.
    """
    if value is None or (isinstance(value, str) and value.strip() in ("", "n/a")):
        return None
    try:
        number = float("nan") if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = float("nan")
    if not 0.0 < number < 1e9:
        raise DataError(
            f"{where} has {name} {value!r}; expected a number above 0, or 'n/a': repair it."
        )
    return number


def world(description: dict[str, Any]) -> dict[str, str]:
    """Return the attribute with the world of simulated volunteers, empty if none is specified."""
    name = description.get("World")
    return {"world": str(name)} if name else {}


def device(description: dict[str, Any]) -> str:
    """Return manufacturer and model from a sidecar; empty if neither is specified."""
    texts = (description.get(key) for key in ("Manufacturer", "ManufacturersModelName"))
    return " ".join(str(text) for text in texts if text and text != "n/a")


def emg_sidecars(path: Path) -> EmgSidecars | None:
    """Read the table and the JSON file of an EMG file; None if they do not exist.

    Raises DataError if one of them is damaged.
    """
    if not path.stem.endswith("_emg"):
        return None
    require_bids_name(path)
    if "sub" not in entities(path):
        return None
    table = sidecar_path(path, "channels.tsv")
    if table is None:
        return None
    sidecar = sidecar_path(path, "emg.json")
    return EmgSidecars(path, read_tsv(table), read_json(sidecar) if sidecar else {})


def sidecar_path(path: Path, ending: str) -> Path | None:
    """Return the file that describes another one, by the inheritance principle.

    `ending` is suffix and extension, for example ``channels.tsv``. The result is the file with most
    entities in common, in the folder of `path` or up to three above, or None.
    """
    own = entities(path)
    for folder in (path.parent, *list(path.parents)[1:4]):
        best: list[tuple[int, Path]] = []
        for candidate in folder.glob(f"*{ending}"):
            labels = entities(candidate)
            named = candidate.name == ending or candidate.name.endswith(f"_{ending}")
            if named and may_describe(candidate, own) and (labels or candidate.name == ending):
                best.append((len(labels), candidate))
        if best:
            chosen = max(best)[1]
            require_bids_name(chosen)
            return chosen
        if (folder / "dataset_description.json").is_file():
            break
    return None


def describing(path: Path, *endings: str) -> list[Path]:
    """Existing files that describe another one, by their endings (`sidecar_path`)."""
    return [file for ending in endings if (file := sidecar_path(path, ending)) is not None]


def read_tsv(path: Path, *, repeated: bool = False) -> pd.DataFrame:
    """Read a table of texts separated by tabs.

    Raises DataError if it is not such a table, if two columns or two rows have the same name (unless
    `repeated` names are examined afterwards), or if a list of channels lacks the column ``name``.
    """
    try:
        stream = open_text(path)
        first = next((line for line in stream if line.strip()), "")
        labels = [label.strip().strip('"') for label in first.split("\t")]
        stream.seek(0)
        table = pd.read_csv(stream, sep="\t", dtype=str, keep_default_na=False, index_col=False)
        table = table.rename(columns=str.strip).apply(lambda cells: cells.str.strip())
    except (OSError, ValueError, pd.errors.ParserError) as error:
        raise DataError(
            f"{path.name} is not a table ({' '.join(str(error).split())}); expected columns separated "
            "by tabs below a row of names, in UTF-8: repair it."
        ) from error
    if path.name.endswith("channels.tsv") and "name" not in table.columns:
        raise DataError(
            f"{path.name} has the columns {', '.join(map(str, table.columns))}; expected 'name' "
            "among them: repair it."
        )
    if repeated:
        return table
    _require_different(path, "columns", labels)
    for key in (key for ending, key in IDENTIFYING_COLUMNS.items() if path.name.endswith(ending)):
        if key in table.columns:
            _require_different(path, "rows", row_names(table, key))
    return table


def row_names(table: pd.DataFrame, key: str) -> list[str]:
    """Name of every row; an electrode may be stated once in every system of coordinates."""
    names = [str(name) for name in table[key]]
    if "coordinate_system" not in table.columns:
        return names
    systems = table["coordinate_system"]
    return [f"{name} in {one}" if name else "" for name, one in zip(names, systems, strict=True)]


def _require_different(path: Path, what: str, names: Sequence[str]) -> None:
    """Refuse names that occur twice, of which only one would be used."""
    first: dict[str, int] = {}
    for place, name in enumerate(names, 1):
        if name.strip() and name in first:
            raise DataError(
                f"{path.name} has two {what} {name!r} ({first[name]} and {place}); expected different "
                "names: rename or remove one."
            )
        first[name] = place


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON file that contains an object.

    Raises DataError if the file is absent or contains none, if a number is not finite, or if a key
    occurs twice.
    """
    try:
        content = json_in(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(
            f"{path.name} cannot be read as JSON ({one_line(error)}); expected an object of keys and "
            "values: repair it."
        ) from error
    if not isinstance(content, dict):
        raise DataError(
            f"{path.name} contains no JSON object; expected keys and values: repair it."
        )
    return content


def table_of_scans(path: Path) -> Path | None:
    """Return the file ``*_scans.tsv`` of the volunteer and session of a file, if it exists."""
    labels = entities(path)
    own = {key: labels[key] for key in ENTITY_ORDER[:2] if key in labels}
    table = path.parent.parent / file_name(own, "scans.tsv") if own else None
    return table if table is not None and table.is_file() else None


def start_times(path: Path) -> dict[str, str]:
    """Return the start times as stated in ``*_scans.tsv``, by file name, of the files of a volunteer."""
    table = table_of_scans(path)
    if table is None:
        return {}
    scans = read_tsv(table)
    if not {"filename", "acq_time"} <= set(scans.columns):
        return {}
    return {
        Path(str(name)).name: str(time).strip()
        for name, time in zip(scans["filename"], scans["acq_time"], strict=True)
        if str(time).strip() not in ("", "n/a", "nan")
    }


def lag_between(first: str, second: str) -> tuple[float, Finding | None]:
    """Lag [s] of the second of two stated start times, with a finding if it is not known exactly.

    Times without a zone are local (BIDS), so that they cannot be compared with those of a zone.
    """
    values = {"first": first[:40], "second": second[:40]}
    try:
        lag = (datetime.fromisoformat(second) - datetime.fromisoformat(first)).total_seconds()
    except (ValueError, TypeError):  # no date, or a time with a zone and one without
        return 0.0, Finding("no_lag", "marker", "", values)
    if lag != 0.0 and not any(re.search(r"[.,]\d", one) for one in (first, second)):
        return lag, Finding("coarse_lag", "marker", "", values)
    return lag, None
