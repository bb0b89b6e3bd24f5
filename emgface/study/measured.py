"""Measured lip positions while a simulation lasts."""

import xarray as xr

from emgface.errors import MarkerError
from emgface.muscles import LIP_MARKERS
from emgface.recordings.head import in_head_frame
from emgface.signals.parameters import HeadFrameParameters
from emgface.signals.resampling import resample


def measured_during(
    recording: xr.Dataset,
    motion: xr.Dataset,
    face: xr.Dataset,
    head_frame: HeadFrameParameters,
) -> xr.Dataset:
    """Measured lip positions in the frame of the face, while the simulation lasts.

    Parameters
    ----------
    recording, motion : Dataset
        Of one trial.
    face : Dataset
        Face model, whose face markers give the head frame.
    head_frame : HeadFrameParameters
        How the head's motion is removed.

    Returns
    -------
    Dataset
        ``position(marker, axis, time)`` [m], time [s] as simulated, sampled with its period.

    Raises
    ------
    MarkerError, SignalError
        If markers are missing or lost too long, or do not cover the time.
    """
    head = in_head_frame(recording["position"], head_frame, face["face_marker_position"])
    lips = head.sel(marker=list(LIP_MARKERS))
    simulated, frames = motion["time"].values, lips["time_marker"].values
    times = motion.attrs["recorded_start"] + motion.attrs["recorded_pace"] * simulated
    # The activation may end between two frames: rounding must not ask for one beyond the last.
    covered = (times >= frames[0] - 1e-9) & (times <= frames[-1] + 1e-9)
    if not covered.any():
        raise MarkerError(
            f"markers were recorded from {frames[0]:.4g} to {frames[-1]:.4g} s, the motion was "
            f"simulated for {times[0]:.4g} to {times[-1]:.4g} s of the recording: expected the "
            "recording that the activation came from"
        )
    sampled = resample(lips, times[covered], dim="time_marker")
    sampled = sampled.assign_coords(time=("time", simulated[covered], {"units": "s"}))
    sampled.attrs = {"units": "m"}
    keep = ("volunteer", "instruction", "repetition", "origin")
    attrs = {name: recording.attrs[name] for name in keep if name in recording.attrs}
    attrs |= {k: head.attrs[k] for k in ("residual_rms", "bridged") if k in head.attrs}
    return sampled.to_dataset(name="position").assign_attrs(attrs)
