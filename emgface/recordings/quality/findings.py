"""Findings in the quality measures, as sentences."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr

from emgface.errors import SignalError
from emgface.recordings.quality.cross_talk import cross_talk
from emgface.recordings.quality.emg import emg_quality
from emgface.recordings.quality.markers import LAYOUT, marker_quality, swapped_markers
from emgface.recordings.quality.plausible import doubtful_rate, doubtful_sides
from emgface.recordings.quality.sides import swapped_sides
from emgface.signals.filters import TIME_EMG, sampling_rate
from emgface.signals.resampling import little_in_common

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

Finding = tuple[str, str, str]  #: kind (channel or marker), name, sentence


def findings(
    recording: xr.Dataset,
) -> tuple[dict[tuple[str, str], dict[str, float]], list[Finding]]:
    """Measure the quality of a recording and return the findings.

    Returned are, by (kind, name), the measures of `emg_quality` and `marker_quality`, with
    ``common`` and ``cross_talk``, the largest value of `cross_talk` between a channel and a
    neighbour; and kind, name and one clause for each finding, without a name if it applies to all
    channels or markers.
    """
    measures: dict[tuple[str, str], dict[str, float]] = {}
    found: list[Finding] = []
    try:
        if "emg" in recording:
            table = emg_quality(recording["emg"])
            for name, row in _rows(table):
                measures["channel", name] = {**row, "common": np.nan, "cross_talk": np.nan}
                found += [("channel", name, text) for text in _channel(row)]
            if told := doubtful_rate(table, sampling_rate(recording["emg"][TIME_EMG])):
                found.append(("channel", "", told))
            found += [("channel", name, text) for name, text in doubtful_sides(table).items()]
            pairs = cross_talk(recording["emg"])
            for a, b, r, _, common, share in pairs.itertuples(index=False):
                for name in (a, b):
                    row = measures["channel", name]
                    row["common"] = float(np.fmax(common, row["common"]))
                    row["cross_talk"] = float(np.fmax(share, row["cross_talk"]))
                if share > MUCH_CROSS_TALK:
                    text = f"shares {common:.0%} of its power with {b} (r = {r:.2f}, "
                    text += f"cross-talk {share:.0%}): check the distance of the electrodes"
                    found.append(("channel", a, text))
        if "position" in recording:
            for name, row in _rows(marker_quality(recording["position"])):
                measures["marker", name] = row
                found += [("marker", name, text) for text in _marker(name, row)]
            found += _exchanged(swapped_markers(recording["position"]))
        if said := little_in_common(recording):
            found.append(("marker", "", said))
        for left, right, r, swapped in swapped_sides(recording).itertuples(index=False):
            if swapped:
                text = f"correlates with the mouth corner of the other side (r = {r:.2f} with {right}): "
                found.append(("channel", left, text + "check whether left and right are exchanged"))
    except SignalError:
        pass  # a non-uniform clock, which the check of clocks reports for every row
    return measures, found


def _rows(table: pd.DataFrame) -> list[tuple[str, dict[str, float]]]:
    return [
        (str(name), {str(key): float(value) for key, value in row.items()})
        for name, row in table.iterrows()
    ]


def _channel(row: Mapping[str, float]) -> list[str]:
    """Clauses on one channel; a comparison with NaN is false."""
    found: list[str] = []
    sure = row["hum_chance"] < UNLIKELY
    if row["hum"] > MUCH_HUM and row["hum_rms"] > LOUD_HUM and sure:
        found.append(
            f"{row['hum']:.0%} of its power is mains hum of {row['hum_frequency']:g} Hz, "
            f"{row['hum_rms'] * 1e6:.3g} uV: check ground and leads, or use a notch"
        )
    if row["artefact"] > MUCH_ARTEFACT:
        found.append(f"{row['artefact']:.0%} of its power lies below 15 Hz: movement artefact")
    if row["drift"] > MUCH_DRIFT:
        found.append(f"drifts by {row['drift'] * 1e3:.3g} mV: check skin and electrode")
    if row["stuck"] > LONG_STUCK:
        found.append(f"stays at one value for {row['stuck']:.3g} s: dropout")
    if row["saturated"] > MUCH_SATURATION:
        found.append(
            f"{row['saturated']:.1%} of samples at the limits of the amplifier: saturated, lower "
            "the gain"
        )
    if row["baseline"] > LOUD_BASELINE:
        found.append(
            f"baseline {row['baseline'] * 1e6:.3g} uV: high noise, a muscle that is never at rest, or "
            "a wrong gain"
        )
    return found


def _marker(name: str, row: Mapping[str, float]) -> list[str]:
    found: list[str] = []
    if row["noise"] > MUCH_NOISE:
        found.append(f"noise of {row['noise'] * 1e3:.3g} mm: check calibration and light")
    if row["largest_speed"] > (TOO_FAST if name in LAYOUT else TOO_FAST_ELSEWHERE):
        found.append(
            f"moves at up to {row['largest_speed']:.3g} m/s: jumps, or a mismatch between cameras"
        )
    return found


def _exchanged(table: pd.DataFrame) -> list[Finding]:
    found: list[Finding] = []
    for first, second, time, ratio in table.itertuples(index=False):
        if first == "left":
            text = "left and right of all markers are exchanged, or the axes are mirrored"
            found.append(("marker", "", text))
        elif np.isnan(time):
            text = f"is at the position expected for {second} (misfit {ratio:.0%} when exchanged)"
            found.append(("marker", first, text))
        else:
            found.append(("marker", first, f"is exchanged with {second} at {time:.4g} s"))
    return found
