"""Tests of times that are used as seconds, for drives of models and datasets in memory.

Milliseconds, counters of samples and dates in other units are recognised by their intervals: a drive
has some instants in each second.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

#: number of instants from which times are those of a sampled series
LEAST_SERIES_INSTANTS: Final = 20
LONGEST_SERIES_INTERVAL: Final = 0.2  #: largest interval of a sampled series [s]
LONGEST_DRIVE_INTERVAL: Final = 5.0  #: largest interval of a drive of few levels [s]
#: duration of a series from which its unit is doubted if it is coarse [s]
LONG_SERIES: Final = 60.0
COARSE_INTERVAL: Final = 0.02  #: interval from which a long series is coarse [s]


def too_slow(times: NDArray[np.float64]) -> tuple[float, float] | None:
    """Median interval of ascending times, and the largest one expected [s]; None if it is usual."""
    if times.size < 2:
        return None
    middle = float(np.median(np.diff(times)))
    most = (
        LONGEST_SERIES_INTERVAL if times.size >= LEAST_SERIES_INSTANTS else LONGEST_DRIVE_INTERVAL
    )
    return (middle, most) if middle > most else None


def long_and_coarse(times: NDArray[np.float64]) -> tuple[float, float] | None:
    """Duration and median interval [s] of times that may be in milliseconds; None for others."""
    if times.size < 2:
        return None
    lasts, middle = float(times[-1] - times[0]), float(np.median(np.diff(times)))
    return (lasts, middle) if lasts > LONG_SERIES and middle > COARSE_INTERVAL else None


def without_unit(times: NDArray[np.float64], what: str) -> str | None:
    """Sentence on times without a unit that may be in milliseconds, or None if they can be seconds.

    The unit is asked for only where the intervals leave a doubt. `what` names the dataset.
    """
    if too_slow(times) is None and long_and_coarse(times) is None:
        return None
    lasts, middle = float(times[-1] - times[0]), float(np.median(np.diff(times)))
    return (
        f"{what} has {times.size} instants every {middle:.4g}, {lasts:.6g} in all, and states no unit "
        "of its time, expected 's' if these are seconds: divide times in milliseconds by 1000, and set "
        "the attribute units of the time to 's'"
    )
