"""Start and end of trials and repetitions, from events or from the activity."""

import warnings
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr
from scipy.ndimage import uniform_filter1d

from emgface.errors import DataError, SignalError, listed
from emgface.recordings.bids.sidecars import read_tsv
from emgface.recordings.synchronise import cut
from emgface.signals.filters import sampling_rate

EVENT_COLUMNS = ("onset", "duration", "label")
UNDOUBTED_OVERLAP: Final = 0.1
"""Part of a trial that the next one may share without a warning [1], such as rest between them."""


def read_events(path: str | Path) -> pd.DataFrame:
    """Read the events ``*_events.tsv`` of a BIDS dataset.

    The columns are ``onset``, ``duration`` [s] and ``label`` (``trial_type`` or ``value``). Raises
    DataError if a column is absent or an onset is not a number.
    """
    path = Path(path)
    table = read_tsv(path)
    for name in ("onset", "duration"):
        if name not in table.columns:
            raise DataError(
                f"{path.name} has the columns {', '.join(map(str, table.columns))}; expected onset "
                "and duration, in seconds: repair it."
            )
    numbers = table[["onset", "duration"]].replace("n/a", "nan")
    try:
        result = numbers.astype("float64")
    except ValueError as error:
        raise DataError(f"{path.name}: {error}; expected seconds or n/a: repair it.") from error
    if result["onset"].isna().any():
        raise DataError(f"{path.name} has an event without onset; expected seconds: repair it.")
    label = next((name for name in ("trial_type", "value") if name in table.columns), None)
    result["label"] = table[label].replace("n/a", "") if label else ""
    return result


def cut_trials(
    recording: xr.Dataset,
    events: pd.DataFrame,
    *,
    before: float = 0.0,
    after: float = 0.0,
) -> Iterator[xr.Dataset]:
    """Cut a long recording into trials, one per event.

    `events` has the columns ``onset`` and ``duration`` [s], and ``label``, the instruction unless
    it is empty (`read_events`, `find_repetitions`); the trial begins `before` the onset and ends
    `after` the end [s]. Yields trials in the order of their onsets, with time 0 at their start;
    ``repetition`` counts the events of the same instruction, ``cut_from`` is the interval in the long
    recording [s]. Raises SignalError for a duration below zero. Events whose
    interval extends beyond the recording are omitted; a SignalError lists them after the last trial.
    """
    counts: dict[str, int] = {}
    outside, spans = list[str](), list[tuple[float, float]]()
    events = events.sort_values("onset", kind="stable")
    negative = events[events["duration"] < 0]
    if len(negative):  # before the first trial is written
        onset, duration = negative.iloc[0][["onset", "duration"]]
        raise SignalError(
            f"the event at {onset:.4g} s has the duration {duration:.4g} s, expected 0 s or more: "
            "repair the events"
        )
    for onset, duration, label in zip(*(events[c] for c in EVENT_COLUMNS), strict=True):
        label = "" if pd.isna(label) else label
        start, stop = float(onset) - before, float(onset) + float(duration) + after
        instruction = str(label) or str(recording.attrs.get("instruction", ""))
        counts[instruction] = counts.get(instruction, 0) + 1
        if beyond := _beyond(recording, start, stop):
            shown = f" {label!r}" if label else ""
            outside.append(
                f"the event{shown} at {onset:.4g} s needs {start:.4g} to {stop:.4g} s and {beyond}"
            )
            continue
        spans.append((start, stop))
        named = {"instruction": instruction} if instruction else {}
        yield cut(recording, start, stop).assign_attrs(
            **named, repetition=counts[instruction], cut_from=[start, stop]
        )
    if shared := _shared(spans):
        warnings.warn(
            f"successive trials share the samples from {listed(shared)}, which count twice in a study: "
            "check onsets and durations, or shorten before and after",
            stacklevel=2,
        )
    if outside:
        raise SignalError(
            f"{'; '.join(outside)}: expected every interval inside; shorten before and after, or omit "
            "the event"
        )


def _shared(spans: list[tuple[float, float]]) -> list[str]:
    """Parts in which successive intervals overlap by more than `UNDOUBTED_OVERLAP` of the shorter."""
    ordered = sorted(spans)
    return [
        f"{start:.4g} to {min(end, stop):.4g} s"
        for (begin, end), (start, stop) in pairwise(ordered)
        if min(end, stop) - start > UNDOUBTED_OVERLAP * min(end - begin, stop - start)
    ]


def _beyond(recording: xr.Dataset, start: float, stop: float) -> str:
    """Name and limits of a clock that does not contain the interval [s], or an empty text."""
    for name in ("time_emg", "time_marker"):
        if name not in recording.coords:
            continue
        time = recording[name].values
        room = 1.0 / sampling_rate(time)
        if not (start >= time[0] - room and stop <= time[-1] + room):
            return f"{name} lasts from {time[0]:.4g} to {time[-1]:.4g} s"
    return ""


REPETITION_LEVEL: Final = 0.2
"""Part of the range of activity that a repetition exceeds [1]."""
ACTIVITY_WINDOW: Final = 0.2
"""Duration over which activity is averaged [s]."""


def find_repetitions(
    signal: xr.DataArray,
    *,
    least_duration: float = 0.3,
    least_rest: float = 0.5,
) -> pd.DataFrame:
    """Find the bursts of activity that are repetitions of a movement.

    Activity is the root mean square over the rows, in a moving window (`ACTIVITY_WINDOW`), of the
    band-passed EMG or of the speed of markers (positions [m] in the head frame without gaps). A
    repetition lasts while it exceeds rest + LEVEL (peak - rest), with rest and peak the 10th and
    99th percentiles; pauses shorter than `least_rest` [s] are included, bursts shorter than
    `least_duration` [s] are omitted. The result has the columns ``onset``, ``duration`` [s] and
    ``label`` (empty). Raises SignalError if the signal has gaps, is constant, or contains no burst.
    """
    name = str(next(d for d in signal.dims if str(d).startswith("time")))
    time = signal[name].values
    rate = sampling_rate(time)
    values = signal.transpose(..., name).values.reshape(-1, time.size).astype(float)
    if not np.isfinite(values).all():
        raise SignalError("the signal has gaps, expected none: interpolate them or cut them out")
    if name == "time_marker":
        values = np.asarray(np.gradient(values, axis=1)) * rate
    scale = np.sqrt(np.mean(values**2, axis=1, keepdims=True))
    values, scale = values[scale[:, 0] > 0], scale[scale[:, 0] > 0]
    if name != "time_marker":
        # Each channel is scaled by its own amplitude, so that no channel dominates.
        values = values / scale
    if values.size == 0:
        raise SignalError("the signal never changes, expected bursts of activity")
    size = max(1, round(ACTIVITY_WINDOW * rate))
    activity = np.sqrt(uniform_filter1d(np.mean(values**2, axis=0), size, mode="nearest"))
    rest, peak = np.percentile(activity, [10, 99])
    if peak < 1.5 * rest:
        raise SignalError(
            f"activity lies between {rest:.3g} and {peak:.3g} of its root mean square, expected "
            "rest between bursts: cut the trials by events instead"
        )
    on = activity > rest + REPETITION_LEVEL * (peak - rest)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], on, [False])).astype(np.int8)))
    starts, stops = edges[::2], edges[1::2]
    kept: list[list[int]] = []
    for start, stop in zip(starts, stops, strict=True):
        if kept and start - kept[-1][1] < least_rest * rate:
            kept[-1][1] = int(stop)
        else:
            kept.append([int(start), int(stop)])
    spans = [(a, b) for a, b in kept if b - a >= least_duration * rate]
    if not spans:
        raise SignalError(
            f"no burst lasts {least_duration:g} s, expected repetitions: "
            "cut the trials by events instead"
        )
    return pd.DataFrame(
        {
            "onset": [float(time[a]) for a, _ in spans],
            "duration": [float((b - a) / rate) for a, b in spans],
            "label": "",
        }
    )
