"""Findings in the quality measures."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr

from emgface.errors import SignalError
from emgface.recordings.findings import Finding, Kind
from emgface.recordings.quality.blocks import blocks_stored_twice
from emgface.recordings.quality.cross_talk import cross_talk
from emgface.recordings.quality.emg import emg_quality
from emgface.recordings.quality.markers import (
    LAYOUT,
    coinciding_markers,
    marker_quality,
    swapped_markers,
)
from emgface.recordings.quality.plausible import doubtful_rate, doubtful_sides, wrong_size
from emgface.recordings.quality.processed import processing
from emgface.recordings.quality.sides import swapped_sides
from emgface.recordings.quality.spikes import spikes
from emgface.signals.doubtful import little_in_common
from emgface.signals.filters import TIME_EMG, sampling_rate

MUCH_HUM = 0.1  #: fraction of the power in the lines of the mains
LOUD_HUM = 5e-6  #: root mean square [V] of hum below which it does not affect surface EMG
UNLIKELY = 1e-4  #: probability of a line by chance below which it is regarded as hum
MUCH_ARTEFACT = 0.5  #: fraction of the power below the band of muscles
MUCH_DRIFT = 1e-3  #: drift [V], ten times a strong surface EMG
LONG_STUCK = 0.05  #: time at one value [s], as when a transmitter loses its connection
MUCH_SATURATION = 0.001  #: fraction of samples at the limits of the amplifier
LOUD_BASELINE = 20e-6  #: root mean square at rest [V]
MUCH_CROSS_TALK = 0.25
"""Relative amplitude of a neighbour's muscle at an electrode; equal channels correlate at 0.5."""
MUCH_NOISE = 1e-3  #: noise of a marker [m]
TOO_FAST = 1.5  #: speed [m/s] above which a face marker is suspect
TOO_FAST_ELSEWHERE = 15.0  #: speed [m/s] above which any other marker on the body is suspect


def findings(
    recording: xr.Dataset,
) -> tuple[dict[tuple[str, str], dict[str, float]], list[Finding]]:
    """Measure the quality of a recording and return the findings.

    Returned are, by (kind, name), the measures of `emg_quality` and `marker_quality`, with
    ``common`` and ``cross_talk``, the largest value of `cross_talk` between a channel and a
    neighbour; and the findings, without a name if they apply to all channels or markers.
    """
    measures: dict[tuple[str, str], dict[str, float]] = {}
    result: list[Finding] = []
    try:
        if "emg" in recording:
            result += _of_channels(recording["emg"], measures)
        if "position" in recording:
            for name, row in _rows(marker_quality(recording["position"])):
                measures["marker", name] = row
                result += _marker(name, row)
            result += _exchanged(swapped_markers(recording["position"]))
            for one, other, frames, at in coinciding_markers(recording["position"]).itertuples(
                False
            ):
                numbers = {"other": str(other), "frames": float(frames), "at": float(at)}
                result.append(Finding("coincides", "marker", str(one), numbers))
            result += wrong_size(recording["position"])
            result += _stored_twice(recording["position"], "marker", "time_marker")
        result += little_in_common(recording)
        for left, right, r, swapped in swapped_sides(recording).itertuples(index=False):
            if swapped:
                numbers = {"r": r, "other": str(right)}
                result.append(Finding("sides_exchanged", "channel", str(left), numbers))
    except SignalError:
        pass  # a non-uniform clock, which the check of clocks reports for every row
    return measures, result


def _stored_twice(array: xr.DataArray, kind: Kind, time: str) -> list[Finding]:
    """Finding on the blocks that the channels or markers contain twice."""
    clock = array[time].values
    rate = sampling_rate(array[time])
    blocks = blocks_stored_twice(array.transpose(..., time).values.reshape(-1, clock.size), rate)
    if not blocks:
        return []
    numbers = {
        "count": len(blocks),
        "at": float(clock[blocks[0].start]),
        "seconds": blocks[0].samples / rate,
        "earlier": (blocks[0].start - blocks[0].first) / rate,
    }
    return [Finding("stored_twice", kind, "", numbers)]


def _of_channels(
    emg: xr.DataArray, measures: dict[tuple[str, str], dict[str, float]]
) -> list[Finding]:
    """Measure the channels, and return the findings on them."""
    result: list[Finding] = []
    rate = sampling_rate(emg[TIME_EMG])
    table = emg_quality(emg)
    processed: set[str] = set()
    for name, row in _rows(table):
        measures["channel", name] = {**row, "common": np.nan, "cross_talk": np.nan}
        treated = processing(name, emg.sel(channel=name).values, rate)
        if treated is None:
            result += _channel(name, row)
        else:  # hum, artefact and drift are properties of the raw signal
            processed.add(name)
            result.append(treated)
    for name in map(str, emg["channel"].values):
        result += _spikes(name, emg.sel(channel=name), rate)
    result += _stored_twice(emg, "channel", TIME_EMG)
    raw = table.drop(index=list(processed))
    if numbers := doubtful_rate(raw, rate):
        result.append(Finding("median_frequency", "channel", "", numbers))
    for name, numbers in doubtful_sides(raw).items():
        result.append(Finding("sides_differ", "channel", name, numbers))
    for a, b, r, _, common, share in cross_talk(emg).itertuples(index=False):
        for name in (a, b):
            row = measures["channel", name]
            row["common"] = float(np.fmax(common, row["common"]))
            row["cross_talk"] = float(np.fmax(share, row["cross_talk"]))
        if share > MUCH_CROSS_TALK:
            numbers = {"common": common, "other": str(b), "r": r, "share": share}
            result.append(Finding("cross_talk", "channel", str(a), numbers))
    return result


def _rows(table: pd.DataFrame) -> list[tuple[str, dict[str, float]]]:
    return [
        (str(name), {str(key): float(value) for key, value in row.items()})
        for name, row in table.iterrows()
    ]


def _channel(name: str, row: Mapping[str, float]) -> list[Finding]:
    """Findings on one channel; a comparison with NaN is false."""
    result: list[Finding] = []

    def note(code: str, **numbers: float) -> None:
        result.append(Finding(code, "channel", name, numbers))

    sure = row["hum_chance"] < UNLIKELY
    if row["hum"] > MUCH_HUM and row["hum_rms"] > LOUD_HUM and sure:
        frequency, level = row["hum_frequency"], 1e6 * row["hum_rms"]
        note("hum", share=row["hum"], frequency=frequency, microvolts=level)
    if row["artefact"] > MUCH_ARTEFACT:
        note("artefact", share=row["artefact"])
    if row["drift"] > MUCH_DRIFT:
        note("drift", millivolts=1e3 * row["drift"])
    if row["stuck"] > LONG_STUCK:
        note("stuck", seconds=row["stuck"])
    if row["saturated"] > MUCH_SATURATION:
        note("saturated", share=row["saturated"])
    if row["baseline"] > LOUD_BASELINE:
        note("baseline", microvolts=1e6 * row["baseline"])
    return result


def _spikes(name: str, values: xr.DataArray, rate: float) -> list[Finding]:
    """Finding of single samples far from their neighbours in a channel."""
    outliers = spikes(values.values, rate)
    if not outliers.at.size:
        return []
    numbers = {
        "count": int(outliers.at.size),
        "at": float(values[TIME_EMG].values[outliers.at[0]]),
        "microvolts": 1e6 * float(outliers.distance[0]),
    }
    return [Finding("spikes", "channel", name, numbers)]


def _marker(name: str, row: Mapping[str, float]) -> list[Finding]:
    result: list[Finding] = []
    if row["noise"] > MUCH_NOISE:
        result.append(Finding("noise", "marker", name, {"millimetres": 1e3 * row["noise"]}))
    if row["largest_speed"] > (TOO_FAST if name in LAYOUT else TOO_FAST_ELSEWHERE):
        result.append(Finding("jumps", "marker", name, {"speed": row["largest_speed"]}))
    return result


def _exchanged(table: pd.DataFrame) -> list[Finding]:
    result: list[Finding] = []
    for first, second, time, ratio in table.itertuples(index=False):
        if first == "left":
            result.append(Finding("mirrored", "marker"))
        elif np.isnan(time):
            numbers = {"other": str(second), "ratio": float(ratio)}
            result.append(Finding("misplaced", "marker", str(first), numbers))
        else:
            numbers = {"other": str(second), "at": float(time)}
            result.append(Finding("exchanged", "marker", str(first), numbers))
    return result
