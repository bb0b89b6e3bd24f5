"""EMG that was rectified or smoothed before it was exported."""

from typing import Final

import numpy as np

from emgface.recordings.findings import Finding
from emgface.recordings.quality.hum import LEAST_DURATION, power_density

ENVELOPE_FREQUENCY: Final = 20.0
"""Frequency [Hz] below which an envelope has its power, and raw surface EMG has little."""
#: share of the power below `ENVELOPE_FREQUENCY` from which a channel is an envelope
MOSTLY: Final = 0.8
LEAST_NOISE_V: Final = 0.5e-6
"""Root mean square [V] above 20 Hz that every electrode on the skin exceeds by its noise."""
#: distance from an extreme, over that of the median from it, of samples near it
NEAR_EXTREME: Final = 0.1
CROWDED_SHARE: Final = (
    0.02  #: part of the samples near an extreme above which the signal ends there
)
SPARSE_SHARE: Final = 0.002  #: part of the samples near an extreme below which the signal has tails
LEAST_SPECTRUM_SAMPLES: Final = 160  #: samples from which a channel can be judged


def processing(name: str, values: np.ndarray, rate: float) -> Finding | None:
    """Return the finding on a channel (samples,) [V] that is not raw EMG, None for raw EMG.

    Raw EMG has both signs about its offset, and few samples near its extremes. A channel of one sign
    that reaches zero is rectified, as is one with many samples just beyond one extreme and few near
    the other, whatever its offset. One with most of its power below `ENVELOPE_FREQUENCY` is an
    envelope or a moving average, if it is of one sign or lacks the noise of an electrode. Samples may
    be NaN.
    """
    finite = values[np.isfinite(values)]
    if (
        finite.size < LEAST_SPECTRUM_SAMPLES
        or not rate > 4 * ENVELOPE_FREQUENCY
        or finite.min() == finite.max()
    ):
        return None
    if finite.max() <= 0.0:
        finite = -finite
    one_sign = finite.min() >= 0.0
    if finite.size >= LEAST_DURATION * rate:
        frequency, density = power_density(finite, rate)
        share = float(density[frequency < ENVELOPE_FREQUENCY].sum() / density.sum())
        above = float(
            np.sqrt(np.trapezoid(density[frequency >= 2 * ENVELOPE_FREQUENCY], dx=frequency[1]))
        )
        lacking = f"has only {above * 1e6:.2g} uV above {2 * ENVELOPE_FREQUENCY:g} Hz, "
        lacking += "less than any electrode,"
        if share > MOSTLY and (one_sign or above < LEAST_NOISE_V):
            why = "is never negative" if one_sign else lacking
            return Finding(
                "envelope",
                "channel",
                name,
                {"share": share, "below": ENVELOPE_FREQUENCY, "why": why},
            )
    if one_sign and finite.min() < 0.5 * float(np.std(finite)):
        why = "is never negative and touches zero"
        return Finding("rectified", "channel", name, {"why": why})
    if any(_has_floor(sign * finite) for sign in (1.0, -1.0)):
        why = "has a limit on one side that it often touches"
        return Finding("rectified", "channel", name, {"why": why})
    return None


def _has_floor(values: np.ndarray) -> bool:
    """Return True if many samples are just above the smallest one and few just below the largest.

    A clipped signal has more samples at the smallest value than just above it.
    """
    low, middle, high = float(values.min()), float(np.median(values)), float(values.max())
    above = float(np.mean((values > low) & (values < low + NEAR_EXTREME * (middle - low))))
    below = float(np.mean(values > high - NEAR_EXTREME * (high - middle)))
    return above > max(CROWDED_SHARE, float(np.mean(values == low))) and below < SPARSE_SHARE
