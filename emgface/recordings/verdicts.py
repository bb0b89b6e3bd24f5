"""Faults of one channel or marker, as findings, and the verdict that follows from them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from emgface.errors import SignalError
from emgface.recordings.finding_codes import Verdict
from emgface.recordings.findings import Finding, Kind
from emgface.recordings.labels import constant_value
from emgface.signals.filters import LARGEST_VARIATION, pass_band
from emgface.signals.parameters import FilterParameters

SMALLEST_VARIATION = 0.1e-6
"""Standard deviation [V] below which surface EMG is suspect: less than electrode noise."""
CLIPPED = 0.01
"""Share of samples at one extreme value above which a channel is regarded as clipped."""
LEAST_EMG_RATE = 800.0
"""Sampling rate [Hz] below which surface EMG, to 400-500 Hz (van Boxtel 2001), is lost or folded."""
MOST_EMG_RATE = 100e3
"""Sampling rate [Hz] that no amplifier of EMG has: the rate or the unit of the times is wrong."""
JITTER = 0.1
"""Part of the sampling interval by which intervals may differ before the clock is suspect."""


class Clock(NamedTuple):
    """Rate [Hz], uniformity of the intervals, and number of instants."""

    rate: float
    uniform: bool
    samples: int


def clock_of(time: np.ndarray) -> Clock:
    """Rate of a clock [Hz], and uniformity of its intervals."""
    if time.size < 2:
        return Clock(float("nan"), False, time.size)
    interval = np.diff(time)
    mean = float(interval.mean())
    uniform = bool(np.abs(interval - mean).max() <= JITTER * mean)
    return Clock(1.0 / mean, uniform, time.size)


def row_of(name: str, kind: str, unit: str, values: np.ndarray, clock: Clock) -> dict[str, object]:
    """Measures of one signal, shape (components, samples)."""
    seen: np.ndarray = np.all(np.isfinite(values), axis=0)
    visible = values[:, seen]
    still = all(constant_value(component) is not None for component in values)
    nothing = not seen.any()
    about = visible.mean(axis=1, keepdims=True) if kind == "marker" and not nothing else 0.0
    return {
        "name": name,
        "kind": kind,
        "rate": clock.rate,
        "duration": clock.samples / clock.rate,
        "unit": unit,
        "finite": float(seen.mean()) if seen.size else 0.0,
        "longest_gap": _longest_run(~seen) / clock.rate,
        "constant": still,
        "rms": np.nan if nothing else float(np.sqrt(((visible - about) ** 2).sum(axis=0).mean())),
        "smallest": np.nan if nothing else float(visible.min()),
        "largest": np.nan if nothing else float(visible.max()),
    }


def _longest_run(mask: np.ndarray) -> int:
    """Length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max()) if edges.size else 0


def _common(row: dict[str, object], clock: Clock, kind: Kind) -> list[Finding]:
    """Find the properties that make a signal unusable."""
    name = str(row["name"])
    if clock.samples < 2:
        return [Finding("too_few", kind, name, {"samples": clock.samples})]
    if row["finite"] == 0.0:
        return [Finding("invisible", kind, name)]
    if not clock.uniform:
        return [Finding("uneven", kind, name, {"allowed": JITTER})]
    return []


def channel_findings(values: np.ndarray, row: dict[str, object], clock: Clock) -> list[Finding]:
    """Find faults of a channel, shape (samples,) [V], whose row is that of `row_of`."""
    findings = _common(row, clock, "channel")
    if findings:
        return findings

    def note(code: str, **numbers: float) -> None:
        findings.append(Finding(code, "channel", str(row["name"]), numbers))

    missing = int(np.isnan(values).sum())
    if missing:
        longest = float(str(row["longest_gap"]))
        note("absent_samples", missing=missing, samples=values.size, seconds=longest)
    if row["constant"]:
        note("constant", volts=float(str(row["largest"])))
        return findings
    findings += _band(str(row["name"]), clock.rate)
    variation = float(np.nanstd(values))  # an offset is removed by the band-pass
    if variation > LARGEST_VARIATION:
        note("large", volts=variation)
    elif variation < SMALLEST_VARIATION:
        note("small", volts=variation)
    share = max(float((values == edge).mean()) for edge in (np.nanmin(values), np.nanmax(values)))
    if share > CLIPPED:
        note("clipped", share=share)
    return findings


def _band(name: str, rate: float) -> list[Finding]:
    """Compare the sampling rate with the band of surface EMG and with the study's pass-band."""
    wanted = FilterParameters()
    try:
        _, high = pass_band(wanted, rate)
    except SignalError:
        band = {"low": wanted.low, "high": wanted.high}
        return [Finding("no_band", "channel", name, {"rate": rate, "half": rate / 2, **band})]
    if rate > MOST_EMG_RATE:
        return [Finding("fast", "channel", name, {"rate": rate})]
    if rate < LEAST_EMG_RATE:
        return [Finding("slow", "channel", name, {"rate": rate, "half": rate / 2})]
    if high < wanted.high:
        numbers = {"rate": rate, "high": high, "wanted": wanted.high}
        return [Finding("narrow", "channel", name, numbers)]
    return []


def marker_findings(
    values: np.ndarray, row: dict[str, object], clock: Clock, limit: float
) -> list[Finding]:
    """Find faults of a marker (axes, frames) [m]; gaps up to `limit` [s] are interpolated."""
    findings = _common(row, clock, "marker")
    if findings:
        return findings
    name = str(row["name"])
    seen: np.ndarray = np.all(np.isfinite(values), axis=0)
    first, last = int(np.argmax(seen)), seen.size - int(np.argmax(seen[::-1]))
    gap, ends = _longest_run(~seen[first:last]) / clock.rate, (first + seen.size - last)
    # Half a frame of tolerance accepts a gap of exactly the limit in spite of rounding.
    if gap > limit + 0.5 / clock.rate:
        findings.append(Finding("lost", "marker", name, {"seconds": gap, "limit": limit}))
    elif gap > 0:
        findings.append(Finding("lost_briefly", "marker", name, {"seconds": gap}))
    if ends:
        findings.append(Finding("ends", "marker", name, {"seconds": ends / clock.rate}))
    if row["constant"]:
        findings.append(Finding("still", "marker", name))
    return findings


def judged(row: dict[str, object], findings: Sequence[Finding]) -> dict[str, object]:
    """Complete a row with the worst verdict and all reasons."""
    order: tuple[Verdict, ...] = ("error", "warning")
    verdicts = {finding.verdict for finding in findings}
    verdict = next((one for one in order if one in verdicts), "ok")
    # Reasons for the verdict are listed first.
    ranked = sorted(findings, key=lambda finding: finding.verdict != verdict)
    return {**row, "verdict": verdict, "reason": "; ".join(f.clause for f in ranked)}
