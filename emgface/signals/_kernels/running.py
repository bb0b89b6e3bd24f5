"""Running counts and sums over sliding windows: O(samples) for any window.

Source of the count: Eskes et al. 2017, Eq. 7.
"""

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def running_willison(
    signal: np.ndarray, window: int, threshold: float, inclusive: bool, out: np.ndarray
) -> None:
    """Willison amplitude of every window of `window` samples, at intervals of one sample.

    out[t] = sum over n = 1..N-1 of [|s(t+n-1) - s(t+n)| >= threshold], or > if not inclusive, with
    2 <= N <= samples; `signal` (samples,) and threshold in [V], `out` (samples - N + 1,) [1] is
    written.
    """
    count = 0
    for j in range(signal.size - 1):
        step = abs(signal[j] - signal[j + 1])
        if step > threshold or (inclusive and step == threshold):
            count += 1
        # A window of N samples has N - 1 differences; that at j is the last of window j - N + 2.
        first = j - window + 2
        if first >= 0:
            out[first] = count
            step = abs(signal[first] - signal[first + 1])
            if step > threshold or (inclusive and step == threshold):
                count -= 1


@njit(cache=True, error_model="numpy")
def running_sum(values: np.ndarray, window: int, out: np.ndarray) -> None:
    """Sum of every window of non-negative values, at intervals of one sample, without subtraction.

    Each window of N samples, 1 <= N <= samples, spans at most two consecutive blocks of N samples:
    its sum is that of the end of one block and the start of the next. Without subtraction, sums of
    small values after a burst keep their accuracy. `out` (samples - N + 1,) is written.
    """
    n = values.size
    tail = np.empty(window)
    for start in range(0, n - window + 1, window):
        total = 0.0
        for k in range(window - 1, -1, -1):
            total += values[start + k]
            tail[k] = total
        out[start] = tail[0]
        head = 0.0
        for k in range(1, window):
            if start + window + k - 1 >= n:
                break
            head += values[start + window + k - 1]
            out[start + k] = tail[k] + head
