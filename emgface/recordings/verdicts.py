"""Faults of one channel or marker, each with a verdict and a reason."""

from typing import Literal, NamedTuple

import numpy as np

from emgface.errors import SignalError
from emgface.recordings.labels import constant_value
from emgface.signals.filters import LARGEST_VARIATION, pass_band
from emgface.signals.parameters import FilterParameters

SMALLEST_VARIATION = 0.1e-6
"""Standard deviation [V] below which surface EMG is suspect: less than electrode noise."""
CLIPPED = 0.01
"""Share of samples at one extreme value above which a channel is regarded as clipped."""
LEAST_RATE = 800.0
"""Sampling rate [Hz] below which surface EMG, to 400-500 Hz (van Boxtel 2001), is lost or folded."""
JITTER = 0.1
"""Part of the sampling interval by which intervals may differ before the clock is suspect."""

Verdict = Literal["ok", "warning", "error", "not EMG"]


class Finding(NamedTuple):
    """One fault."""

    verdict: Verdict
    reason: str


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


def _common(row: dict[str, object], clock: Clock) -> list[Finding]:
    """Find the properties that make a signal unusable."""
    if clock.samples < 2:
        return [Finding("error", f"has {clock.samples} samples, expected at least two")]
    if row["finite"] == 0.0:
        return [Finding("error", "is never visible: every sample is NaN")]
    if not clock.uniform:
        return [Finding("error", f"intervals differ by over {JITTER:.0%}: resample the recording")]
    return []


def channel_findings(values: np.ndarray, row: dict[str, object], clock: Clock) -> list[Finding]:
    """Find faults of a channel, shape (samples,) [V], whose row is that of `row_of`."""
    found = _common(row, clock)
    if found:
        return found
    if np.isnan(values).any():
        found.append(
            Finding(
                "error",
                f"{int(np.isnan(values).sum())} of {values.size} samples are NaN, the longest gap "
                f"{row['longest_gap']:.4g} s: cut the trial or omit the channel",
            )
        )
    if row["constant"]:
        found.append(
            Finding("error", f"constant at {row['largest']:g} V: check electrode and cable")
        )
        return found
    found += _band(clock.rate)
    variation = float(np.nanstd(values))  # an offset is removed by the band-pass
    if variation > LARGEST_VARIATION:
        found.append(
            Finding("warning", f"varies by {variation:.3g} V, far above EMG: check gain and unit")
        )
    elif variation < SMALLEST_VARIATION:
        found.append(
            Finding("warning", f"varies by {variation:.3g} V only: check electrode, gain and unit")
        )
    share = max(float((values == edge).mean()) for edge in (np.nanmin(values), np.nanmax(values)))
    if share > CLIPPED:
        found.append(Finding("warning", f"{share:.1%} of samples at one extreme: clipped"))
    return found


def _band(rate: float) -> list[Finding]:
    """Compare the sampling rate with the band of surface EMG and with the study's pass-band."""
    wanted = FilterParameters()
    try:
        _, high = pass_band(wanted, rate)
    except SignalError as error:
        return [Finding("error", str(error))]
    if rate < LEAST_RATE:
        return [
            Finding(
                "warning",
                f"sampled at {rate:.4g} Hz, which contains nothing above {rate / 2:.4g} Hz "
                "of the 15 to 500 Hz of EMG: record faster",
            )
        ]
    if high < wanted.high:
        told = (
            f"sampled at {rate:.4g} Hz: the pass-band ends at {high:.4g} Hz, not {wanted.high:g} Hz"
        )
        return [Finding("warning", told)]
    return []


def marker_findings(
    values: np.ndarray, row: dict[str, object], clock: Clock, limit: float
) -> list[Finding]:
    """Find faults of a marker (axes, frames) [m]; gaps up to `limit` [s] are interpolated."""
    found = _common(row, clock)
    if found:
        return found
    seen: np.ndarray = np.all(np.isfinite(values), axis=0)
    first, last = int(np.argmax(seen)), seen.size - int(np.argmax(seen[::-1]))
    gap, ends = _longest_run(~seen[first:last]) / clock.rate, (first + seen.size - last)
    # Half a frame of tolerance accepts a gap of exactly the limit in spite of rounding.
    if gap > limit + 0.5 / clock.rate:
        found.append(
            Finding(
                "error", f"lost for {gap:.4g} s, longer than the {limit:g} s that are interpolated"
            )
        )
    elif gap > 0:
        found.append(Finding("warning", f"lost for up to {gap:.4g} s, to be interpolated"))
    if ends:
        found.append(
            Finding(
                "warning",
                f"not visible for {ends / clock.rate:.4g} s at the ends: the remaining part "
                "of the trial is scored",
            )
        )
    if row["constant"]:
        found.append(Finding("error", "does not move: check whether it is a copied frame"))
    return found


def judged(row: dict[str, object], findings: list[Finding]) -> dict[str, object]:
    """Complete a row with the worst verdict and all reasons."""
    order: tuple[Verdict, ...] = ("error", "warning")
    found = {finding.verdict for finding in findings}
    verdict = next((one for one in order if one in found), "ok")
    # Reasons for the verdict are listed first.
    ranked = sorted(findings, key=lambda finding: finding.verdict != verdict)
    return {**row, "verdict": verdict, "reason": "; ".join(f.reason for f in ranked)}
