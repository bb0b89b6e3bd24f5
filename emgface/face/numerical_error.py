"""Estimate of the numerical error of a motion."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def largest_motion(trajectory: xr.Dataset) -> float:
    """Largest distance of a marker from its initial position [m], ``position(marker, axis, time)``."""
    moved = trajectory["position"] - trajectory["position"].isel(time=0)
    return float((moved**2).sum("axis").max() ** 0.5)


def accumulated(errors: Floats, time: Floats, memory: float) -> Floats:
    """Accumulate errors (n_times, ...): e(t + h) = exp(-h/memory) e(t) + error of the step.

    Without a memory [s], errors do not last.
    """
    h = np.diff(time)
    keep = np.exp(-h / memory) if memory > 0.0 else np.zeros(len(h))
    out = errors.copy()
    for k in range(1, len(out)):
        out[k] += keep[k - 1] * out[k - 1]
    return out


def numerical_error(
    step_error: xr.DataArray,
    memory: float,
    iteration_error: xr.DataArray | None = None,
    input_error: xr.DataArray | None = None,
    passing_error: xr.DataArray | None = None,
) -> xr.DataArray:
    """Accumulate the errors of the steps with exponential decay: ``(time,)`` [m], largest marker.

    They are `accumulated` per marker and axis. The length of the same sum
    of the lasting errors by the activation that the lines of steps miss, that of the passing one of the
    step, and the sum of the iteration errors are added.

    `step_error`, `input_error` and `passing_error` (marker, axis, time) [m] are recorded by
    `sim.StepErrors`; the result is NaN if the integrator has no estimate. `memory` [s] is the time
    within which a disturbance decays: beta for tissue with stiffness damping, since a mode much slower
    than its inertia relaxes as exp(-t/beta); 0 for no accumulation. `iteration_error` (time) [m] bounds
    the error of a position at the end of the iteration. The estimate excludes the error of the mesh and
    contact (`emgface.face.event_error`). ``python -m benchmarks error_coverage`` measures how
    often it holds for activations from EMG, and with ``--hard`` for switches and spikes
    (docs/accuracy.md).
    """
    values = step_error.transpose("time", "marker", "axis").values
    time = step_error["time"].values
    left = np.zeros(len(values)) if iteration_error is None else iteration_error.values
    missed, passing = (
        np.zeros_like(values) if one is None else one.transpose("time", "marker", "axis").values
        for one in (input_error, passing_error)
    )
    error, missed, left = (accumulated(one, time, memory) for one in (values, missed, left))
    lengths = np.sum([np.linalg.norm(part, axis=2) for part in (error, missed, passing)], axis=0)
    largest = lengths.max(axis=1) + left
    return xr.DataArray(
        largest, dims="time", coords={"time": step_error["time"]}, attrs={"units": "m"}
    )
