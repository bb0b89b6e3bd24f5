"""Congruence R'KR of a symmetric matrix on fixed patterns."""

import numpy as np
from numpy.typing import NDArray

from sim._kernels.options import kernel

Array = NDArray[np.float64]
Places = NDArray[np.int32]


@kernel
def congruence(
    K: Array,
    R: Array,
    place: Places,
    entry: Places,
    target: Places,
    left: Places,
    right: Places,
    out: Array,
) -> None:
    """Add R'KR to `out`: entries that are copied, and products left K right.

    K are values of the upper triangle over points. `place` is the position of each entry that is
    copied, -1 for the others; `entry`, `target`, `left` and `right` are, for every product R[left]
    K[entry] R[right], the positions in K, in `out` and in R.
    """
    for e in range(len(place)):
        if place[e] >= 0:
            out[place[e]] += K[e]
    for k in range(len(entry)):
        out[target[k]] += R[left[k]] * K[entry[k]] * R[right[k]]
