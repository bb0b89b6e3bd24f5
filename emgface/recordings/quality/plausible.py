"""Sampling rates and gains that do not agree with the signal."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr

from emgface.muscles import FACE_MARKERS, SIDES
from emgface.recordings.findings import Finding
from emgface.recordings.head import LARGEST_RATIO
from emgface.recordings.quality.markers import LAYOUT

MEDIAN_FREQUENCY: Final = (50.0, 180.0)
"""Median frequencies [Hz], from 15 to 500 Hz, of plausible surface EMG, median over channels.

Recordings of known rate of biceps and shoulder: 65 to 81 Hz; the spectrum of Shwedyk et al. 1977:
96 Hz; simulated motor units of the face: 127 to 137 Hz. A wrong factor of 2 is therefore found for
a part of the recordings only.
"""
HALF_MOUTH: Final = 0.025  #: unit of `LAYOUT` [m]
LEAST_SIZED_MARKERS: Final = 3  #: markers from which a size can be judged
SIZES: Final = (0.005, 5.0)
"""Spread [m] of the markers of a part of a body, from the lips to a person in a laboratory."""
MUSCLE_SNR_DB: Final = 12.0
"""Signal-to-noise ratio [dB] above which the spectrum is that of the muscle, not of the amplifier."""
LEAST_MEDIAN_RATE: Final = 800.0
"""Sampling rate [Hz] below which the rate itself, not the muscle, bounds the median frequency."""
GAIN_RATIO: Final = 4.0
"""Ratio of amplifier noise and of activity above which gains differ.

A one-sided movement, or a muscle that never rests, changes the activity but not the noise above the
band of muscles, and a poor electrode the noise but not the activity; only a gain changes both.
"""


def doubtful_rate(measures: pd.DataFrame, rate: float) -> dict[str, float | str]:
    """Return the values of a finding if the median frequency contradicts the sampling rate [Hz].

    `measures` has the columns of `emgface.recordings.quality.emg_quality`, one row per channel. The
    median over the active channels is compared with `MEDIAN_FREQUENCY`.
    """
    active = measures.loc[measures["snr"] > MUSCLE_SNR_DB, "median_frequency"].dropna()
    if rate < LEAST_MEDIAN_RATE or active.empty:
        return {}
    median, (low, high) = float(active.median()), MEDIAN_FREQUENCY
    if low <= median <= high:
        return {}
    error = "low" if median < low else "high"
    limits = {"low": low, "high": high, "error": error}
    return {"found": median, "channels": len(active), "rate": rate, **limits}


def doubtful_sides(measures: pd.DataFrame) -> dict[str, dict[str, float | str]]:
    """Return values by channel whose amplifier noise and activity both exceed those of the other side.

    `measures` is as for `doubtful_rate`, with the names of the study, ``ZYG_L`` and ``ZYG_R``.
    """
    levels = _levels(measures)
    doubtful: dict[str, dict[str, float | str]] = {}
    for name in levels.index:
        muscle, _, side = str(name).rpartition("_")
        other = f"{muscle}_{SIDES[1 - SIDES.index(side)]}" if side in SIDES else ""
        if other in levels.index and (ratios := _exceeds(levels, levels, str(name), other)):
            numbers = {"noise": ratios[0], "activity": ratios[1]}
            doubtful[str(name)] = {**numbers, "other": other, "allowed": GAIN_RATIO}
    return doubtful


def doubtful_gains(recordings: Mapping[str, pd.DataFrame]) -> dict[str, str]:
    """Return a clause by recording of one volunteer whose gain differs from that of the others.

    `recordings` contain measures as for `doubtful_rate`. Amplifier noise and activity of each channel
    are compared with the medians over the other recordings, of which there are at least two.
    """
    levels = {file: _levels(measures) for file, measures in recordings.items()}
    clauses: dict[str, str] = {}
    for file, own in levels.items():
        others = [each for name, each in levels.items() if name != file]
        if len(others) < 2:
            continue
        usual = pd.concat(others).groupby(level=0).median()
        shared = [str(name) for name in own.index if name in usual.index]
        for one, two, word in ((own, usual, "larger"), (usual, own, "smaller")):
            differ = [name for name in shared if _exceeds(one, two, name, name)]
            if differ:
                ratio = float(np.median((one.loc[differ] / two.loc[differ]).to_numpy()))
                clauses[file] = (
                    f"{len(differ)} of {len(shared)} channels ({', '.join(differ[:4])}"
                    f"{', ...' if len(differ) > 4 else ''}) are {ratio:.2g} times {word} than in the "
                    "volunteer's other recordings, in amplifier noise and in activity, expected at most "
                    f"{GAIN_RATIO:g} times: check gain and unit"
                )
    return clauses


def wrong_size(position: xr.DataArray) -> list[Finding]:
    """Return the finding that the face markers are not those of a face of the size of a person.

    `position` (marker, axis, time_marker) [m]. The root mean square distance of the face markers from
    their centre is compared with that of `LAYOUT`, by the ratio that `in_head_frame` accepts. Markers
    of other names are compared with the size of any body.
    """
    places = position.median("time_marker").transpose("marker", "axis")
    names = [str(name) for name in places["marker"].values]
    seen = np.asarray(np.isfinite(places.values).all(axis=1))
    face = [k for k, name in enumerate(names) if name in FACE_MARKERS and seen[k]]
    if len(face) >= LEAST_SIZED_MARKERS:
        layout = HALF_MOUTH * np.array([LAYOUT[names[k]] for k in face])
        size, expected = (_spread(x) for x in (places.values[face], layout))
        if not expected / LARGEST_RATIO <= size <= expected * LARGEST_RATIO:
            return [Finding("size", "marker", "", {"found": size, "expected": expected})]
        return []
    size = _spread(places.values[seen])
    low, high = SIZES
    if seen.sum() >= LEAST_SIZED_MARKERS and not low <= size <= high:
        return [Finding("scale", "marker", "", {"found": size, "low": low, "high": high})]
    return []


def _spread(points: np.ndarray) -> float:
    """Root mean square distance of points (points, axes) from their centre."""
    return float(np.linalg.norm(np.std(points, axis=0))) if len(points) else float("nan")


def _levels(measures: pd.DataFrame) -> pd.DataFrame:
    """Root mean square of amplifier noise and in activity [V] of the channels that contain both."""
    activity = measures["baseline"] * 10.0 ** (measures["snr"] / 20.0)
    levels = pd.DataFrame({"noise": measures["floor"], "activity": activity})
    levels = levels.replace(np.inf, np.nan).dropna()
    return levels[levels.min(axis=1) > 0]


def _exceeds(
    one: pd.DataFrame, two: pd.DataFrame, first: str, second: str
) -> tuple[float, float] | None:
    """Ratios of noise and activity of two channels if both are above `GAIN_RATIO`, otherwise None."""
    levels, other = one.loc[first].to_numpy(dtype=float), two.loc[second].to_numpy(dtype=float)
    noise, activity = (levels / other).tolist()
    if min(noise, activity) <= GAIN_RATIO:
        return None
    return noise, activity
