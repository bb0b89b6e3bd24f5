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
from emgface.muscles import INSTRUCTIONS, LETTERS
from emgface.recordings.findings import (
    Finding,
    Kind,
    findings_in,
    only_findings,
    renamed,
    with_findings,
)  # fmt: skip
from emgface.recordings.marks import (
    BY_MAPPING,
    StatedMark,
    labels_of,
    require_labels,
    with_gap,
    with_stated_marks,
)
from emgface.recordings.trial_names import TRIAL_FIELDS, check_pattern, is_pattern, trial_in_name
from emgface.schema.rules import hint
from emgface.texts import read_toml


class UnusableSpan(Parameters):
    """Time in which signals must not be used."""

    start: float  #: s, in the time of the recording
    stop: float  #: s
    channels: list[str] = Field(default_factory=list)  #: labels in the file
    markers: list[str] = Field(default_factory=list)  #: likewise; without both lists, all signals


class Unusable(Parameters):
    """Parts of a recording that a person marked as unusable."""

    channels: list[str] = Field(default_factory=list)  #: labels in the file; treated as missing
    markers: list[str] = Field(default_factory=list)  #: labels in the file; never visible
    spans: list[UnusableSpan] = Field(default_factory=list)  #: treated as gaps


class Labels(Parameters):
    """Meaning of the labels of one recording, and its trial."""

    #: label in the file to name of the study; labels that are not listed are omitted, None keeps
    #: all
    channels: dict[str, str] | None = None
    markers: dict[str, str] | None = None  #: likewise
    #: unit of ``emg`` (all channels), of a channel by its label, or of ``position``, if that of the
    #: file is missing or wrong
    units: dict[str, str] = Field(default_factory=dict)
    #: channels, markers and spans that must not be used (``emgface show RECORDING --save`` writes them)
    unusable: Unusable = Field(default_factory=Unusable)
    #: meaning of marks that are stated as doubtful, by their texts
    marks: dict[str, StatedMark] = Field(default_factory=dict)
    volunteer: str | None = None  #: trial, if the file does not specify it
    instruction: str | None = None
    repetition: int | None = Field(default=None, ge=1)  #: counted from 1
    #: letter of the study for what files or their names call an instruction, such as ``smile``
    instructions: dict[str, str] = Field(default_factory=dict)

    @field_validator("instructions")
    @classmethod
    def _letters(cls, values: dict[str, str]) -> dict[str, str]:
        for name, letter in values.items():
            if letter not in INSTRUCTIONS:
                raise ValueError(f"{name!r} is instruction {letter!r}, expected one of {LETTERS}")
        return values


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
                if getattr(labels, name) not in (None, {}, Unusable())
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
    recording = without_unusable(recording, labels.unusable)
    recording = with_stated_marks(recording, labels.marks)
    names = note(recording, "original_names")
    dropped = note(recording, "dropped")
    channels = [str(v) for v in recording.coords["channel"].values] if "emg" in recording else []
    maps: tuple[tuple[Kind, dict[str, str] | None], ...]
    maps = (("channel", labels.channels), ("marker", labels.markers))
    for dim, chosen in maps:
        if chosen is None:
            continue
        present = [str(v) for v in recording[dim].values] if dim in recording.coords else []
        # A channel that its file marks as bad is missing, and its finding says so.
        bad = {f.name for f in findings_in(recording) if (f.code, f.kind) == ("bad", dim)}
        recording = renamed(_without_mapped(recording, chosen), dim, chosen)
        chosen = {k: name for k, name in chosen.items() if k in present or k not in bad}
        _demand(dim, chosen, present, dropped)
        for label in present:
            if label not in chosen:
                values = recording["emg" if dim == "channel" else "position"].sel({dim: label})
                still = constant_value(values.values)
                also = "" if still is None or dim == "marker" else f"; constant at {still:g} V"
                dropped[names.pop(label, label)] = f"not in the mapping{also}"
        recording = recording.sel({dim: list(chosen)}).assign_coords({dim: list(chosen.values())})
        for label, name in chosen.items():
            names[name] = names.pop(label, label)
    every = {*names.values(), *names, *dropped, *channels}
    for label in labels.units:
        if label not in ("emg", "position") and label not in every:
            raise SchemaError(
                f"The table 'units' names {label!r}{hint(label, every)}; expected emg, position or the "
                "label of a channel: repair the mapping."
            )
    given = {name: value for name in TRIAL_FIELDS if (value := getattr(labels, name)) is not None}
    called = given.get("instruction", recording.attrs.get("instruction"))
    if called in labels.instructions:
        given["instruction"] = labels.instructions[called]
        if recording.attrs.get("instruction") == called:  # no contradiction of file and mapping
            recording = recording.assign_attrs(instruction=given["instruction"])
    recording = with_findings(recording, _other_trial(recording.attrs, given))
    return recording.assign_attrs(
        **given,
        original_names=json.dumps(names, ensure_ascii=False),
        dropped=json.dumps(dropped, ensure_ascii=False),
    )


def _other_trial(stated: Mapping[Any, Any], given: Mapping[str, Any]) -> list[Finding]:
    """Findings on what a mapping or a name states about a trial and the file states otherwise."""
    return [
        Finding(
            "named_otherwise",
            values={"what": name, "recorded": str(stated[name]), "given": str(value)},
        )
        for name, value in given.items()
        if stated.get(name) not in (None, "", value)
    ]


def _without_mapped(recording: xr.Dataset, chosen: Mapping[str, str]) -> xr.Dataset:
    """Remove findings on repeated labels of which a mapping names the others as well."""

    def keep(finding: Finding) -> Finding | None:
        known = finding.code == "repeated_label" and str(finding.values["other"]) in chosen
        return None if known else finding

    return only_findings(recording, keep)


def without_unusable(recording: xr.Dataset, unusable: Unusable) -> xr.Dataset:
    """Leave out unusable channels, and replace unusable markers and spans by NaN, with findings.

    Raises SchemaError if a label is not in the file (with the nearest one), or a span does not lie in
    the recording.
    """
    findings, present = list[Finding](), labels_of(recording)
    given: dict[Kind, list[str]] = {
        "channel": [*unusable.channels, *(c for s in unusable.spans for c in s.channels)],
        "marker": [*unusable.markers, *(m for s in unusable.spans for m in s.markers)],
    }
    for dim, names in given.items():
        require_labels(dim, names, present[dim], "unusable")
    whole: dict[Kind, list[str]] = {"channel": unusable.channels, "marker": unusable.markers}
    for dim, names in whole.items():
        findings += [Finding("bad", dim, name, {"by": BY_MAPPING, "why": ""}) for name in names]
    for span in unusable.spans:
        named: dict[Kind, list[str]] = {"channel": span.channels, "marker": span.markers}
        if not (span.channels or span.markers):
            named = {"channel": [""], "marker": [""]}
        last = float(np.nextafter(span.stop, np.inf))  # the sample at the stop is part of the span
        recording, gaps = with_gap(recording, (span.start, last), named, BY_MAPPING)
        if not gaps:
            raise SchemaError(
                f"The unusable span from {span.start:g} to {span.stop:g} s contains no sample of the "
                "recording; expected times in s in which it was recorded, the smaller one first: repair "
                "the table 'unusable' of the mapping."
            )
        findings += gaps
    dropped = note(recording, "dropped")
    if unusable.channels:
        dropped |= {name: f"marked as bad in {BY_MAPPING}" for name in unusable.channels}
        keep = [name for name in present["channel"] if name not in unusable.channels]
        recording = recording.sel(channel=keep)
        if not keep:
            recording = recording.drop_vars("emg").drop_dims(["channel", "time_emg"])
        recording = recording.assign_attrs(dropped=json.dumps(dropped, ensure_ascii=False))
    if unusable.markers:
        hidden = recording["marker"].isin(unusable.markers)
        position = recording["position"]
        recording["position"] = position.where(~hidden).assign_attrs(position.attrs)
    return with_findings(recording, findings) if findings else recording


def _demand(dim: str, chosen: dict[str, str], present: list[str], dropped: dict[str, str]) -> None:
    """Refuse labels that the file lacks, and names that are assigned twice."""
    for label in chosen:
        if label in present:
            continue
        if label in dropped:
            raise SchemaError(
                f"The {dim} {label!r} was omitted ({dropped[label]}); expected a usable one: "
                f"if it is EMG, specify its unit by an entry {label!r} in the table 'units' of the "
                "mapping (emg there replaces the units of all channels), or map another."
            )
        raise SchemaError(
            f"The file has no {dim} {label!r}{hint(label, present)}; found {listed(present)}: "
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
