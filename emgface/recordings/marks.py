"""Marks of a file that may call samples bad, and what a mapping states about them: bad or harmless."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, Literal, NamedTuple

import xarray as xr
from pydantic import Field, model_validator

from emgface.choices import Parameters
from emgface.errors import SchemaError, listed
from emgface.recordings.findings import Finding, Kind, findings_in, only_findings, with_findings
from emgface.schema.rules import hint

BY_MAPPING: Final = "the mapping"  #: where a person stated something about a recording
MARK_CODES: Final = ("doubtful_mark", "doubtful_marks", "bad_moment")
"""Codes of the findings on marks whose samples are used until a mapping states their meaning."""
_LISTED: Final = 20  #: marks that are described one by one
_LONGEST_TEXT: Final = 80  #: characters of a mark that are stored and compared
_BAD_MARK: Final = re.compile(r"bad(?:[\s_:@-].*)?", re.IGNORECASE)
_DOUBTFUL: Final = re.compile(
    r"art[ei]f[ae][ck]t|\bbad\b|satur|clipp(?:ed|ing)|\b(?:electrodes?|leads?|contact|signal) *"
    r"(?:is |was |are |were )?(?:off|lost|loose|fell|open)\b|disconnect|unplugged|detached|"
    r"\b(?:off|loose|lost) +(?:electrode|lead|contact|signal|cable)|drop ?out|reject|unusable|"
    r"corrupt|invalid|\bnois[ey]\b|\bexclude|\bignore|overload|out of range|schlecht|gest\u00f6rt|"
    r"st\u00f6rung|rauschen|mauvais|\bbruit\b|\bslecht|\bruis\b",
    re.IGNORECASE,
)
_SOUND: Final = re.compile(
    r"\b(?:no|not|non|without|free of|removed|corrected|kein\w*|ohne|sans|geen)\b|\bfree\b|"
    r"\b(?:white|pink|masking) noise\b",
    re.IGNORECASE,
)


class Mark(NamedTuple):
    """Annotation of an interval [s] and its text."""

    start: float
    duration: float
    text: str


class StatedMark(Parameters):
    """Meaning of the marks with one text, as a person states it."""

    meaning: Literal["bad", "harmless"]  #: their samples are gaps, or are used
    by: str = BY_MAPPING  #: who states it
    #: length of the gap [s] from the begin of each mark; by default until its end
    seconds: float | None = Field(default=None, gt=0)
    channels: list[str] = Field(default_factory=list)  #: labels in the file of what is bad
    #: likewise; without both lists all channels, or of a recording without channels all markers
    markers: list[str] = Field(default_factory=list)

    @model_validator(mode="after")
    def _fits(self) -> "StatedMark":
        if self.meaning == "harmless" and (self.seconds or self.channels or self.markers):
            raise ValueError(
                "a harmless mark takes neither seconds nor channels nor markers: omit them, or state "
                "meaning = 'bad'"
            )
        return self


def is_bad_mark(text: str) -> bool:
    """Return True for the text of an annotation or marker that marks data as bad, as in MNE-Python.

    Examples
    --------
    >>> is_bad_mark("BAD_movement"), is_bad_mark("bad@@EMG 1"), is_bad_mark("Baden")
    (True, True, False)
    """
    return _BAD_MARK.fullmatch(text.strip()) is not None


def is_doubtful_mark(text: str) -> bool:
    """Return True for a text that may call samples bad in other words, such as ``noise``.

    Examples
    --------
    >>> is_doubtful_mark("artifact?"), is_doubtful_mark("no artifacts"), is_doubtful_mark("smile")
    (True, False, False)
    """
    spaced = re.sub(r"[_-]+", " ", text)
    return bool(_DOUBTFUL.search(spaced)) and not _SOUND.search(spaced)


def unapplied_marks(marks: Sequence[Mark], what: str) -> list[Finding]:
    """Findings on marks that call data bad without a duration, or that may do so in other words.

    The samples are used, because such a text may also describe what was done or a movement. Many marks
    in other words are counted by their text, with the times of all of them after the first.
    """
    by_text: dict[str, list[Mark]] = {}
    moments: list[Finding] = []
    for mark in marks:
        text = _stored_text(mark.text)
        if is_bad_mark(text):
            values = {"by": f"the {what} {text!r}", "at": mark.start, "text": text}
            moments += [] if mark.duration > 0.0 else [Finding("bad_moment", "channel", "", values)]
        elif is_doubtful_mark(text):
            by_text.setdefault(text, []).append(mark)
    groups = list(by_text.items())
    every = sum(len(same) for _, same in groups) <= _LISTED
    if every:
        groups = [(text, [mark]) for text, same in groups for mark in same]
    return moments + [
        Finding("doubtful_mark" if every else "doubtful_marks", "channel", "", {
            "by": f"the {what} {text!r}", "text": text, "at": same[0].start,
            "seconds": sum(mark.duration for mark in same), "count": len(same),
            "spans": " ".join(f"{m.start - same[0].start:.9g}+{m.duration:.9g}" for m in same),
        })
        for text, same in groups
    ]  # fmt: skip


def with_stated_marks(recording: xr.Dataset, stated: Mapping[str, StatedMark]) -> xr.Dataset:
    """Apply what a mapping states about marks, by their texts: gaps, or notes instead of findings.

    Raises SchemaError if a text is none that becomes a finding, a bad mark has no duration and none is
    stated, or a label is not in the recording.
    """
    by_text = {_stored_text(text).lower(): meaning for text, meaning in stated.items()}
    for text in stated:
        if not (is_bad_mark(text) or is_doubtful_mark(text)):
            raise SchemaError(
                f"The table 'marks' names {text!r}, which is no finding, so that its marks are not "
                "stored; expected the text of a mark that is stated as doubtful: repair it, or list "
                "the intervals as 'spans' in the table 'unusable'."
            )
    if not by_text:
        return recording
    every: list[Finding] = []
    for finding in findings_in(recording):
        text = str(finding.values.get("text", "")).lower()
        meaning = by_text.get(text) if finding.code in MARK_CODES else None
        if meaning is None:
            every.append(finding)
        elif meaning.meaning == "harmless":
            code = "harmless_marks" if finding.code == "doubtful_marks" else "harmless_mark"
            values = {**finding.values, "who": meaning.by}
            every.append(replace(finding, code=code, values=values))
        else:
            recording, gaps = _with_gaps(recording, finding, meaning)
            every += gaps
    return with_findings(only_findings(recording, lambda _: None), every)


def _with_gaps(
    recording: xr.Dataset, finding: Finding, meaning: StatedMark
) -> tuple[xr.Dataset, list[Finding]]:
    """Replace the samples of marks that a person calls bad by NaN."""
    present = labels_of(recording)
    chosen: dict[Kind, list[str]] = {"channel": meaning.channels, "marker": meaning.markers}
    for dim, names in chosen.items():
        require_labels(dim, names, present[dim], "marks")
    every = not (meaning.channels or meaning.markers)
    if every:
        chosen["channel" if present["channel"] else "marker"] = [""]
    by = f"{finding.values['by']}, which {meaning.by} states as bad,"
    gaps: list[Finding] = []
    for start, duration in _spans(finding):
        seconds = meaning.seconds or duration
        if not seconds > 0.0:
            raise SchemaError(
                f"{finding.values['by']} at {start:.6g} s has no duration, and the mapping states it as "
                "bad; expected the length of the gap: add 'seconds' to its entry in the table 'marks'."
            )
        recording, new = with_gap(recording, (start, start + seconds), chosen, by)
        gaps += new
    return recording, gaps


def _spans(finding: Finding) -> list[tuple[float, float]]:
    """Start and duration [s] of each mark of a finding."""
    first = float(finding.values["at"])
    pairs = [one.split("+", 1) for one in str(finding.values.get("spans", "0+0")).split()]
    return [(first + float(start), float(duration)) for start, duration in pairs]


def with_gap(
    recording: xr.Dataset,
    span: tuple[float, float],
    chosen: Mapping[Kind, Sequence[str]],
    by: str,
) -> tuple[xr.Dataset, list[Finding]]:
    """Replace the samples of a span (start and stop [s], without the latter) by NaN, with findings.

    `chosen` are the channels and markers, and a single empty name all of them. No finding is returned
    if the span contains no sample.
    """
    start, stop = span
    recording, findings = recording.copy(), list[Finding]()
    kinds: tuple[tuple[Kind, str, str, str], ...] = (
        ("channel", "emg", "time_emg", "bad_interval"),
        ("marker", "position", "time_marker", "bad_frames"),
    )
    for dim, variable, time, code in kinds:
        names = list(chosen.get(dim, ()))
        if variable not in recording or not names:
            continue
        array = recording[variable]
        inside = (recording[time] >= start) & (recording[time] < stop)
        if not inside.any():
            continue
        concerned = array[dim].isin(names) | (names == [""])
        recording[variable] = array.where(~(concerned & inside)).assign_attrs(array.attrs)
        values = {"by": by, "seconds": stop - start, "at": start}
        findings += [Finding(code, dim, name, values) for name in names]
    return recording, findings


def labels_of(recording: xr.Dataset) -> dict[Kind, list[str]]:
    """Labels of the channels and markers of a recording."""
    return {
        dim: [str(v) for v in recording[dim].values] if dim in recording.coords else []
        for dim in ("channel", "marker")
    }


def require_labels(dim: Kind, names: Sequence[str], present: Sequence[str], table: str) -> None:
    """Raise SchemaError if a label of a `table` of a mapping is not in the recording."""
    for label in names:
        if label not in present:
            raise SchemaError(
                f"The file has no {dim} {label!r}{hint(label, present)}; found "
                f"{listed(present) or 'none'}: repair the table {table!r} of the mapping."
            )


def _stored_text(text: str) -> str:
    return text.strip()[:_LONGEST_TEXT]
