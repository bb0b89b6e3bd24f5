"""Values that stand for samples that were not measured: zeros, held values, constants far away.

Programs fill lost samples with zeros, with the last value, or with a number such as 9999 or 1e38. Such
fillers become gaps (NaN) in every recording that is opened, with a finding for each channel and marker.
"""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
import xarray as xr

from emgface.recordings.findings import Finding, with_findings

LEAST_FILLER_SAMPLES: Final = 20  #: samples from which fillers can be recognised
#: probability of a run of equal samples by chance below which it is a held value
FILLER_CHANCE: Final = 1e-6
FINE_STEPS: Final = 3.0
"""Usual step over the resolution above which repeated values are not due to the resolution."""
FILLER_DISTANCE: Final = 5.0  #: distance of a constant from all other values, over their range
MOST_FILLER_CODES: Final = 3  #: most values that stand for samples that were not measured
LEAST_MEASURED: Final = 0.05  #: least part of the samples that is measured
FAR_MARKER: Final = 0.5  #: distance of a constant from all other positions [m]
#: distance of a marker from the origin next to zeros, in usual large steps
ORIGIN_JUMP: Final = 5.0
NOISE_SHARE: Final = 0.02
"""Third differences of a marker over its steps above which it has the noise of a measurement."""
LONGEST_EMG_INTERVAL: Final = 5e-3  #: sampling interval [s] above which a signal is no surface EMG
SHORTEST_HOLD: Final = 0.005  #: time at one value [s] below which EMG is not changed


class Filler(NamedTuple):
    """Samples of one signal that contain a filler, and the filler in words."""

    mask: np.ndarray
    what: str


def without_fillers(recording: xr.Dataset) -> xr.Dataset:
    """Replace the fillers of a recording by NaN, and store a finding for each filler.

    Signals that are constant throughout are not changed (`emgface.recordings.check` reports them),
    except markers at the origin while the others are not near it.
    """
    findings: list[Finding] = []
    if _usable(recording, "emg", ("channel", "time_emg")):
        emg = recording["emg"].transpose("channel", "time_emg")
        values = np.array(emg.values, dtype=float)
        time = recording["time_emg"].values
        period = _period(time)
        for row, name in zip(values, emg["channel"].values, strict=True):
            for filler in emg_fillers(row, period):
                findings.append(_finding("filler", "channel", str(name), filler, time, period))
                row[filler.mask] = np.nan
        if findings:
            recording = recording.assign(emg=emg.copy(data=values))
    known = len(findings)
    if _usable(recording, "position", ("marker", "axis", "time_marker")):
        position = recording["position"].transpose("marker", "axis", "time_marker")
        values = np.array(position.values, dtype=float)
        time = recording["time_marker"].values
        period = _period(time)
        elsewhere = _distance_of_markers(values)
        for row, name in zip(values, position["marker"].values, strict=True):
            # The first filler is removed before the next one is sought.
            for filler in marker_fillers(row, elsewhere):
                findings.append(
                    _finding("filler_of_marker", "marker", str(name), filler, time, period)
                )
                row[:, filler.mask] = np.nan
        if len(findings) > known:
            recording = recording.assign(position=position.copy(data=values))
    return with_findings(recording, findings) if findings else recording


def emg_fillers(values: np.ndarray, period: float) -> Iterator[Filler]:
    """Find the fillers of a channel (samples,) [V] sampled every `period` [s]."""
    yield from _infinite(values[None])
    if values.size < LEAST_FILLER_SAMPLES:
        return
    finite = np.isfinite(values)
    values = np.where(finite, values, np.nan)
    far = _far(values[None], FILLER_DISTANCE, 0.0)
    if far is not None:
        yield far
        finite &= ~far.mask
    if not finite.any() or np.ptp(values[finite]) == 0.0:
        return
    if not _rough(values, period):
        return  # a slow signal, which may rest at a value
    edges = values[finite].min(), values[finite].max()
    shortest = SHORTEST_HOLD / period if period > 0 else np.inf
    for start, stop in _runs(values[None], finite):
        value = values[start]
        # A run at a limit is saturation, or rectified EMG at rest.
        if stop - start < shortest or value in edges:
            continue
        yield _constant_run(values.size, start, stop, value == 0.0)


def _rough(values: np.ndarray, period: float) -> bool:
    """Return True if a signal varies within 5 ms as surface EMG does, not as a straight line."""
    if not 0 < period <= LONGEST_EMG_INTERVAL:
        return False
    lag = max(8, round(5e-3 / period))
    if lag >= values.size:
        return False
    near, far = (np.abs(values[k:] - values[:-k]) for k in (1, lag))
    moving = near[near > 0], far[far > 0]
    if not all(part.size for part in moving):
        return False
    return float(np.median(moving[0])) > 1.3 / lag * float(np.median(moving[1]))


def marker_fillers(values: np.ndarray, elsewhere: float) -> Iterator[Filler]:
    """Find the fillers of a marker (axes, frames) [m].

    `elsewhere` [m] is the usual distance of the other markers from the origin.
    """
    yield from _infinite(values)
    finite = np.asarray(np.isfinite(values).all(axis=0))
    zero = finite & np.asarray((values == 0.0).all(axis=0))
    others = np.unique(values[:, finite & ~zero], axis=1).shape[1]
    # A marker that is a few positions alone, of which the origin is one, was not measured.
    if zero.any() and (elsewhere > FAR_MARKER or (others >= 3 and _apart(values, zero, finite))):
        yield Filler(zero, "zeros")
        finite &= ~zero
    if values.shape[1] < LEAST_FILLER_SAMPLES or not finite.any():
        return
    kept = np.where(finite, values, np.nan)
    far = _far(kept, FILLER_DISTANCE, FAR_MARKER)
    if far is not None:
        yield far
        finite &= ~far.mask
    noisy = _noisy(kept)
    steps = np.linalg.norm(np.diff(kept, axis=1), axis=0)
    usual = float(np.nanpercentile(steps, 90)) if np.isfinite(steps).any() else np.inf
    for start, stop in _runs(kept, finite):
        # A marker without noise, as of a simulation, may rest; it does not jump afterwards.
        if noisy or (stop <= steps.size and steps[stop - 1] > ORIGIN_JUMP * usual):
            yield _constant_run(values.shape[1], start, stop, False)


def _noisy(values: np.ndarray) -> bool:
    """Return True for positions (axes, frames) with the noise of a measurement.

    Third differences of a smooth motion are far smaller than its steps.
    """
    first, third = (np.linalg.norm(np.diff(values, k, axis=1), axis=0) for k in (1, 3))
    moving, rough = first[first > 0], third[third > 0]
    if not moving.size or not rough.size:
        return False
    return float(np.median(rough)) > NOISE_SHARE * float(np.median(moving))


def _apart(values: np.ndarray, zero: np.ndarray, finite: np.ndarray) -> bool:
    """Return True if positions (axes, frames) jump to zero: a displacement may begin there."""
    distance = np.linalg.norm(values, axis=0)
    edges = np.flatnonzero(np.diff(zero.astype(np.int8)))
    adjacent = np.where(zero[edges], edges + 1, edges)
    adjacent = distance[adjacent[finite[adjacent]]]
    moving = finite & ~zero
    steps = np.linalg.norm(np.diff(values, axis=1), axis=0)[moving[1:] & moving[:-1]]
    if not adjacent.size or not steps.size:
        return True
    return float(np.median(adjacent)) > ORIGIN_JUMP * float(np.percentile(steps, 90))


def _constant_run(size: int, start: int, stop: int, zero: bool) -> Filler:
    """Filler of a run of equal samples; the first of a held value was measured."""
    mask = np.zeros(size, dtype=bool)
    mask[start if zero else start + 1 : stop] = True
    return Filler(mask, "zeros" if zero else "a held value")


def _infinite(values: np.ndarray) -> Iterator[Filler]:
    mask = np.asarray(np.isinf(values).any(axis=0))
    if mask.any():
        yield Filler(mask, "infinity")


def _far(values: np.ndarray, ratio: float, least: float) -> Filler | None:
    """Find up to `MOST_FILLER_CODES` repeated values that are far from all others (axes, samples).

    Their distance from the others exceeds `ratio` times the range of these and `least`. A saturated
    signal approaches its limit, so that other values are near it.
    """
    finite = np.asarray(np.isfinite(values).all(axis=0))
    points = values[:, finite]
    rest = np.ones(points.shape[1], dtype=bool)
    codes: list[np.ndarray] = []
    while (
        rest.sum() > max(LEAST_FILLER_SAMPLES, LEAST_MEASURED * rest.size)
        and len(codes) < MOST_FILLER_CODES
    ):
        kept = points[:, rest]
        ends = {*kept.argmin(axis=1).tolist(), *kept.argmax(axis=1).tolist()}
        same = [np.asarray((kept == kept[:, k : k + 1]).all(axis=0)) for k in ends]
        often = max(same, key=lambda one: (int(one.sum()), _coded(kept[:, one][:, 0])))
        code = kept[:, often][:, 0]
        if often.sum() < 2 and not _coded(code):
            return None
        rest[np.flatnonzero(rest)[often]] = False
        codes.append(code)
        others = points[:, rest]
        if others.shape[1] < max(LEAST_FILLER_SAMPLES, LEAST_MEASURED * rest.size):
            return None
        low, high = others.min(axis=1), others.max(axis=1)
        extent = float((high - low).max())
        away = [float(np.maximum(low - one, one - high).max()) for one in codes]
        far = [one for one, d in zip(codes, away, strict=True) if d > max(ratio * extent, least)]
        if extent > 0.0 and far:
            mask = np.any([(values == one[:, None]).all(axis=0) for one in far], axis=0)
            listing = " and ".join(f"{float(one[0]):.6g}" for one in far)
            return Filler(mask, f"the constant{'s' if len(far) > 1 else ''} {listing}")
    return None


def _coded(point: np.ndarray) -> bool:
    """Return True for a position whose axes are equal, such as 9999, which none has by chance."""
    return point.size > 1 and float(np.ptp(point)) == 0.0


def _runs(values: np.ndarray, finite: np.ndarray) -> Iterator[tuple[int, int]]:
    """Runs of equal samples (axes, samples) that are neither chance nor due to the resolution."""
    steps = np.diff(values, axis=1)
    both = finite[1:] & finite[:-1]
    equal = both & np.asarray((steps == 0.0).all(axis=0))
    if not equal.any() or both.sum() < LEAST_FILLER_SAMPLES:
        return
    edges = np.flatnonzero(np.diff(np.concatenate(([0], equal.astype(np.int8), [0]))))
    starts, lengths = edges[::2], edges[1::2] - edges[::2]
    moving = np.abs(steps[:, both & ~equal])
    moving = moving[moving > 0]
    if not moving.size or float(np.median(moving)) < FINE_STEPS * float(moving.min()):
        return
    for start, length in zip(starts.tolist(), lengths.tolist(), strict=True):
        # Equal steps elsewhere; three runs of a filler do not make a fourth one likely.
        others = int((lengths[lengths < length]).sum())
        share = (others + 1.0) / (int(both.sum()) + 2.0)
        if length >= 2 and values.shape[1] * share**length < FILLER_CHANCE:
            yield start, start + length + 1


def _distance_of_markers(values: np.ndarray) -> float:
    """Median distance of the markers (markers, axes, frames) from the origin [m], zeros left out."""
    distance = np.linalg.norm(values, axis=1)
    seen = distance[np.isfinite(distance) & (distance > 0)]
    return float(np.median(seen)) if seen.size else 0.0


def _finding(
    code: str, kind: str, name: str, filler: Filler, time: np.ndarray, period: float
) -> Finding:
    mask = filler.mask
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    starts, lengths = edges[::2], edges[1::2] - edges[::2]
    longest = int(np.argmax(lengths))
    values = {
        "filler": filler.what,
        "samples": int(mask.sum()),
        "seconds": float(lengths[longest] * period) if np.isfinite(period) else 0.0,
        "at": float(time[starts[longest]]),
    }
    return Finding(code, "marker" if kind == "marker" else "channel", name, values)


def _usable(recording: xr.Dataset, name: str, dims: tuple[str, ...]) -> bool:
    return (
        name in recording
        and {*recording[name].dims} == {*dims}
        and all(dim in recording.coords for dim in dims)
        and recording[name].dtype.kind in "fiu"
        and recording[dims[-1]].dtype.kind in "fiu"
    )


def usable_parts(recording: xr.Dataset) -> xr.Dataset:
    """Return a recording without the variables whose dims or types are not those of a recording."""
    parts = (("emg", ("channel", "time_emg")), ("position", ("marker", "axis", "time_marker")))
    keep = [name for name, dims in parts if _usable(recording, name, dims)]
    result = recording[keep]
    for name, dims in parts:
        if name in keep:
            result = result.assign({name: result[name].transpose(*dims)})
    return result


def _period(time: np.ndarray) -> float:
    return float((time[-1] - time[0]) / (time.size - 1)) if time.size > 1 else float("nan")
