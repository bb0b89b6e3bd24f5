"""Estimate of the numerical error of a motion."""

import numpy as np
import xarray as xr


def largest_motion(trajectory: xr.Dataset) -> float:
    """Largest distance of a marker from its initial position [m], ``position(marker, axis, time)``."""
    moved = trajectory["position"] - trajectory["position"].isel(time=0)
    return float((moved**2).sum("axis").max() ** 0.5)


def numerical_error(
    step_error: xr.DataArray, memory: float, iteration_error: xr.DataArray | None = None
) -> xr.DataArray:
    """Accumulate the errors of the steps with exponential decay.

    e(t + h) = exp(-h/memory) e(t) + error of the step, per marker and axis; to the length of that of the
    steps the same sum of what the iterations left is added.

    Parameters
    ----------
    step_error : DataArray
        ``(marker, axis, time)`` [m], as `sim.StepErrors` records it.
    memory : float
        Time within which a disturbance dies [s]; that of tissue with stiffness damping is beta, since a
        mode much slower than its inertia relaxes as exp(-t/beta). 0: no accumulation.
    iteration_error : DataArray, optional
        ``(time,)`` [m], bound of what the iterations of a step have left of a position.

    Returns
    -------
    DataArray
        ``(time,)`` [m], the largest of all markers; NaN where the integrator has no estimate.

    Notes
    -----
    Of time stepping alone: the error of the mesh is separate. How often it holds on activations of EMG
    is measured by ``python -m benchmarks error_coverage`` (docs/accuracy.md).
    """
    values = step_error.transpose("time", "marker", "axis").values
    h = np.diff(step_error["time"].values)
    keep = np.exp(-h / memory) if memory > 0.0 else np.zeros(len(h))
    left = np.zeros(len(values)) if iteration_error is None else iteration_error.values.copy()
    error = np.zeros_like(values)
    for k in range(1, len(values)):
        error[k] = keep[k - 1] * error[k - 1] + values[k]
        left[k] += keep[k - 1] * left[k - 1]
    largest = np.linalg.norm(error, axis=2).max(axis=1) + left
    return xr.DataArray(
        largest, dims="time", coords={"time": step_error["time"]}, attrs={"units": "m"}
    )
