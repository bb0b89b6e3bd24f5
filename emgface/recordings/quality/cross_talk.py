"""Cross-talk between neighbouring channels."""

from itertools import combinations

import numpy as np
import pandas as pd
import scipy.signal
import xarray as xr

from emgface.muscles import CHANNELS_AT_MIDLINE, NEIGHBOURS, SIDES
from emgface.recordings.quality.emg import can_be_judged, in_muscle_band
from emgface.recordings.quality.hum import mains_hum, remove_hum
from emgface.signals.filters import TIME_EMG, sampling_rate

CROSS_TALK_COLUMNS = ("channel", "neighbour", "correlation", "lag", "common", "share")
STRONG_HUM = 0.1
"""Fraction of mains hum in the power of a channel above which it is removed before comparison."""
LARGEST_LAG = 0.01  #: largest delay between two electrodes [s]: 40 mm at 4 m/s


def neighbours() -> list[tuple[str, str]]:
    """Return the pairs of channels with neighbouring electrodes on each side and at the midline."""
    pairs = [(f"{a}_{side}", f"{b}_{side}") for side in SIDES for a, b in NEIGHBOURS]
    return pairs + [(f"{name}_{SIDES[0]}", f"{name}_{SIDES[1]}") for name in CHANNELS_AT_MIDLINE]


def cross_talk(emg: xr.DataArray) -> pd.DataFrame:
    """Measure the common part of pairs of channels.

    `emg` (channel, time_emg) [V] is the raw signal, which is filtered to 15-500 Hz, and strong hum
    is removed. The pairs are the neighbours on the face that exist, or, if the channels
    are not those of the face, all pairs. Columns are ``channel``, ``neighbour``; ``correlation``,
    the cross-correlation coefficient r of largest magnitude for delays up to 10 ms, and its ``lag``
    [s] (positive if the channel is later than its neighbour); ``common`` = r^2, the common part of
    the power; ``share``, the relative amplitude c of each source at the other electrode. Pairs with
    gaps, a constant channel or less than a second are omitted. Raises SignalError if the clock is
    not uniform.

    r^2 as the common part: Winter, Fuglevand and Archer 1994, J Electromyogr Kinesiol 4:15-26. For
    two independent sources of powers P and Q, each recorded by the other electrode with amplitude
    c, the covariance is c (P + Q) and the sum of variances (1 + c^2) (P + Q). With q their ratio, c
    = (1 - sqrt(1 - 4 q^2)) / (2 q), for any powers; a passive muscle next to a strong one results in
    a large r and a small c. Simultaneous contraction alone does not correlate muscles, because
    their motor units fire independently.
    """
    rate = sampling_rate(emg[TIME_EMG])
    signals = {
        str(name): values
        for name, values in zip(
            emg["channel"].values, emg.transpose("channel", TIME_EMG).values, strict=True
        )
        if can_be_judged(values, rate)
    }
    pairs = [pair for pair in neighbours() if set(pair) <= set(signals)]
    pairs = pairs or list(combinations(signals, 2))
    heard = {
        name: in_muscle_band(_without_hum(emg.sel(channel=[name]), values, rate), rate)
        for name, values in signals.items()
    }
    rows = [(a, b, *_common(heard[a], heard[b], rate)) for a, b in pairs if {a, b} <= set(heard)]
    return pd.DataFrame(rows, columns=list(CROSS_TALK_COLUMNS))


def _without_hum(emg: xr.DataArray, values: np.ndarray, rate: float) -> np.ndarray:
    """Remove strong hum, which is common to channels without cross-talk."""
    hum = mains_hum(values, rate)
    if hum.share < STRONG_HUM or hum.frequency >= 0.5 * rate:
        return values
    return remove_hum(emg, hum.frequency).values[0]


def _common(a: np.ndarray, b: np.ndarray, rate: float) -> tuple[float, float, float, float]:
    """Correlation, lag, common part and share of two signals."""
    most = round(LARGEST_LAG * rate)
    norm = np.sqrt(np.sum(a**2) * np.sum(b**2))
    if norm == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    whole = scipy.signal.correlate(a, b, mode="full", method="fft") / norm
    middle = a.size - 1
    near = whole[middle - most : middle + most + 1]
    at = int(np.argmax(np.abs(near)))
    r = float(np.clip(near[at], -1.0, 1.0))
    q = abs(r) * norm / (np.sum(a**2) + np.sum(b**2))
    share = (1.0 - np.sqrt(max(1.0 - 4.0 * q**2, 0.0))) / (2.0 * q) if q else 0.0
    return r, (at - most) / rate, r**2, float(share)
