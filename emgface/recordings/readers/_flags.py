"""Channels and intervals that a file marks as bad: values NaN or left out, each with a finding."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import pandas as pd

from emgface.recordings.findings import Finding, Kind
from emgface.recordings.marks import Mark, is_bad_mark, unapplied_marks
from emgface.recordings.readers._build import Part
from emgface.recordings.timebase import TimeBase

BAD = "marked as bad"  #: begin of the reason of a channel that was left out because it is bad
_LISTED = 20  #: intervals that are described one by one
_STATUS: Final = ("good", "bad", "n/a", "", "nan")


def with_marks(
    part: Part, base: TimeBase, marks: Sequence[Mark], what: str, labels: Sequence[str]
) -> Part:
    """Replace the samples of intervals that marks call bad by NaN; other such marks are findings.

    Channels after ``@@`` in the text are the only ones concerned, if they are among the `labels`.
    """
    for start, duration, text in marks:
        if is_bad_mark(text) and duration > 0.0:
            named = [name for name in text.strip().split("@@")[1:] if name in labels] or None
            inside = (base.times >= start) & (base.times < start + duration)
            by = f"the {what} {text.strip()!r}"
            part = with_bad_samples(part, "channel", base, inside[base.places], by, named)
    return part._replace(findings=[*part.findings, *unapplied_marks(marks, what)])


def bad_rows(table: pd.DataFrame | None, names: Sequence[str]) -> dict[str, str]:
    """Channels with ``status`` bad in a table of BIDS, with ``status_description`` (or empty)."""
    if table is None or "status" not in table.columns:
        return {}
    reasons: dict[str, str] = {}
    for row in table.to_dict("records"):
        if str(row["status"]).strip().lower() == "bad" and str(row["name"]) in names:
            reason = str(row.get("status_description", "n/a")).strip()
            reasons[str(row["name"])] = "" if reason in ("", "n/a", "nan") else reason
    return reasons


def odd_status(
    table: pd.DataFrame | None, names: Sequence[str], kind: Kind, by: str
) -> list[Finding]:
    """Findings on channels whose ``status`` in a table of BIDS is neither good, bad nor n/a."""
    if table is None or "status" not in table.columns:
        return []
    rows = zip(table["name"], table["status"], strict=True)
    return [
        Finding("status", kind, str(name), {"status": str(status), "by": by})
        for name, status in rows
        if str(name) in names and str(status).strip().lower() not in _STATUS
    ]


def without_bad(part: Part, dim: Kind, bad: dict[str, str], by: str) -> Part:
    """Leave out channels that a table marks as bad; markers are not visible instead."""
    if not bad:
        return part
    marks = [
        Finding("bad", dim, name, {"by": by, "why": f" ({why})" if why else ""})
        for name, why in bad.items()
    ]
    part = part._replace(findings=[*part.findings, *marks])
    if part.data is None:
        return part
    names = [str(name) for name in part.data[dim].values]
    if dim == "marker":
        hidden = np.array([name in bad for name in names])
        seen = part.data["position"].where(~part.data["marker"].isin(np.array(names)[hidden]))
        return part._replace(data=part.data.assign(position=seen.assign_attrs(units="m")))
    keep = [name for name in names if name not in bad]
    reasons = {
        name: f"{BAD} in {by}{f' ({bad[name]})' if bad[name] else ''}"
        for name in names
        if name in bad
    }
    data = part.data.sel(channel=keep) if keep else None
    return part._replace(data=data, dropped={**part.dropped, **reasons})


def with_bad_samples(
    part: Part,
    dim: Kind,
    base: TimeBase,
    bad: np.ndarray,
    by: str,
    names: Sequence[str] | None = None,
) -> Part:
    """Replace samples that are marked as bad by NaN; `bad` (stored samples) is a mask.

    `names` are the channels or markers concerned, all of them if None.
    """
    if part.data is None or not bad.any():
        return part
    laid = base.laid(bad.astype(float)) == 1.0
    variable, time = ("position", "time_marker") if dim == "marker" else ("emg", "time_emg")
    array = part.data[variable]
    labels = [str(name) for name in array[dim].values]
    concerned = [name for name in labels if names is None or name in names]
    if not concerned:
        return part
    where = array[dim].isin(concerned) & array[time].copy(data=laid)
    data = part.data.assign({variable: array.where(~where).assign_attrs(array.attrs)})
    if laid[base.places].all():
        every = [
            Finding("all_bad_frames" if dim == "marker" else "all_bad", dim, name,
                    {"by": by, "samples": int(bad.sum())})
            for name in concerned
        ]  # fmt: skip
        return part._replace(data=data, findings=[*part.findings, *every])
    edges = np.flatnonzero(np.diff(np.concatenate(([0], laid.astype(np.int8), [0]))))
    code = "bad_frames" if dim == "marker" else "bad_interval"
    marks = [
        Finding(code, dim, name, {
            "by": by, "at": float(base.times[start]), "seconds": float((stop - start) / base.rate)
        })
        for name in ([""] if names is None else concerned)
        for start, stop in zip(edges[::2][:_LISTED], edges[1::2], strict=False)
    ]  # fmt: skip
    return part._replace(data=data, findings=[*part.findings, *marks])
