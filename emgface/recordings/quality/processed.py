"""EMG that was rectified or smoothed before it was exported."""

from typing import Final

import numpy as np

from emgface.recordings.findings import Finding
from emgface.recordings.quality.hum import LEAST_DURATION, power_density

ENVELOPE_FREQUENCY: Final = 20.0
"""Frequency [Hz] below which an envelope has its power, and raw surface EMG has little."""
#: share of the power below `ENVELOPE_FREQUENCY` from which a channel is an envelope
MOSTLY: Final = 0.8
LEAST_SPECTRUM_SAMPLES: Final = 160  #: samples from which a channel can be judged


def processing(name: str, values: np.ndarray, rate: float) -> Finding | None:
    """Return the finding on a channel (samples,) [V] that is not raw EMG, None for raw EMG.

    Raw EMG has both signs about its offset. A channel of one sign that reaches zero is rectified; one
    of one sign with most of its power below `ENVELOPE_FREQUENCY` is an envelope or a moving
    average. The sign may be negative, and samples may be NaN.
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
    if finite.min() < 0.0:
        return None
    if finite.size >= LEAST_DURATION * rate:
        frequency, density = power_density(finite, rate)
        share = float(density[frequency < ENVELOPE_FREQUENCY].sum() / density.sum())
        if share > MOSTLY:
            return Finding(
                "envelope", "channel", name, {"share": share, "below": ENVELOPE_FREQUENCY}
            )
    if finite.min() < 0.5 * float(np.std(finite)):
        return Finding("rectified", "channel", name)
    return None
