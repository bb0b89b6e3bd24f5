"""EMG and markers on one clock, by the offset between their clocks; intervals of a recording."""

import numpy as np
import xarray as xr

from emgface.errors import SignalError
from emgface.recordings.findings import shifted, within
from emgface.signals.filters import sampling_rate


def synchronise(recording: xr.Dataset, offset: float) -> xr.Dataset:
    """Convert the times of the markers to the clock of the EMG, t_emg = offset + t_marker.

    The attribute ``clock_relation`` of ``time_marker`` records the offset [s]. Raises SignalError
    if EMG or markers are absent, or do not overlap.
    """
    if "emg" not in recording or "position" not in recording:
        raise SignalError("the recording lacks EMG or markers, expected both for synchronisation")
    if not np.isfinite(offset):
        raise SignalError(
            f"the offset of the clocks is {offset} s, expected a finite number: specify the time of "
            "the EMG at which the markers begin, minus their own"
        )
    time = recording["time_marker"]
    moved = offset + time.values
    emg = recording["time_emg"].values
    if moved[-1] < emg[0] or moved[0] > emg[-1]:
        raise SignalError(
            f"with an offset of {offset:.4g} s the markers extend from {moved[0]:.4g} to "
            f"{moved[-1]:.4g} s and the EMG from {emg[0]:.4g} to {emg[-1]:.4g} s, expected an "
            "overlap: check the sign of the offset, t_emg = offset + t_marker"
        )
    recording = shifted(recording, offset, kinds=("marker",))
    attrs = {**time.attrs, "clock_relation": f"t_emg = {offset:.9g} s + t_marker"}
    return recording.assign_coords(time_marker=("time_marker", moved, attrs))


def cut(recording: xr.Dataset, start: float, stop: float) -> xr.Dataset:
    """Cut the interval from `start` to `stop` [s] out of a recording with one clock.

    Samples at both ends are included, up to half a sample. Time is 0 at the first EMG sample (or
    marker frame, without EMG). Raises SignalError if the interval contains fewer than two samples
    of a part.
    """
    zero: float | None = None
    recording = within(recording, start, stop)
    for name in ("time_emg", "time_marker", "time_true"):
        if name not in recording.coords:
            continue
        time = recording[name].values
        room = 0.5 / sampling_rate(time)
        inside = np.flatnonzero((time >= start - room) & (time < stop + room))
        if inside.size < 2:
            raise SignalError(
                f"the span {start:.4g} to {stop:.4g} s contains {inside.size} samples of "
                f"{name}, which extends from {time[0]:.4g} to {time[-1]:.4g} s, expected at "
                "least two"
            )
        recording = recording.isel({name: slice(int(inside[0]), int(inside[-1]) + 1)})
        kept = recording[name]
        zero = float(kept.values[0]) if zero is None else zero
        moved = (name, kept.values - zero, kept.attrs)
        recording = recording.assign_coords({name: moved})
    return shifted(recording, -(zero or 0.0))
