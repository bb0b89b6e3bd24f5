"""Activation dynamics between excitation and force.

The force of a muscle follows its EMG with a delay (electromechanical delay) and more slowly
(activation dynamics).
"""

import numpy as np
import xarray as xr

_SUBSTEPS = 4
"""Steps of the integration per sample: 0.25 ms at 1000 Hz, 1/60 of the shortest time constant."""


def activation_of_excitation(
    excitation: xr.DataArray, *, delay: float, activation_time: float, deactivation_time: float
) -> xr.DataArray:
    """Delay an excitation and apply first-order activation dynamics.

    ``da/dt = (u(t - d) - a) / T``, with ``T = T_act (0.5 + 1.5 a)`` for u > a and ``T = T_deact /
    (0.5 + 1.5 a)`` for u < a; a = u at the first sample.

    `excitation` (muscle, time_true) [1] is uniformly sampled and interpolated linearly; the delay d
    and the times T_act and T_deact are in seconds. The result stays within the range of the
    excitation and equals it if all times are 0. Source of the dynamics: Thelen 2003, J Biomech Eng
    125:70-77, Eqs 1-2. Integrated by the exact solution of ``a' = (u - a)/T`` with T of the
    midpoint, which cannot overshoot.
    """
    if not (delay or activation_time or deactivation_time):
        return excitation
    rows = excitation.transpose("muscle", "time_true")
    time = rows["time_true"].values
    late = np.stack([np.interp(time - delay, time, row) for row in rows.values])
    if activation_time or deactivation_time:
        late = _first_order(late, float(time[1] - time[0]), activation_time, deactivation_time)
    return rows.copy(data=late)


def _first_order(u: np.ndarray, period: float, rise: float, fall: float) -> np.ndarray:
    """Activation of all muscles together, shape (muscles, samples)."""
    result = np.empty_like(u)
    a = u[:, 0].copy()
    result[:, 0] = a
    h = period / _SUBSTEPS
    for k in range(1, u.shape[1]):
        step = (u[:, k] - u[:, k - 1]) / _SUBSTEPS
        for j in range(_SUBSTEPS):
            target = u[:, k - 1] + (j + 0.5) * step
            middle = target + (a - target) * _decay(a, target, 0.5 * h, rise, fall)
            a = target + (a - target) * _decay(middle, target, h, rise, fall)
        result[:, k] = a
    return result


def _decay(a: np.ndarray, target: np.ndarray, h: float, rise: float, fall: float) -> np.ndarray:
    """Fraction of the difference to the target that remains after a time h."""
    slower = 0.5 + 1.5 * a
    constant = np.where(target > a, rise * slower, fall / slower)
    with np.errstate(divide="ignore"):
        return np.exp(-h / constant)
