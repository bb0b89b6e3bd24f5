"""Table of the channels and markers of a recording, with a verdict on each."""

import re

import numpy as np
import pandas as pd
import xarray as xr

from emgface.muscles import CHANNELS
from emgface.recordings.findings import findings_in
from emgface.recordings.kinds import Signal, kind_of_name, kind_of_unit, signal_of
from emgface.recordings.labels import note
from emgface.recordings.quality.findings import findings
from emgface.recordings.verdicts import (
    Finding,
    Verdict,
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
    rows: list[dict[str, object]] = []
    if "emg" in recording:
        emg = recording["emg"]
        clock = clock_of(emg["time_emg"].values)
        for label, values in zip(emg["channel"].values, emg.values, strict=True):
            row = row_of(str(label), "channel", "V", values[None], clock)
            signal = signal_of(str(label), values, clock.rate)
            if signal.kind != "EMG" and str(label) not in CHANNELS:
                rows.append(_other(row, signal))
                continue
            rows.append(judged(row | {"signal": "EMG"}, channel_findings(values, row, clock)))
    rows += _left_out(recording)
    if "position" in recording:
        position = recording["position"]
        clock = clock_of(position["time_marker"].values)
        for label, values in zip(position["marker"].values, position.values, strict=True):
            row = row_of(str(label), "marker", "m", values, clock)
            row["signal"] = "position"
            rows.append(judged(row, marker_findings(values, row, clock, limit)))
    rows = _with_quality(rows, recording)
    if study:
        rows += _absent(rows)
    columns = list(dict.fromkeys(key for row in rows for key in row))
    last = ["verdict", "reason"]
    columns = [name for name in columns if name not in last] or ["name", "kind", "signal"]
    return pd.DataFrame(rows, columns=columns + last)


def problems(table: pd.DataFrame, verdict: Verdict = "error") -> list[str]:
    """Return one sentence for each channel or marker with a verdict ("error" or "warning")."""
    columns = (table[name] for name in ("kind", "name", "verdict", "reason"))
    return [
        f"{kind} {name}: {reason}."
        for kind, name, found, reason in zip(*columns, strict=True)
        if found == verdict
    ]


def _with_quality(rows: list[dict[str, object]], recording: xr.Dataset) -> list[dict[str, object]]:
    """Add measures to the rows, and findings to their reasons."""
    emg = [row["name"] for row in rows if row["signal"] == "EMG"]
    if "emg" in recording:
        recording = recording.sel(channel=emg) if emg else recording.drop_vars("emg")
    stored = findings_in(recording)
    measures, found = findings(recording)
    result: list[dict[str, object]] = []
    # A finding on the whole recording is stated with its first channel or marker.
    judgeable = [row for row in rows if row["signal"] in ("EMG", "position")]
    for row in rows:
        key = (str(row["kind"]), str(row["name"]))
        told = [finding.clause for finding in stored if (finding.kind, finding.name) == key]
        told += [text for kind, name, text in found if (kind, name) == key]
        if row is next((r for r in judgeable if r["kind"] == key[0]), None):
            told = [
                f.clause for f in stored if f.kind in (key[0], "recording") and not f.name
            ] + told
            told += [text for kind, name, text in found if (kind, name) == (key[0], "")]
        verdict, reason = str(row["verdict"]), str(row["reason"])
        if told:
            verdict = "warning" if verdict == "ok" else verdict
            reason = "; ".join([*([reason] if reason else []), *told])
        result.append({**row, **measures.get(key, {}), "verdict": verdict, "reason": reason})
    return result


def _other(row: dict[str, object], signal: Signal) -> dict[str, object]:
    """Row of a channel that does not contain EMG."""
    return {**row, "signal": signal.kind, "verdict": "not EMG", "reason": signal.reason}


def _left_out(recording: xr.Dataset) -> list[dict[str, object]]:
    """Rows for analog channels that the reader omitted because they are not voltages."""
    rows: list[dict[str, object]] = []
    for label, reason in note(recording, "dropped").items():
        found = re.fullmatch(
            r"(in '(.*)', not a voltage|of type (.*), not EMG|has no unit)", reason
        )
        if found is None:
            continue
        unit, kind = found.group(2) or "", found.group(3)
        kind = kind or kind_of_unit(unit) or kind_of_name(label) or "other signal"
        told = f"left out in reading: {reason}"
        rows.append(_other(_nothing(label, "channel", unit), Signal(kind, told)))
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
        held = [str(row["name"]) for row in rows if row["kind"] == kind]
        spare = [name for name in held if name not in names]
        for name in names:
            if name in held:
                continue
            near = nearest(name, spare, cutoff=0.75)
            advice = f"it may be {near!r}" if near else "map a label of the file to it"
            row = _nothing(name, kind, "V" if kind == "channel" else "m")
            row["signal"] = "EMG" if kind == "channel" else "position"
            finding = Finding("error", f"missing from the recording: {advice}")
            result.append(judged(row, [finding]))
    return result
