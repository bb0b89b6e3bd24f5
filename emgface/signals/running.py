"""Running counts and sums over sliding windows, in a time that does not depend on their length.

Source of the count: Eskes et al. 2017, Eq. 7.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def running_willison(signal: Array, window: int, threshold: float, *, inclusive: bool) -> Array:
    """Willison amplitude of every window of N = `window` samples, at intervals of one sample.

    out[t] = sum over n = 1..N-1 of [|s(t+n-1) - s(t+n)| >= threshold], or > if not `inclusive`, with
    2 <= N <= samples; `signal` (samples,) and threshold in [V]. Returns (samples - N + 1,) counts
    [1].
    """
    step = np.abs(np.diff(signal))
    reached = step >= threshold if inclusive else step > threshold
    count = np.concatenate([[0], np.cumsum(reached)])
    return (count[window - 1 :] - count[: 1 - window]).astype(np.float64)


def running_sum(values: Array, window: int) -> Array:
    """Sum of every window of non-negative values, at intervals of one sample, without subtraction.

    Each window of N samples, 1 <= N <= samples, spans at most two consecutive blocks of N samples:
    its sum is that of the end of one block and the start of the next. Without subtraction, sums of
    small values after a burst keep their accuracy. Returns (samples - N + 1,) sums.
    """
    n = len(values)
    blocks = np.zeros(-(-n // window) * window)
    blocks[:n] = values
    blocks = blocks.reshape(-1, window)
    tail = np.cumsum(blocks[:, ::-1], axis=1)[:, ::-1].ravel()
    head = np.zeros_like(blocks)
    head[:-1, 1:] = np.cumsum(blocks[1:, :-1], axis=1)
    return (tail + head.ravel())[: n - window + 1]
