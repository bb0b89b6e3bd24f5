"""Findings about a recording as data: code, place and values, stored with it and repeated later.

A finding is found once, by a reader, by the guards of `emgface.recordings.guards` or by
`emgface.recordings.check`, and is stored in the attribute ``findings`` (JSON) of the dataset. It
follows the channel or marker through naming, cutting and files. Sentences are made from it only
where a person reads them.
"""

import json
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal, TypeVar, get_args

import xarray as xr

from emgface.errors import DataError
from emgface.recordings.finding_codes import CODES, Verdict

Kind = Literal["recording", "channel", "muscle", "marker"]
FINDING_KINDS: Final[tuple[Kind, ...]] = get_args(Kind)

_Data = TypeVar("_Data", xr.Dataset, xr.DataArray)

ATTRIBUTE: Final = "findings"  #: attribute of a dataset that contains its findings
_MANY: Final = ("gaps", "doubtful_marks", "harmless_marks")  #: codes of findings at many instants
MOST_FINDINGS: Final = 2000  #: most findings that a dataset stores; further ones are counted


@dataclass(frozen=True)
class Finding:
    """One finding: code, channel, muscle or marker (empty for all of them), and values in SI units."""

    code: str
    kind: Kind = "recording"
    name: str = ""
    values: Mapping[str, float | str] = field(default_factory=dict)

    @property
    def verdict(self) -> Verdict:
        """Severity."""
        return CODES[self.code].verdict

    @property
    def clause(self) -> str:
        """Finding in words, without the name of the channel or marker."""
        return CODES[self.code].clause.format(**self.values)

    @property
    def sentence(self) -> str:
        """Finding in words, with the name of the channel or marker."""
        place = {"recording": "recording", "channel": "all channels"}
        place |= {"muscle": "all muscles", "marker": "all markers"}
        return f"{f'{self.kind} {self.name}' if self.name else place[self.kind]}: {self.clause}"

    def as_data(self) -> dict[str, Any]:
        """Finding for JSON."""
        return {"code": self.code, "kind": self.kind, "name": self.name, **dict(self.values)}


def findings_in(dataset: xr.Dataset | xr.DataArray) -> list[Finding]:
    """Return the findings stored with a dataset; DataError if the attribute is damaged."""
    text = str(dataset.attrs.get(ATTRIBUTE, "[]"))
    try:
        stored = [_finding(item) for item in json.loads(text)]
        for one in stored:
            _ = one.sentence
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise DataError(
            f"The attribute {ATTRIBUTE!r} is {text[:60]!r}; expected the JSON list of findings that "
            "this package writes: delete it."
        ) from None
    return stored


def _finding(item: dict[str, Any]) -> Finding:
    code, kind, name = (str(item.pop(key)) for key in ("code", "kind", "name"))
    if code not in CODES or kind not in FINDING_KINDS:
        raise KeyError(code)
    if any(not isinstance(value, str | int | float) for value in item.values()):
        raise TypeError
    return Finding(code, kind, name, item)  # pyright: ignore[reportArgumentType]


def with_findings(dataset: _Data, findings: Iterable[Finding]) -> _Data:
    """Store findings with a dataset, in addition to those that it has, each once."""
    every = {json.dumps(f.as_data(), sort_keys=True): f for f in [*findings_in(dataset), *findings]}
    return _stored(dataset, list(every.values()))


def only_findings(dataset: xr.Dataset, keep: Callable[[Finding], Finding | None]) -> xr.Dataset:
    """Change or remove (None) each finding stored with a dataset."""
    if ATTRIBUTE not in dataset.attrs:
        return dataset
    changed = [keep(finding) for finding in findings_in(dataset)]
    return _stored(dataset, [finding for finding in changed if finding is not None])


def _stored(dataset: _Data, findings: Sequence[Finding]) -> _Data:
    result = dataset.assign_attrs()
    result.attrs.pop(ATTRIBUTE, None)
    if findings:
        data = [finding.as_data() for finding in findings[:MOST_FINDINGS]]
        result.attrs[ATTRIBUTE] = json.dumps(data, ensure_ascii=False)
    return result


def renamed(dataset: xr.Dataset, kind: Kind, names: Mapping[str, str]) -> xr.Dataset:
    """Rename channels or markers in the findings; those that `names` lacks are removed."""

    def keep(finding: Finding) -> Finding | None:
        if finding.kind != kind or not finding.name or finding.code == "left_out":
            return finding
        return replace(finding, name=names[finding.name]) if finding.name in names else None

    return only_findings(dataset, keep)


def shifted(
    dataset: xr.Dataset,
    shift: float,
    *,
    kinds: Collection[Kind] = FINDING_KINDS,
) -> xr.Dataset:
    """Move the instants of the findings of some kinds by `shift` [s], as those of their samples."""

    def keep(finding: Finding) -> Finding:
        if "at" not in finding.values or finding.kind not in kinds:
            return finding
        return replace(
            finding, values={**finding.values, "at": float(finding.values["at"]) + shift}
        )

    return only_findings(dataset, keep)


def within(dataset: xr.Dataset, start: float, stop: float) -> xr.Dataset:
    """Keep the findings without an instant, and those that extend into an interval [s]."""

    def keep(finding: Finding) -> Finding | None:
        if "at" not in finding.values or finding.code in _MANY:
            return finding
        first = float(finding.values["at"])
        last = first + float(finding.values.get("seconds", 0.0))
        return finding if first < stop and last >= start else None

    return only_findings(dataset, keep)


def used(
    findings: Iterable[Finding], *, channels: Collection[str] = (), markers: Collection[str] = ()
) -> list[Finding]:
    """Return the findings on the channels and markers that a step uses, and on all of them."""
    names: dict[str, Collection[str]] = {"channel": channels, "marker": markers, "muscle": ()}
    return [
        finding
        for finding in findings
        if finding.kind == "recording"
        or finding.name in names[finding.kind]
        or (not finding.name and names[finding.kind])
    ]
