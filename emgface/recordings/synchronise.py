"""EMG and markers of different clocks on one clock: by a trigger that both hear, or a stated offset.

The clocks are related by t_emg = offset + rate t_marker; the rate differs from one by the drift of
the two crystals, some ten parts in a million.
"""

from typing import NamedTuple

import numpy as np
import xarray as xr

from emgface.errors import SignalError
from emgface.signals.filters import sampling_rate

LARGEST_DRIFT = 1e-3
"""Difference of two clocks' rates beyond which triggers are taken to be mismatched."""


class ClockFit(NamedTuple):
    """Relation of two clocks, t_emg = offset + rate t_marker.

    Attributes
    ----------
    offset : float [s]
        Reading of the EMG clock where that of the markers is 0.
    rate : float [1]
        Seconds of the EMG clock in a second of the markers' clock.
    matched : int
        Triggers that were used.
    residual : float [s]
        Largest distance of a trigger from the relation.
    """

    offset: float
    rate: float
    matched: int
    residual: float


def rising_edges(
    signal: np.ndarray | xr.DataArray,
    time: np.ndarray | xr.DataArray,
    *,
    threshold: float | None = None,
    least_interval: float = 0.05,
) -> np.ndarray:
    """Return the instants at which a trigger signal rises.

    Parameters
    ----------
    signal : array, shape (samples,)
        Trigger, in any unit.
    time : array, shape (samples,) [s]
        Instants.
    threshold : float, optional
        Level that counts as high, in the unit of the signal; half way between the 5th and 95th
        percentiles, or where these agree between least and greatest value.
    least_interval : float [s]
        Edges closer to the one before are bounces and left out.

    Returns
    -------
    ndarray, shape (edges,) [s]
        Instants of crossing, interpolated between samples.

    Raises
    ------
    SignalError
        If the signal never rises.
    """
    values, t = np.asarray(signal, dtype=float), np.asarray(time, dtype=float)
    low, high = np.nanpercentile(values, [5, 95])
    if low == high:
        low, high = np.nanmin(values), np.nanmax(values)
    level = 0.5 * (low + high) if threshold is None else threshold
    at = np.flatnonzero((values[:-1] < level) & (values[1:] >= level))
    if at.size == 0:
        raise SignalError(
            f"the trigger lies between {np.nanmin(values):g} and {np.nanmax(values):g} and never "
            f"rises through {level:g}: see the channel and its threshold"
        )
    part = (level - values[at]) / (values[at + 1] - values[at])
    edges = t[at] + part * (t[at + 1] - t[at])
    kept = [edges[0]]
    for edge in edges[1:]:
        if edge - kept[-1] >= least_interval:
            kept.append(edge)
    return np.array(kept)


def fit_clocks(emg: np.ndarray, marker: np.ndarray, *, tolerance: float = 0.02) -> ClockFit:
    """Relate two clocks by triggers that both recorded, some of which may be missing.

    The offset under which most triggers agree within `tolerance` pairs them; least squares of the
    pairs give offset and, from three pairs on, rate.

    Parameters
    ----------
    emg, marker : array, shape (edges,) [s]
        Instants of the triggers by the two clocks.
    tolerance : float [s]
        Largest distance at which two triggers are the same; must exceed the drift over the trial.

    Returns
    -------
    ClockFit
        The relation.

    Raises
    ------
    SignalError
        If the triggers do not agree, or several offsets fit equally well.
    """
    emg, marker = np.sort(np.asarray(emg, float)), np.sort(np.asarray(marker, float))
    if emg.size == 0 or marker.size == 0:
        raise SignalError(
            f"found {emg.size} triggers of the EMG and {marker.size} of the markers, expected at "
            "least one of each"
        )
    tried: list[tuple[int, float, float]] = []
    for offset in np.unique((emg[:, None] - marker).ravel()):
        _, _, away = _pairs(emg, marker, offset, tolerance)
        tried.append((-away.size, float(np.abs(away).mean()), float(offset)))
    tried.sort()
    most, _, offset = tried[0]
    rivals = [one for one in tried if one[0] == most and abs(one[2] - offset) > 2 * tolerance]
    if rivals:
        raise SignalError(
            f"the triggers agree as well for an offset of {offset:.4g} s as for "
            f"{rivals[0][2]:.4g} s: use triggers at irregular intervals, or state the offset"
        )
    one, other, _ = _pairs(emg, marker, offset, tolerance)
    rate = 1.0
    if one.size >= 3:
        rate = float(np.polyfit(other - other.mean(), one - one.mean(), 1)[0])
        if abs(rate - 1.0) > LARGEST_DRIFT:
            raise SignalError(
                f"the clocks of the {one.size} triggers differ by {rate - 1:.2%}, expected at most "
                f"{LARGEST_DRIFT:.1%}: see whether the sampling rates are right"
            )
    offset = float(one.mean() - rate * other.mean())
    residual = float(np.abs(one - offset - rate * other).max())
    return ClockFit(offset, rate, int(one.size), residual)


def _pairs(
    emg: np.ndarray, marker: np.ndarray, offset: float, tolerance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triggers that are nearest to each other both ways and within the tolerance."""
    distance = emg[:, None] - (marker + offset)
    nearest, back = np.abs(distance).argmin(axis=1), np.abs(distance).argmin(axis=0)
    rows = np.arange(emg.size)
    away = distance[rows, nearest]
    good = (back[nearest] == rows) & (np.abs(away) <= tolerance)
    return emg[good], marker[nearest[good]], away[good]


def synchronise(
    recording: xr.Dataset,
    *,
    offset: float | None = None,
    rate: float = 1.0,
    clocks: ClockFit | None = None,
) -> xr.Dataset:
    """Put the markers of a recording on the clock of its EMG.

    Parameters
    ----------
    recording : Dataset
        Recording with EMG and markers, each with its own time.
    offset, rate : float
        Of the relation t_emg = offset + rate t_marker; the stated offset [s] of the set-up.
    clocks : ClockFit, optional
        Result of `fit_clocks`, instead of `offset` and `rate`.

    Returns
    -------
    Dataset
        The same samples with ``time_marker`` by the clock of the EMG; the attribute
        ``clock_relation`` of that coordinate records what was done.

    Raises
    ------
    SignalError
        If neither or both are given, a part is absent, or the parts do not overlap.
    """
    if (offset is None) == (clocks is None):
        raise SignalError("synchronising needs either an offset in seconds or a fit of the clocks")
    if "emg" not in recording or "position" not in recording:
        raise SignalError(
            "the recording lacks EMG or markers, expected both to be put on one clock"
        )
    shift = clocks.offset if clocks is not None else float(offset or 0.0)
    rate = clocks.rate if clocks is not None else rate
    time = recording["time_marker"]
    moved = shift + rate * time.values
    emg = recording["time_emg"].values
    if moved[-1] < emg[0] or moved[0] > emg[-1]:
        raise SignalError(
            f"with an offset of {shift:.4g} s the markers last from {moved[0]:.4g} to "
            f"{moved[-1]:.4g} s and the EMG from {emg[0]:.4g} to {emg[-1]:.4g} s, expected an "
            "overlap: see the sign of the offset, t_emg = offset + t_marker"
        )
    relation = f"t_emg = {shift:.9g} s + {rate:.9g} t_marker"
    if clocks is not None:
        relation += f", {clocks.matched} triggers, largest distance {clocks.residual:.3g} s"
    attrs = {**time.attrs, "clock_relation": relation}
    return recording.assign_coords(time_marker=("time_marker", moved, attrs))


def overlap(recording: xr.Dataset) -> xr.Dataset:
    """Cut a synchronised recording to the span that EMG and markers share.

    Parameters
    ----------
    recording : Dataset
        Recording with both parts on one clock.

    Returns
    -------
    Dataset
        The shared span, with time 0 at its first EMG sample.

    Raises
    ------
    SignalError
        If fewer than two samples of either are shared.
    """
    spans = [recording[name].values[[0, -1]] for name in ("time_emg", "time_marker")]
    start, stop = max(s[0] for s in spans), min(s[1] for s in spans)
    return cut(recording, start, stop)


def cut(recording: xr.Dataset, start: float, stop: float) -> xr.Dataset:
    """Take a span out of a recording.

    Parameters
    ----------
    recording : Dataset
        Recording, its parts on one clock.
    start, stop : float [s]
        Span; samples at both ends are included, up to half a sample.

    Returns
    -------
    Dataset
        The span, with time 0 at its first EMG sample (or marker frame, without EMG).

    Raises
    ------
    SignalError
        If the span holds fewer than two samples of a part.
    """
    zero: float | None = None
    for name in ("time_emg", "time_marker", "time_true"):
        if name not in recording.coords:
            continue
        time = recording[name].values
        room = 0.5 / sampling_rate(time)
        inside = np.flatnonzero((time >= start - room) & (time < stop + room))
        if inside.size < 2:
            raise SignalError(
                f"the span {start:.4g} to {stop:.4g} s holds {inside.size} samples of {name}, which "
                f"lasts from {time[0]:.4g} to {time[-1]:.4g} s, expected at least two"
            )
        recording = recording.isel({name: slice(int(inside[0]), int(inside[-1]) + 1)})
        kept = recording[name]
        zero = float(kept.values[0]) if zero is None else zero
        moved = (name, kept.values - zero, kept.attrs)
        recording = recording.assign_coords({name: moved})
    return recording
