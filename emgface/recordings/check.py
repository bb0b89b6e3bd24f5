"""What a person should know of a recording before it is used: one row per channel and marker."""

from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from emgface.errors import SignalError
from emgface.recordings.labels import constant_value
from emgface.recordings.quality.findings import findings
from emgface.schema.rules import nearest
from emgface.schema.validation import declaration
from emgface.signals.filters import pass_band
from emgface.signals.parameters import FilterParameters, HeadFrameParameters

LARGEST_VARIATION = 10e-3
"""Standard deviation [V] above which surface EMG is suspect: amplified, or in another unit."""
SMALLEST_VARIATION = 0.1e-6
"""Standard deviation [V] below which surface EMG is suspect: less than electrode noise."""
CLIPPED = 0.01
"""Share of samples at one extreme value above which a channel counts as clipped."""
LEAST_RATE = 800.0
"""Sampling rate [Hz] below which surface EMG, to 400-500 Hz (van Boxtel 2001), is lost or folded."""
JITTER = 0.1
"""Part of the sampling interval by which intervals may differ before the clock is suspect."""

Verdict = Literal["ok", "warning", "error"]


class _Finding(NamedTuple):
    verdict: Verdict
    reason: str


def check_recording(
    recording: xr.Dataset,
    *,
    study: bool = False,
    max_gap: float | None = None,
    quality: bool = True,
) -> pd.DataFrame:
    """Examine every channel and marker of a recording.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording as `emgface.recordings.dataset.read_recording` returns it.
    study : bool
        Also list the channels and markers that a study needs and the recording lacks.
    max_gap : float, optional
        Longest gap [s] of a marker that is interpolated later; the default of
        `emgface.signals.parameters.HeadFrameParameters`.
    quality : bool
        Also measure hum, artefacts, drift, saturation, baseline, cross-talk, noise of markers,
        and exchanged names, see `emgface.recordings.quality`.

    Returns
    -------
    pandas.DataFrame
        Columns ``name``, ``kind`` (channel or marker), ``rate`` [Hz], ``duration`` [s] (samples
        over rate), ``unit``, ``finite`` (share of samples), ``longest_gap`` [s], ``constant``,
        ``rms`` (about zero for a channel, about its mean for a marker), ``smallest``,
        ``largest``, the measures of `emgface.recordings.quality` (NaN where they do not apply),
        ``verdict`` (ok, warning, error) and ``reason``.

    Notes
    -----
    Errors are what the study cannot use: a gap in EMG, which no filter bridges; a constant
    channel, whose normalisation is 0/0; a marker never seen, or lost for longer than `max_gap`
    between frames that show it; a clock that is not uniform. Warnings are what a person should
    look at.
    """
    limit = HeadFrameParameters().max_gap if max_gap is None else max_gap
    rows: list[dict[str, object]] = []
    if "emg" in recording:
        emg = recording["emg"]
        clock = _clock(emg["time_emg"].values)
        for label, values in zip(emg["channel"].values, emg.values, strict=True):
            row = _row(str(label), "channel", "V", values[None], clock)
            rows.append(_judged(row, _channel(values, row, clock)))
    if "position" in recording:
        position = recording["position"]
        clock = _clock(position["time_marker"].values)
        for label, values in zip(position["marker"].values, position.values, strict=True):
            row = _row(str(label), "marker", "m", values, clock)
            rows.append(_judged(row, _marker(values, row, clock, limit)))
    if quality:
        rows = _with_quality(rows, recording)
    if study:
        rows += _absent(rows)
    columns = list(dict.fromkeys(key for row in rows for key in row))
    last = ["verdict", "reason"]
    columns = [name for name in columns if name not in last] or ["name", "kind"]
    return pd.DataFrame(rows, columns=columns + last)


def problems(table: pd.DataFrame, verdict: Verdict = "error") -> list[str]:
    """Return one sentence for each channel or marker with a verdict.

    Parameters
    ----------
    table : pandas.DataFrame
        Result of `check_recording`.
    verdict : str
        ``error`` for what makes the recording unusable, ``warning`` for what to look at.

    Returns
    -------
    list of str
        Sentences; a command should fail where there is any of verdict ``error``.
    """
    columns = (table[name] for name in ("kind", "name", "verdict", "reason"))
    return [
        f"{kind} {name}: {reason}."
        for kind, name, found, reason in zip(*columns, strict=True)
        if found == verdict
    ]


def _with_quality(rows: list[dict[str, object]], recording: xr.Dataset) -> list[dict[str, object]]:
    """Add measures to the rows, and what stands out to their reasons."""
    measures, found = findings(recording)
    result: list[dict[str, object]] = []
    for row in rows:
        key = (str(row["kind"]), str(row["name"]))
        told = [text for kind, name, text in found if (kind, name) == key]
        if key[0] == "marker" and row is next(r for r in rows if r["kind"] == "marker"):
            told += [text for kind, name, text in found if (kind, name) == ("marker", "")]
        verdict, reason = str(row["verdict"]), str(row["reason"])
        if told:
            verdict = "warning" if verdict == "ok" else verdict
            reason = "; ".join([*([reason] if reason else []), *told])
        result.append({**row, **measures.get(key, {}), "verdict": verdict, "reason": reason})
    return result


class _Clock(NamedTuple):
    rate: float
    uniform: bool
    samples: int


def _clock(time: np.ndarray) -> _Clock:
    """Rate of a clock [Hz], and whether its intervals are equal."""
    if time.size < 2:
        return _Clock(float("nan"), False, time.size)
    interval = np.diff(time)
    mean = float(interval.mean())
    uniform = bool(np.abs(interval - mean).max() <= JITTER * mean)
    return _Clock(1.0 / mean, uniform, time.size)


def _row(name: str, kind: str, unit: str, values: np.ndarray, clock: _Clock) -> dict[str, object]:
    """Measures of one signal, shape (components, samples)."""
    seen: np.ndarray = np.all(np.isfinite(values), axis=0)
    found = values[:, seen]
    still = all(constant_value(component) is not None for component in values)
    nothing = not seen.any()
    about = found.mean(axis=1, keepdims=True) if kind == "marker" and not nothing else 0.0
    return {
        "name": name,
        "kind": kind,
        "rate": clock.rate,
        "duration": clock.samples / clock.rate,
        "unit": unit,
        "finite": float(seen.mean()) if seen.size else 0.0,
        "longest_gap": _longest_run(~seen) / clock.rate,
        "constant": still,
        "rms": np.nan if nothing else float(np.sqrt(((found - about) ** 2).sum(axis=0).mean())),
        "smallest": np.nan if nothing else float(found.min()),
        "largest": np.nan if nothing else float(found.max()),
    }


def _longest_run(mask: np.ndarray) -> int:
    """Length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max()) if edges.size else 0


def _common(row: dict[str, object], clock: _Clock) -> list[_Finding]:
    """Find what makes any signal unusable."""
    if clock.samples < 2:
        return [_Finding("error", f"has {clock.samples} samples, expected at least two")]
    if row["finite"] == 0.0:
        return [_Finding("error", "was never seen: every sample is NaN")]
    if not clock.uniform:
        return [_Finding("error", f"intervals differ by over {JITTER:.0%}: resample the recording")]
    return []


def _channel(values: np.ndarray, row: dict[str, object], clock: _Clock) -> list[_Finding]:
    found = _common(row, clock)
    if found:
        return found
    if np.isnan(values).any():
        found.append(
            _Finding(
                "error",
                f"{int(np.isnan(values).sum())} of {values.size} samples are NaN, the longest gap "
                f"{row['longest_gap']:.4g} s: cut the trial or leave the channel out",
            )
        )
    if row["constant"]:
        found.append(
            _Finding("error", f"constant at {row['largest']:g} V: see electrode and cable")
        )
        return found
    found += _band(clock.rate)
    variation = float(np.nanstd(values))  # an offset is no fault, the band-pass removes it
    if variation > LARGEST_VARIATION:
        found.append(
            _Finding("warning", f"varies by {variation:.3g} V, far above EMG: see gain and unit")
        )
    elif variation < SMALLEST_VARIATION:
        found.append(
            _Finding("warning", f"varies by {variation:.3g} V only: see electrode, gain and unit")
        )
    share = max(float((values == edge).mean()) for edge in (np.nanmin(values), np.nanmax(values)))
    if share > CLIPPED:
        found.append(_Finding("warning", f"{share:.1%} of samples at one extreme: clipped"))
    return found


def _band(rate: float) -> list[_Finding]:
    """Compare the sampling rate with the band of surface EMG and with the study's pass-band."""
    wanted = FilterParameters()
    try:
        _, high = pass_band(wanted, rate)
    except SignalError as error:
        return [_Finding("error", str(error))]
    if rate < LEAST_RATE:
        return [
            _Finding(
                "warning",
                f"sampled at {rate:.4g} Hz, which holds nothing above {rate / 2:.4g} Hz "
                "of the 15 to 500 Hz of EMG: record faster",
            )
        ]
    if high < wanted.high:
        told = (
            f"sampled at {rate:.4g} Hz: the pass-band ends at {high:.4g} Hz, not {wanted.high:g} Hz"
        )
        return [_Finding("warning", told)]
    return []


def _marker(
    values: np.ndarray, row: dict[str, object], clock: _Clock, limit: float
) -> list[_Finding]:
    found = _common(row, clock)
    if found:
        return found
    seen: np.ndarray = np.all(np.isfinite(values), axis=0)
    first, last = int(np.argmax(seen)), seen.size - int(np.argmax(seen[::-1]))
    gap, ends = _longest_run(~seen[first:last]) / clock.rate, (first + seen.size - last)
    # Half a frame of room, so that a gap of exactly the limit is not judged by its rounding.
    if gap > limit + 0.5 / clock.rate:
        found.append(
            _Finding("error", f"lost for {gap:.4g} s, longer than the {limit:g} s bridged")
        )
    elif gap > 0:
        found.append(_Finding("warning", f"lost for up to {gap:.4g} s, to be interpolated"))
    if ends:
        found.append(
            _Finding(
                "warning",
                f"not seen for {ends / clock.rate:.4g} s at the ends: the trial is scored on the "
                "rest",
            )
        )
    if row["constant"]:
        found.append(_Finding("error", "never moves at all: see whether it is a copied frame"))
    return found


def _judged(row: dict[str, object], findings: list[_Finding]) -> dict[str, object]:
    """Complete a row with the worst verdict and all reasons."""
    order: tuple[Verdict, ...] = ("error", "warning")
    found = {finding.verdict for finding in findings}
    verdict = next((one for one in order if one in found), "ok")
    # The reasons of the verdict come first.
    ranked = sorted(findings, key=lambda finding: finding.verdict != verdict)
    return {**row, "verdict": verdict, "reason": "; ".join(f.reason for f in ranked)}


def _absent(rows: list[dict[str, object]]) -> list[dict[str, object]]:
    """Rows for the channels and markers that a study needs and the recording lacks."""
    demand = declaration("recording").study
    result: list[dict[str, object]] = []
    for kind, names in (demand.names if demand else {}).items():
        held = [str(row["name"]) for row in rows if row["kind"] == kind]
        spare = [name for name in held if name not in names]
        for name in names:
            if name in held:
                continue
            near = nearest(name, spare, cutoff=0.75)
            advice = f"it looks like {near!r}" if near else "map a label of the file to it"
            empty = dict.fromkeys(
                ("rate", "duration", "finite", "longest_gap", "rms", "smallest", "largest"), np.nan
            )
            unit = "V" if kind == "channel" else "m"
            row = {"name": name, "kind": kind, **empty, "unit": unit, "constant": False}
            finding = _Finding("error", f"missing from the recording: {advice}")
            result.append(_judged(row, [finding]))
    return result
