"""Smallest and largest value of a signal over bins of time, for drawing long recordings."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from emgface.pictures.encoding import packed

Floats = NDArray[np.float64]

BUDGET: Final = 3_000_000  #: largest size of all bins of a page before compression [bytes]
GAP: Final = -32768  #: value of a bin without a sample
LARGEST_INT16: Final = 32767
MOST_BINS: Final = 4096  #: largest number of bins of a detail that a page may ask for


@dataclass(frozen=True)
class Bins:
    """Bins of equal numbers of samples.

    Attributes
    ----------
    size : int
        Number of samples in a bin.
    low, high : arrays (rows, bins) of int16
        Smallest and largest value in units of `scale`; `GAP` where a bin has no number.
    scale : array (rows,)
        Value of one unit of each row.
    """

    size: int
    low: NDArray[np.int16]
    high: NDArray[np.int16]
    scale: Floats


def bins_of(rows: Iterable[Floats], size: int, scale: Floats | None = None) -> Bins:
    """Bins of `size` samples of each row (samples,); the last may be shorter.

    The rows are used one after the other, because a recording may fill the memory. `scale` is by
    default the largest absolute value of a row over `LARGEST_INT16`.
    """
    lows, highs = list[Floats](), list[Floats]()
    for row in rows:
        starts = np.arange(-(-len(row) // size)) * size
        finite = np.isfinite(row)
        lows.append(np.minimum.reduceat(np.where(finite, row, np.inf), starts))
        highs.append(np.maximum.reduceat(np.where(finite, row, -np.inf), starts))
    low, high = np.array(lows, dtype=np.float64), np.array(highs, dtype=np.float64)
    units = scale
    if units is None:
        both = np.abs(np.concatenate([low, high], axis=1))
        most = np.where(np.isfinite(both), both, 0.0).max(axis=1, initial=0.0)
        units = np.maximum(most, np.finfo(np.float32).tiny) / LARGEST_INT16
    return Bins(size, _rounded(low, units), _rounded(high, units), units)


def _rounded(values: Floats, scale: Floats) -> NDArray[np.int16]:
    finite = np.isfinite(values)
    units = np.clip(np.where(finite, values, 0.0) / scale[:, None], -LARGEST_INT16, LARGEST_INT16)
    return np.where(finite, np.round(units), GAP).astype(np.int16)


def coarse_enough(rows: int, samples: int) -> int:
    """Smallest size of bins with which the rows of a page stay within `BUDGET`."""
    each = 2 if rows * samples * 2 <= BUDGET else 4  # bins of one sample have one value
    return max(1, -(-rows * samples * each // BUDGET))


def as_data(bins: Bins) -> dict[str, Any]:
    """Bins for JSON; low bytes before high bytes, differences along time."""
    return {
        "size": bins.size,
        "bins": bins.low.shape[1],
        "scale": bins.scale.tolist(),
        "low": _planes(bins.low),
        "high": "" if bins.size == 1 else _planes(bins.high),
    }


def _planes(values: NDArray[np.int16]) -> str:
    with np.errstate(over="ignore"):
        change = np.diff(values, axis=1, prepend=np.zeros((len(values), 1), dtype=np.int16))
    planes = np.frombuffer(change.astype("<i2").tobytes(), dtype=np.uint8).reshape(-1, 2)
    return packed(np.concatenate([planes[:, 0], planes[:, 1]]))
