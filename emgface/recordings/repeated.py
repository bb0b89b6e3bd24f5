"""Findings that a later step repeats, because it uses the channels and markers concerned.

`emgface.api`, the commands and the stages of a study call these functions, so that what the check of a
recording knows is stored with every result, and stated where a person reads it.
"""

import warnings
from collections.abc import Collection, Iterable
from typing import Final

import xarray as xr

from emgface.errors import EmgfaceError, FeatureWarning, listed
from emgface.muscles import CHANNELS, FACE_MARKERS, LIP_MARKERS
from emgface.recordings.check import findings_of
from emgface.recordings.fillers import usable_parts
from emgface.recordings.findings import Finding, findings_in, used, with_findings
from emgface.signals.doubtful import little_in_common

SCORED_MARKERS: Final = (*FACE_MARKERS, *LIP_MARKERS)  #: markers from which a motion is scored
STATED: Final = frozenset(
    "too_few invisible uneven absent_samples constant no_band narrow slow large little_in_common "
    "nothing_in_common lost lost_briefly ends".split()
)
"""Codes that the steps themselves refuse, warn of or count."""


def findings_for(
    recording: xr.Dataset, *, channels: Collection[str] = (), markers: Collection[str] = ()
) -> list[Finding]:
    """Return the findings on the channels and markers of a recording that a step uses.

    Parts of a recording that cannot be examined have none; the step itself refuses them.
    """
    recording = usable_parts(recording)
    try:
        findings = findings_of(recording) if recording.data_vars else findings_in(recording)
    except (EmgfaceError, KeyError):
        return []
    return used(findings, channels=channels, markers=markers)


def for_activation(recording: xr.Dataset) -> list[Finding]:
    """Findings on the channels of the study, missing ones included, and on the clocks."""
    return [*_of_clocks(recording), *findings_for(recording, channels=CHANNELS)]


def for_scores(recording: xr.Dataset) -> list[Finding]:
    """Findings on the face and lip markers, and on the clocks."""
    markers = findings_for(recording.drop_vars("emg", errors="ignore"), markers=SCORED_MARKERS)
    return [*_of_clocks(recording), *markers]


def _of_clocks(recording: xr.Dataset) -> list[Finding]:
    """Findings on the clocks of sEMG and markers; none of parts that cannot be examined."""
    return little_in_common(usable_parts(recording))


def stored_with(
    result: xr.Dataset, findings: Iterable[Finding], *sources: xr.Dataset
) -> xr.Dataset:
    """Store findings, and those of the datasets from which a result was computed, with the result."""
    inherited = [finding for source in sources for finding in findings_in(source)]
    return with_findings(result, [*inherited, *findings])


def warn_of(findings: Iterable[Finding], *, stacklevel: int = 3) -> None:
    """Warn of each kind of finding that the step itself does not state."""
    doubts = (f for f in findings if f.code not in STATED and f.verdict != "ok")
    for sentence in sentences(doubts):
        warnings.warn(sentence, FeatureWarning, stacklevel=stacklevel)


def sentences(findings: Iterable[Finding]) -> list[str]:
    """One sentence without full stop for each code: where, and the first finding in words."""
    return [
        f"{_where(group)}: {group[0].clause}{', and similarly' if len(group) > 1 else ''}"
        if group[0].name
        else group[0].sentence
        for group in _grouped(findings)
    ]


def headline(findings: Iterable[Finding]) -> str:
    """Codes with the channels and markers concerned, without numbers, for a column of a table."""
    parts = [
        " ".join(filter(None, (group[0].code.replace("_", " "), _names(group))))
        for group in _grouped(f for f in findings if f.verdict != "ok")
    ]
    return f"check: {', '.join(parts)}" if parts else ""


def _grouped(findings: Iterable[Finding]) -> list[list[Finding]]:
    groups: dict[tuple[str, str], list[Finding]] = {}
    for finding in findings:
        groups.setdefault((finding.code, finding.kind), []).append(finding)
    return list(groups.values())


def _names(group: list[Finding]) -> str:
    names = list(dict.fromkeys(finding.name for finding in group if finding.name))
    return f"({listed(names, 3)})" if names else ""


def _where(group: list[Finding]) -> str:
    names = list(dict.fromkeys(finding.name for finding in group))
    return f"{group[0].kind}{'s' if len(names) > 1 else ''} {listed(names)}"
