"""Levels of sEMG channels: recordings and references of maximum effort that do not fit are refused.

The root mean square in windows of 0.2 s serves all features. Noise at rest varies by a third or less
between such windows; contractions exceed it severalfold.
"""

import warnings
from collections.abc import Sequence

import numpy as np
import xarray as xr

from emgface.anatomy.jaw.model import Floats
from emgface.errors import FeatureWarning, JawError
from emgface.signals.features import root_mean_square

EFFORT_WINDOW = 0.2
"""Length of the windows [s]."""
BURST = 2.0
"""Least ratio of the strongest to the weakest window of a channel that contracts and rests."""
QUIETER, LOUDER = 0.05, 5.0
"""Ratios of rest in a recording to rest in its reference that another gain or unit explains,
the second relative to the median of the channels.

A channel that rests while its neighbours contract records their cross-talk, several times its noise.
"""

CLOSER, EXCHANGED_RATIO = 0.5, 0.2
"""Largest ratio of the difference of both sides with and without exchange of the labels, and the least
difference that is more than chance (of the logarithm)."""


def effort_levels(filtered: xr.DataArray) -> Floats:
    """Weakest, median and strongest window (3, channel) of filtered sEMG (channel, time_emg) [V]."""
    rms = root_mean_square(filtered, window=EFFORT_WINDOW).transpose("channel", "time").values
    return np.array([rms.min(axis=1), np.median(rms, axis=1), rms.max(axis=1)])


def at_rest(channels: Sequence[str], own: Floats) -> list[str]:
    """Channels that vary no more than noise does, with a warning.

    Without a reference Eq. 8 would amplify their noise to full excitation.
    """
    quiet = [c for c, low, high in zip(channels, own[0], own[2], strict=True) if high < BURST * low]
    if quiet:
        warnings.warn(
            f"{'channels' if len(quiet) > 1 else 'channel'} {', '.join(quiet)}: the strongest 0.2 s are "
            f"less than {BURST:g} times the weakest, as in noise; the excitation is zero. If the "
            "muscle was active, specify recordings of maximum effort as a reference",
            FeatureWarning,
            stacklevel=3,
        )
    return quiet


def require_effort(channels: Sequence[str], own: Floats, references: Sequence[Floats]) -> None:
    """Refuse references without rest or effort, and a recording of another gain or unit (JawError).

    Warns (FeatureWarning) if the rest of a channel is stronger than in the references, relative to
    the other channels.
    """
    low = np.min([one[0] for one in references], axis=0)
    high = np.max([one[2] for one in references], axis=0)
    _refuse(
        channels,
        high / low,
        high < BURST * low,
        "is in the strongest 0.2 s of maximum effort {0:.3g} times as strong as in the weakest, "
        f"expected at least {BURST:g} times: record rest and effort with all electrodes connected",
    )
    _refuse(
        channels,
        own[1] / high,
        own[1] > high,
        "is in the median {0:.3g} times as strong as the strongest instant of maximum effort, expected "
        "less than 1: check the units and the channels of both",
    )
    quiet = own[0] / low
    _refuse(
        channels,
        quiet,
        quiet < QUIETER,
        "is at rest {0:.3g} times as strong as in the recordings of maximum effort, expected about 1: "
        "check the units and gains of both, and whether those of maximum effort contain rest",
    )
    ratios = quiet / np.median(quiet)
    loud = [f"{c} ({x:.3g})" for c, x in zip(channels, ratios, strict=True) if x > LOUDER]
    if loud:
        warnings.warn(
            "rest is stronger than in maximum effort, relative to the other channels, in "
            f"{', '.join(loud)}: if these muscles are at rest in part of the recording, its "
            "gain or unit differs from that of the reference",
            FeatureWarning,
            stacklevel=3,
        )


def tell_exchanged_sides(
    channels: Sequence[str], own: Floats, references: Sequence[Floats]
) -> None:
    """Warn where the levels fit the references better with left and right exchanged in one of both.

    d_c is the difference of the logarithmic levels of both sides, relative to maximum effort, and
    e_c that of maximum effort itself, which electrodes and skin determine. In a movement of both
    sides d_c is small; exchanged labels of one file make it -2 e_c. The warning requires d_c closer
    to -2 e_c than to 0 in every pair, by `CLOSER`, and a rms of d_c of at least `EXCHANGED_RATIO`. Of 30
    simulated persons it finds 27 in opening and closing, but 5 and 3 in one-sided movements, where
    one of 60 with correct labels is reported, too.
    """
    names = list(channels)
    pairs = [(names.index(c), names.index(c[:-2] + "_R")) for c in names
             if c.endswith("_L") and c[:-2] + "_R" in names]  # fmt: skip
    if len(pairs) < 2:
        return
    left, right = np.array(pairs).T
    high = np.log(np.max([one[2] for one in references], axis=0))
    level = np.log(own[2]) - high
    d, e = level[left] - level[right], high[left] - high[right]
    large = np.abs(d) > EXCHANGED_RATIO
    closer = np.abs(d + 2.0 * e) < np.where(large, CLOSER * np.abs(d), EXCHANGED_RATIO)
    if closer.all() and np.sqrt((d * d).mean()) > EXCHANGED_RATIO:
        ratios = ", ".join(f"{names[k][:-2]} {np.exp(x):.3g}" for k, x in zip(left, d, strict=True))
        warnings.warn(
            "left and right seem to be exchanged in the recording or in the reference: relative "
            "to maximum "
            f"effort the left channels are {ratios} times as strong as the right ones, and nearly "
            "equal if the labels of one file are exchanged. Check the labels of both",
            FeatureWarning,
            stacklevel=3,
        )


def _refuse(channels: Sequence[str], ratio: Floats, bad: np.ndarray, what: str) -> None:
    if bad.any():
        k = int(np.argmax(np.where(bad, np.abs(np.log(np.maximum(ratio, 1e-30))), -1.0)))
        raise JawError(f"channel {channels[k]} {what.format(ratio[k])}")
