"""Which measures a person should look at, in words."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr

from emgface.errors import SignalError
from emgface.recordings.quality.cross_talk import cross_talk
from emgface.recordings.quality.emg import emg_quality
from emgface.recordings.quality.markers import LAYOUT, marker_quality, swapped_markers
from emgface.recordings.quality.sides import swapped_sides

MUCH_HUM = 0.1
"""Share of power in the lines of the mains."""
LOUD_HUM = 5e-6
"""Root mean square [V] of hum below which it disturbs no surface EMG, however silent the muscle."""
UNLIKELY = 1e-4
"""Probability of a line by chance below which it is taken for hum."""
MUCH_ARTEFACT = 0.5
"""Share of power below the band of muscles."""
MUCH_DRIFT = 1e-3
"""Drift [V], ten times a strong surface EMG."""
LONG_STUCK = 0.05
"""Seconds at one value: a transmitter that lost its link."""
MUCH_SATURATION = 0.001
"""Share of samples on the rails."""
LOUD_BASELINE = 20e-6
"""Root mean square at rest [V]."""
MUCH_CROSS_TALK = 0.25
"""Amplitude with which an electrode hears its neighbour's muscle; equal ones correlate at 0.5."""
MUCH_NOISE = 1e-3
"""Noise of a marker [m]."""
TOO_FAST = 1.5
"""Speed [m/s] that no marker on a face reaches."""
TOO_FAST_ELSEWHERE = 15.0
"""Speed [m/s] that no other marker on a body reaches in a laboratory."""

Finding = tuple[str, str, str]
"""Kind (channel or marker), name, sentence."""


def findings(
    recording: xr.Dataset,
) -> tuple[dict[tuple[str, str], dict[str, float]], list[Finding]]:
    """Measure the quality of a recording and say what stands out.

    Parameters
    ----------
    recording : Dataset
        Recording, of EMG or markers or both.

    Returns
    -------
    dict of (kind, name) to dict
        Measures of `emg_quality` and `marker_quality`; ``common`` and ``cross_talk``, the largest
        that `cross_talk` finds between a channel and a neighbour.
    list of tuple
        Kind, name and one clause for each thing to look at.
    """
    measures: dict[tuple[str, str], dict[str, float]] = {}
    found: list[Finding] = []
    try:
        if "emg" in recording:
            for name, row in _rows(emg_quality(recording["emg"])):
                measures["channel", name] = {**row, "common": np.nan, "cross_talk": np.nan}
                found += [("channel", name, text) for text in _channel(row)]
            pairs = cross_talk(recording["emg"])
            for a, b, r, _, common, share in pairs.itertuples(index=False):
                for name in (a, b):
                    row = measures["channel", name]
                    row["common"] = float(np.fmax(common, row["common"]))
                    row["cross_talk"] = float(np.fmax(share, row["cross_talk"]))
                if share > MUCH_CROSS_TALK:
                    text = f"shares {common:.0%} of its power with {b} (r = {r:.2f}, "
                    text += f"cross-talk {share:.0%}): see the distance of the electrodes"
                    found.append(("channel", a, text))
        if "position" in recording:
            for name, row in _rows(marker_quality(recording["position"])):
                measures["marker", name] = row
                found += [("marker", name, text) for text in _marker(name, row)]
            found += _exchanged(swapped_markers(recording["position"]))
        for left, right, r, swapped in swapped_sides(recording).itertuples(index=False):
            if swapped:
                text = f"follows the mouth corner of the other side (r = {r:.2f} with {right}): "
                found.append(("channel", left, text + "see whether left and right are exchanged"))
    except SignalError:
        pass  # a clock that is not uniform, which the check of clocks tells for every row
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
            f"{row['hum_rms'] * 1e6:.3g} uV: see ground and leads, or use a notch"
        )
    if row["artefact"] > MUCH_ARTEFACT:
        found.append(f"{row['artefact']:.0%} of its power lies below 15 Hz: movement artefact")
    if row["drift"] > MUCH_DRIFT:
        found.append(f"drifts by {row['drift'] * 1e3:.3g} mV: see skin and electrode")
    if row["stuck"] > LONG_STUCK:
        found.append(f"stays at one value for {row['stuck']:.3g} s: dropout")
    if row["saturated"] > MUCH_SATURATION:
        found.append(f"{row['saturated']:.1%} of samples on the rails: saturated, lower the gain")
    if row["baseline"] > LOUD_BASELINE:
        found.append(f"baseline {row['baseline'] * 1e6:.3g} uV: noisy, or the muscle never rests")
    return found


def _marker(name: str, row: Mapping[str, float]) -> list[str]:
    found: list[str] = []
    if row["noise"] > MUCH_NOISE:
        found.append(f"noise of {row['noise'] * 1e3:.3g} mm: see calibration and light")
    if row["largest_speed"] > (TOO_FAST if name in LAYOUT else TOO_FAST_ELSEWHERE):
        found.append(f"moves at up to {row['largest_speed']:.3g} m/s: leaps, or a wrong match")
    return found


def _exchanged(table: pd.DataFrame) -> list[Finding]:
    found: list[Finding] = []
    for first, second, time, ratio in table.itertuples(index=False):
        if first == "left":
            text = "left and right of all markers are exchanged, or the axes are a mirror image"
            found.append(("marker", "", text))
        elif np.isnan(time):
            text = f"lies where {second} is expected (misfit {ratio:.0%} when exchanged)"
            found.append(("marker", first, text))
        else:
            found.append(("marker", first, f"changes places with {second} at {time:.4g} s"))
    return found
