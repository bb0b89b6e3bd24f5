"""Sampling rates and gains that do not agree with the signal."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr

from emgface.errors import SignalError
from emgface.muscles import SIDES
from emgface.recordings.quality.emg import emg_quality
from emgface.signals.filters import TIME_EMG, sampling_rate

MEDIAN_FREQUENCY: Final = (50.0, 180.0)
"""Median frequencies [Hz], from 15 to 500 Hz, of plausible surface EMG, median over channels.

Recordings of known rate of biceps and shoulder: 65 to 81 Hz; the spectrum of Shwedyk et al. 1977:
96 Hz; simulated motor units of the face: 127 to 137 Hz. A wrong factor of 2 is therefore found for
a part of the recordings only.
"""
ACTIVE: Final = 12.0
"""Signal-to-noise ratio [dB] above which the spectrum is that of the muscle, not of the amplifier."""
LEAST_RATE: Final = 800.0
"""Sampling rate [Hz] below which the rate itself, not the muscle, bounds the median frequency."""
GAIN_RATIO: Final = 4.0
"""Ratio of amplifier noise and of activity above which gains differ.

A one-sided movement, or a muscle that never rests, changes the activity but not the noise above the
band of muscles, and a poor electrode the noise but not the activity; only a gain changes both.
"""


def doubtful_rate(measures: pd.DataFrame, rate: float) -> str:
    """Return a clause if the median frequency contradicts the sampling rate [Hz], otherwise "".

    `measures` has the columns of `emgface.recordings.quality.emg_quality`, one row per channel. The
    median over the active channels is compared with `MEDIAN_FREQUENCY`.
    """
    active = measures.loc[measures["snr"] > ACTIVE, "median_frequency"].dropna()
    if rate < LEAST_RATE or active.empty:
        return ""
    found, (low, high) = float(active.median()), MEDIAN_FREQUENCY
    if low <= found <= high:
        return ""
    error = "low" if found < low else "high"
    return (
        f"median frequency {found:.0f} Hz over {len(active)} active "
        f"channel{'s' if len(active) > 1 else ''} at a sampling rate of {rate:g} Hz, expected "
        f"{low:g} to {high:g} Hz for surface EMG: check whether the rate is too {error}"
    )


def doubtful_sides(measures: pd.DataFrame) -> dict[str, str]:
    """Return a clause by channel whose amplifier noise and activity both exceed those of the other side.

    `measures` is as for `doubtful_rate`, with the names of the study, ``ZYG_L`` and ``ZYG_R``.
    """
    levels = _levels(measures)
    found: dict[str, str] = {}
    for name in levels.index:
        muscle, _, side = str(name).rpartition("_")
        other = f"{muscle}_{SIDES[1 - SIDES.index(side)]}" if side in SIDES else ""
        if other in levels.index and (told := _exceeds(levels, levels, str(name), other)):
            found[str(name)] = (
                f"{told} that of {other}, expected at most {GAIN_RATIO:g} times: check gain and unit "
                "of both sides"
            )
    return found


def doubtful_gains(recordings: Mapping[str, pd.DataFrame]) -> dict[str, str]:
    """Return a clause by recording of one volunteer whose gain differs from that of the others.

    `recordings` contain measures as for `doubtful_rate`. Amplifier noise and activity of each channel
    are compared with the medians over the other recordings, of which there are at least two.
    """
    levels = {file: _levels(measures) for file, measures in recordings.items()}
    found: dict[str, str] = {}
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
                found[file] = (
                    f"{len(differ)} of {len(shared)} channels ({', '.join(differ[:4])}"
                    f"{', ...' if len(differ) > 4 else ''}) are {ratio:.2g} times {word} than in the "
                    "volunteer's other recordings, in amplifier noise and in activity, expected at most "
                    f"{GAIN_RATIO:g} times: check gain and unit"
                )
    return found


def doubts_of(recording: xr.Dataset) -> list[str]:
    """Return a sentence without full stop for each doubt about rate and gains of a recording.

    The raw signal is ``emg`` (channel, time_emg) [V]. Without real numbers of these dims, or if its
    clock is not uniform, the list is empty, because later steps refuse such a recording.
    """
    if "emg" not in recording or "channel" not in recording["emg"].coords:
        return []
    emg = recording["emg"]
    if {*emg.dims} != {"channel", TIME_EMG} or emg.dtype.kind not in "fiu":
        return []
    try:
        rate = sampling_rate(emg[TIME_EMG])
        measures = emg_quality(emg)
    except SignalError:
        return []
    told = doubtful_rate(measures, rate)
    found = [told] if told else []
    return found + [f"channel {name}: {text}" for name, text in doubtful_sides(measures).items()]


def _levels(measures: pd.DataFrame) -> pd.DataFrame:
    """Root mean square of amplifier noise and in activity [V] of the channels that contain both."""
    activity = measures["baseline"] * 10.0 ** (measures["snr"] / 20.0)
    levels = pd.DataFrame({"noise": measures["floor"], "activity": activity})
    levels = levels.replace(np.inf, np.nan).dropna()
    return levels[levels.min(axis=1) > 0]


def _exceeds(one: pd.DataFrame, two: pd.DataFrame, first: str, second: str) -> str:
    """Ratios of two channels as a clause if both are above `GAIN_RATIO`, otherwise ""."""
    held, other = one.loc[first].to_numpy(dtype=float), two.loc[second].to_numpy(dtype=float)
    noise, activity = (held / other).tolist()
    if min(noise, activity) <= GAIN_RATIO:
        return ""
    return f"amplifier noise is {noise:.2g} times and activity {activity:.2g} times"
