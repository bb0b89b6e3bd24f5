"""Table of the channels and markers of a recording, with a verdict on each."""

import numpy as np
import pandas as pd
import xarray as xr

from emgface.muscles import CHANNELS
from emgface.recordings.finding_codes import Verdict
from emgface.recordings.findings import Finding, findings_in
from emgface.recordings.kinds import Signal, kind_of_name, kind_of_unit, signal_of
from emgface.recordings.quality.findings import findings
from emgface.recordings.verdicts import (
    channel_findings,
    clock_of,
    judged,
    marker_findings,
    row_of,
)
from emgface.schema.rules import nearest
from emgface.schema.validation import declaration
from emgface.signals.parameters import HeadFrameParameters


def check_recording(
    recording: xr.Dataset,
    *,
    study: bool = False,
    max_gap: float | None = None,
) -> pd.DataFrame:
    """Examine every channel and marker of a recording.

    `study` lists also the channels and markers that a study requires and the recording lacks.
    `max_gap` is the longest gap [s] of a marker that is interpolated later; the default is that of
    `emgface.signals.parameters.HeadFrameParameters`. Hum, artefacts, drift, saturation, baseline,
    cross-talk, doubtful rates and gains, noise of markers, and exchanged names are measured by
    `emgface.recordings.quality`.

    The table has the columns ``name``, ``kind`` (channel or marker), ``signal`` (EMG, position, or
    another signal of `emgface.recordings.kinds`), ``rate`` [Hz], ``duration`` [s] (samples over
    rate), ``unit``, ``finite`` (fraction of samples), ``longest_gap`` [s], ``constant``, ``rms``
    (about zero for a channel, about its mean for a marker), ``smallest``, ``largest``, the measures
    of `emgface.recordings.quality` (NaN if they do not apply), ``verdict`` (ok, warning, error, or
    not EMG) and ``reason``.

    Errors are properties that prevent use in a study: a gap in EMG; a constant channel, for which
    Eq. 8 is 0/0; a marker that is never visible, or lost for longer than `max_gap` between frames
    in which it is visible; a clock that is not uniform. Warnings should be examined by a person.
    Channels without EMG, including those omitted by the reader because of their unit, have no such
    verdict.
    """
    limit = HeadFrameParameters().max_gap if max_gap is None else max_gap
    examined, all_findings = _examined(recording, limit)
    first = {
        kind: next((r["name"] for r in examined if _judgeable(r, kind)), None)
        for kind in CHECKED_DIMS
    }
    rows: list[dict[str, object]] = []
    for row in examined:
        own = [f for f in all_findings if f.kind == row["kind"] and f.name == row["name"]]
        # A finding on the whole recording is stated with its first channel or marker.
        if row["name"] == first[str(row["kind"])]:
            own += [f for f in all_findings if not f.name and f.kind in (row["kind"], "recording")]
        if "verdict" in row:  # a channel without EMG
            reasons = "; ".join([str(row["reason"]), *(f.clause for f in own)])
            rows.append({**row, "reason": reasons})
        else:
            rows.append(judged(row, own))
    rows += _lost(rows, all_findings)
    rows += _of_nothing(all_findings, first)
    if study:
        rows += _absent(rows)
    columns = list(dict.fromkeys(key for row in rows for key in row))
    last = ["verdict", "reason"]
    columns = [name for name in columns if name not in last] or ["name", "kind", "signal"]
    return pd.DataFrame(rows, columns=columns + last)


def findings_of(recording: xr.Dataset) -> list[Finding]:
    """Return all findings on a recording: those stored with it, and those of the check."""
    return _examined(recording, HeadFrameParameters().max_gap)[1]


CHECKED_DIMS = ("channel", "marker")


def _examined(recording: xr.Dataset, limit: float) -> tuple[list[dict[str, object]], list[Finding]]:
    """Measure every channel and marker; return the rows without verdict and all findings."""
    rows: list[dict[str, object]] = []
    stored = findings_in(recording)
    all_findings = [finding for finding in stored if finding.code != "left_out"]
    if "emg" in recording:
        emg = recording["emg"]
        clock = clock_of(emg["time_emg"].values)
        for label, values in zip(emg["channel"].values, emg.values, strict=True):
            row = row_of(str(label), "channel", "V", values[None], clock)
            signal = signal_of(str(label), values, clock.rate)
            if signal.kind != "EMG" and str(label) not in CHANNELS:
                rows.append(_other(row, signal))
                continue
            rows.append(row | {"signal": "EMG"})
            all_findings += _not_marked(stored, channel_findings(values, row, clock))
    rows += _left_out(stored)
    if "position" in recording:
        position = recording["position"]
        clock = clock_of(position["time_marker"].values)
        for label, values in zip(position["marker"].values, position.values, strict=True):
            row = row_of(str(label), "marker", "m", values, clock) | {"signal": "position"}
            rows.append(row)
            all_findings += _not_marked(stored, marker_findings(values, row, clock, limit))
    named = [row["name"] for row in rows if row["signal"] == "EMG"]
    if "emg" in recording:
        recording = recording.sel(channel=named) if named else recording.drop_vars("emg")
    measures, further = findings(recording)
    rows = [{**row, **measures.get((str(row["kind"]), str(row["name"])), {})} for row in rows]
    return rows, all_findings + further


def _not_marked(stored: list[Finding], new: list[Finding]) -> list[Finding]:
    """Leave out that a signal is never visible where a mark of the file is the reason."""
    marked = {(f.kind, f.name) for f in stored if f.code in ("all_bad", "all_bad_frames")}
    return [f for f in new if f.code != "invisible" or (f.kind, f.name) not in marked]


def _judgeable(row: dict[str, object], kind: str) -> bool:
    return row["kind"] == kind and "verdict" not in row


def _lost(rows: list[dict[str, object]], all_findings: list[Finding]) -> list[dict[str, object]]:
    """Rows of the signals that reading left out, such as those marked as bad, by their findings."""
    present = {(row["kind"], row["name"]) for row in rows}
    absent = {(f.kind, f.name): f for f in all_findings if f.name and f.kind in CHECKED_DIMS}
    return [
        judged(
            _nothing(name, kind, "V" if kind == "channel" else "m") | {"signal": "EMG"},
            [f for f in all_findings if (f.kind, f.name) == (kind, name)],
        )
        for kind, name in absent
        if (kind, name) not in present
    ]


def _of_nothing(all_findings: list[Finding], first: dict[str, object]) -> list[dict[str, object]]:
    """Row of the findings on the whole recording, or on what is no signal, if no other has them."""
    whole = [kind for kind in CHECKED_DIMS if first[kind] is not None]
    stated = {*whole, "recording"} if whole else set[str]()
    left = [f for f in all_findings if f.kind not in (CHECKED_DIMS if f.name else stated)]
    if not left:
        return []
    return [judged(_nothing("", "recording", "") | {"signal": ""}, left)]


def problems(table: pd.DataFrame, verdict: Verdict = "error") -> list[str]:
    """Return one sentence for each row with a verdict ("error" or "warning").

    A row is a channel, a marker, or the recording as a whole.
    """
    columns = (table[name] for name in ("kind", "name", "verdict", "reason"))
    return [
        f"{kind} {name}: {reason}." if name else f"{kind}: {reason}."
        for kind, name, row_verdict, reason in zip(*columns, strict=True)
        if row_verdict == verdict
    ]


def _other(row: dict[str, object], signal: Signal) -> dict[str, object]:
    """Row of a channel that does not contain EMG."""
    return {**row, "signal": signal.kind, "verdict": "not EMG", "reason": signal.reason}


def _left_out(all_findings: list[Finding]) -> list[dict[str, object]]:
    """Rows for analog channels that the reader omitted because they are not voltages."""
    rows: list[dict[str, object]] = []
    for finding in all_findings:
        if finding.code != "left_out":
            continue
        unit, label = str(finding.values["unit"]), finding.name
        kind = str(finding.values["type"]) or kind_of_unit(unit) or kind_of_name(label)
        signal = Signal(kind or "other signal", f"left out in reading: {finding.clause}")
        rows.append(_other(_nothing(label, "channel", unit), signal))
    return rows


def _nothing(name: str, kind: str, unit: str) -> dict[str, object]:
    """Row of a signal without samples."""
    row: dict[str, object] = {"name": name, "kind": kind, "unit": unit, "constant": False}
    measures = ("rate", "duration", "finite", "longest_gap", "rms", "smallest", "largest")
    return row | dict.fromkeys(measures, np.nan)


def _absent(rows: list[dict[str, object]]) -> list[dict[str, object]]:
    """Rows for the channels and markers that a study requires and the recording lacks."""
    demand = declaration("recording").study
    result: list[dict[str, object]] = []
    for kind, names in (demand.names if demand else {}).items():
        present = [str(row["name"]) for row in rows if row["kind"] == kind]
        spare = [name for name in present if name not in names]
        for name in names:
            if name in present:
                continue
            near = nearest(name, spare, cutoff=0.75)
            advice = f"it may be {near!r}" if near else "map a label of the file to it"
            row = _nothing(name, kind, "V" if kind == "channel" else "m")
            row["signal"] = "EMG" if kind == "channel" else "position"
            finding = Finding(
                "missing", "marker" if kind == "marker" else "channel", name, {"advice": advice}
            )
            result.append(judged(row, [finding]))
    return result
