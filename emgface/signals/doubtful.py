"""Doubts about a recording that signals themselves raise: narrow counts, weak activity, clocks apart.

A row has a narrow range of its count, or is hardly larger in activity than at rest.
Rest and activity are those of the recording itself: the mean square of the steps between samples is
computed in every window, and its quantiles `QUIET_QUANTILE` and `ACTIVE_QUANTILE` are those of rest
and of activity.
"""

from typing import Final

import numpy as np
import xarray as xr

from emgface.recordings.findings import Finding
from emgface.signals.filters import TIME_EMG, row_dim
from emgface.signals.running import running_sum

QUIET_QUANTILE: Final = 0.1  #: quantile of the windows that represents rest [1]
ACTIVE_QUANTILE: Final = 0.95  #: quantile of the windows that represents activity [1]
SMALL_COUNT_SHARE: Final = 0.15
"""Range of a count over its largest possible value below which it is called small [1].

Eq. 8 stretches the range to 0-1, so that a step more or less changes the activation by over 1.6 % at
409 steps per window (0.2 s at 2048 Hz).
"""
SERVES: Final = 2.0
"""Threshold over the root mean square of the steps at rest [1].

Steps of Gaussian noise exceed it in 4.6 % of the samples, and those of an activity twice as large in
32 %, so that the range of the count is about 0.27.
"""
ENDS: Final = ("from", "to")
COMMON: Final = 0.75  #: least part of sEMG and of markers that is expected in their common interval
#: ratio of activity to rest below which no threshold yields a range of `SMALL_COUNT_SHARE` [1]
WEAK: Final = 2.0


def quiet_and_active(values: np.ndarray, window: int) -> tuple[float, float]:
    """Root mean square of the windows of rest and of activity, of values (samples,)."""
    power = np.sqrt(running_sum(np.square(values), window) / window)
    quiet, active = np.quantile(power, [QUIET_QUANTILE, ACTIVE_QUANTILE])
    return float(quiet), float(active)


def rest_rms(signal: xr.DataArray, window: float, rate: float) -> xr.DataArray:
    """Root mean square [V] of each row at rest, in the quietest tenth of its windows.

    `signal` has the dims (row, time_emg) [V], `window` is in seconds and `rate` in Hz.
    """
    n, dim = round(window * rate), row_dim(signal)
    values = signal.transpose(dim, TIME_EMG).values
    rest = [quiet_and_active(row, min(n, len(row)))[0] for row in values]
    return xr.DataArray(rest, {dim: signal[dim]}, dims=dim, attrs={"units": "V"})


def doubtful_rows(feature: xr.DataArray, signal: xr.DataArray) -> list[Finding]:
    """Findings on rows of a feature (row, time) of a signal (row, time_emg) [V].

    ``weak_burst``: the steps in activity are less than `WEAK` times those at rest, so that the
    feature consists mainly of noise; ``narrow_count``: a Willison amplitude whose range is below
    `SMALL_COUNT_SHARE`, with the threshold that would serve, `SERVES` times the steps at rest.
    """
    dim = row_dim(feature, "time")
    kind = "muscle" if dim == "muscle" else "channel"
    window = int(feature.attrs.get("window_samples", 0))
    findings: list[Finding] = []
    values, counts = signal.transpose(dim, TIME_EMG).values, feature.transpose(dim, "time").values
    for name, row, count in zip(feature[dim].values, values, counts, strict=True):
        steps = np.diff(row)
        if window < 2 or not steps.any():
            continue  # constant channels are stated elsewhere
        rest, activity = quiet_and_active(steps, window - 1)
        ratio = activity / rest if rest > 0.0 else np.inf
        if ratio < WEAK:
            findings.append(Finding("weak_burst", kind, str(name), {"ratio": round(ratio, 2)}))
            continue
        if feature.attrs.get("feature") != "wamp":
            continue
        low, high = float(count.min()), float(count.max())
        if high - low < SMALL_COUNT_SHARE * (window - 1):
            serves = SERVES * rest if rest > 0.0 else 0.5 * activity
            said = {"low": low, "high": high, "most": window - 1.0, "serves": serves}
            findings.append(Finding("narrow_count", kind, str(name), said))
    return findings


def little_in_common(recording: xr.Dataset) -> list[Finding]:
    """Finding on a common interval of sEMG and markers below `COMMON` of either; none otherwise.

    The cause may be a wrong sampling rate, or clocks that were not synchronised.
    """
    clocks = {"emg": "time_emg", "marker": "time_marker"}
    if not all(recording.sizes.get(clock, 0) for clock in clocks.values()):
        return []
    spans = {k: (float(recording[c][0]), float(recording[c][-1])) for k, c in clocks.items()}
    common = min(t[1] for t in spans.values()) - max(t[0] for t in spans.values())
    if all(common >= COMMON * (t[1] - t[0]) for t in spans.values()):
        return []
    values = {
        f"{k}_{end}": t for k, span in spans.items() for end, t in zip(ENDS, span, strict=True)
    }
    if common <= 0.0:
        return [Finding("nothing_in_common", "marker", "", values)]
    return [Finding("little_in_common", "marker", "", {"common": common, **values})]
