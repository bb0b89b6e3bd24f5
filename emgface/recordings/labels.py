"""Assignment of the labels of a file to the names of the study, with a record of omissions."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from pydantic import Field, field_validator

from emgface.choices import Parameters, configure
from emgface.errors import DataError, SchemaError, listed
from emgface.recordings.findings import Kind, findings_in, renamed
from emgface.recordings.trial_names import check_pattern, is_pattern, trial_in_name
from emgface.schema.rules import hint
from emgface.texts import read_toml


class Labels(Parameters):
    """Meaning of the labels of one recording, and its trial."""

    #: label in the file to name of the study; labels that are not listed are omitted, None keeps
    #: all
    channels: dict[str, str] | None = None
    markers: dict[str, str] | None = None  #: likewise
    #: unit of ``emg`` or ``position`` if that of the file is missing or wrong
    units: dict[str, str] = Field(default_factory=dict)
    volunteer: str | None = None  #: trial, if the file does not specify it
    instruction: str | None = None
    repetition: int | None = Field(default=None, ge=1)  #: counted from 1


class LabelMap(Labels):
    """Meaning of the labels of recordings, and their trials."""

    #: pattern of the names of files, which then state the trial, such as
    #: ``{volunteer}_{instruction}_{repetition}.c3d``
    names: str | None = None
    #: entries of single files by their names (or paths, from any folder on), which replace the others
    files: dict[str, Labels] = Field(default_factory=dict)

    @field_validator("names")
    @classmethod
    def _fields(cls, value: str | None) -> str | None:
        return None if value is None else check_pattern(value)

    def of_file(self, path: Path) -> "LabelMap":
        """Return the labels of one file: its own entries, then the common ones, then its name."""
        ends = {"/".join(path.parts[-k:]) for k in range(1, len(path.parts) + 1)}
        own = [labels for name, labels in self.files.items() if name.replace("\\", "/") in ends]
        given = trial_in_name(self.names, path) if self.names else {}
        for labels in (self, *own):
            given |= {
                name: getattr(labels, name)
                for name in Labels.model_fields
                if getattr(labels, name) not in (None, {})
            }
        return LabelMap(**given)


def read_label_map(mapping: Mapping[str, Any] | LabelMap | str | Path | None) -> LabelMap:
    """Return a label map from a mapping or a TOML file; None is an empty map.

    A text such as ``{volunteer}_{instruction}_{repetition}.c3d`` is a map that only contains this
    pattern of file names.

    Raises ConfigurationError if the file is absent or is not TOML, or contains an unknown entry
    (with the nearest valid one).

    Examples
    --------
    >>> read_label_map({"channels": {"EMG 1": "OOS_L"}}).channels
    {'EMG 1': 'OOS_L'}
    """
    if mapping is None:
        return LabelMap()
    if isinstance(mapping, LabelMap):
        return mapping
    if isinstance(mapping, Mapping):
        return configure(LabelMap, mapping, where="mapping")
    if is_pattern(mapping):
        return LabelMap(names=check_pattern(str(mapping)))
    return configure(LabelMap, read_toml(Path(mapping)), where=Path(mapping).name)


def apply_labels(recording: xr.Dataset, labels: LabelMap) -> xr.Dataset:
    """Rename and select channels and markers, in the order of the map, and name the trial.

    The attributes ``original_names`` and ``dropped`` (JSON) record the treatment of each label.
    Raises SchemaError if a mapped label is not in the file (with the nearest one), or two labels
    have one name.
    """
    names = note(recording, "original_names")
    dropped = note(recording, "dropped")
    maps: tuple[tuple[Kind, dict[str, str] | None], ...]
    maps = (("channel", labels.channels), ("marker", labels.markers))
    for dim, chosen in maps:
        if chosen is None:
            continue
        found = [str(v) for v in recording[dim].values] if dim in recording.coords else []
        # A channel that its file marks as bad is missing, and its finding says so.
        bad = {f.name for f in findings_in(recording) if (f.code, f.kind) == ("bad", dim)}
        recording = renamed(recording, dim, chosen)
        chosen = {k: name for k, name in chosen.items() if k in found or k not in bad}
        _demand(dim, chosen, found, dropped)
        for label in found:
            if label not in chosen:
                values = recording["emg" if dim == "channel" else "position"].sel({dim: label})
                still = constant_value(values.values)
                also = "" if still is None or dim == "marker" else f"; constant at {still:g} V"
                dropped[names.pop(label, label)] = f"not in the mapping{also}"
        recording = recording.sel({dim: list(chosen)}).assign_coords({dim: list(chosen.values())})
        for label, name in chosen.items():
            names[name] = names.pop(label, label)
    given = {
        name: value
        for name in ("volunteer", "instruction", "repetition")
        if (value := getattr(labels, name)) is not None
    }
    return recording.assign_attrs(
        **given,
        original_names=json.dumps(names, ensure_ascii=False),
        dropped=json.dumps(dropped, ensure_ascii=False),
    )


def _demand(dim: str, chosen: dict[str, str], found: list[str], dropped: dict[str, str]) -> None:
    """Refuse labels that the file lacks, and names that are assigned twice."""
    for label in chosen:
        if label in found:
            continue
        if label in dropped:
            raise SchemaError(
                f"The {dim} {label!r} was omitted ({dropped[label]}); expected a usable one: "
                "specify its unit in the table 'units' of the mapping, or map another."
            )
        raise SchemaError(
            f"The file has no {dim} {label!r}{hint(label, found)}; found {listed(found)}: "
            "repair the label in the mapping."
        )
    given = list(chosen.values())
    twice = [name for name in given if given.count(name) > 1]
    if twice:
        raise SchemaError(
            f"Two labels are mapped to the {dim} {twice[0]!r}; expected one: rename the other."
        )


def note(dataset: xr.Dataset, name: str) -> dict[str, str]:
    """Return an attribute of a recording that is a JSON object, empty if it is absent.

    It is ``original_names``, ``original_units``, ``dropped`` or ``flagged``. Raises DataError if
    the attribute is not a JSON object.
    """
    try:
        value = json.loads(str(dataset.attrs.get(name, "{}")))
    except json.JSONDecodeError:
        value = None
    if not isinstance(value, dict):
        raise DataError(
            f"The attribute {name!r} is {dataset.attrs[name]!r}; expected a JSON object: "
            "delete or repair it."
        )
    return {str(key): str(text) for key, text in value.items()}


def constant_value(values: np.ndarray) -> float | None:
    """Return the value of a constant signal; None if it varies or has no finite sample."""
    finite = values[np.isfinite(values)]
    if finite.size == 0 or finite.min() != finite.max():
        return None
    return float(finite[0])
