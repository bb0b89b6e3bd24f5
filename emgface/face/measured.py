"""Measured lip positions during a simulation."""

import warnings

import numpy as np
import xarray as xr

from analysis.noise import marker_noise, unit_noise
from analysis.trajectory import measured_span
from emgface.errors import FeatureWarning, MarkerError, UnitsError, listed
from emgface.muscles import LIP_MARKERS
from emgface.recordings.head import LARGEST_RATIO, in_head_frame
from emgface.signals.doubtful import little_in_common
from emgface.signals.parameters import HeadFrameParameters
from emgface.signals.resampling import resample


def measured_during(
    recording: xr.Dataset,
    motion: xr.Dataset,
    face: xr.Dataset,
    head_frame: HeadFrameParameters,
) -> xr.Dataset:
    """Compute measured lip positions in the frame of the face during the simulation of one trial.

    The face markers of `face` determine the head frame. The result contains ``position(marker,
    axis, time)`` [m] at all instants [s] of the simulation, NaN before the first and after the last
    frame with all lip markers; ``noise(marker)`` [m] of the recorded frames in the head frame; and
    ``white(probe, time)`` [1], white noise interpolated in the same way, for the noise of
    interpolated positions. Warns if sEMG and markers have little time in common, such as markers of
    half the rate. Raises MarkerError or SignalError if markers are missing, lost too long, mirrored, or
    not recorded during the simulation.
    """
    absent = [m for m in LIP_MARKERS if "position" not in recording or m not in recording["marker"]]
    if absent:
        raise MarkerError(
            f"the recording has no lip marker {listed(absent)}, expected all of them for a score: "
            "choose a recording with the positions of the lips, or name its markers with a mapping"
        )
    check_motion(motion, face)
    for finding in little_in_common(recording):
        warnings.warn(finding.clause, FeatureWarning, stacklevel=2)
    pace = [name for name in ("recorded_start", "recorded_pace") if name not in motion.attrs]
    if pace:
        raise MarkerError(
            f"the motion does not state {listed(pace)}, expected a trajectory of 'simulate', which was "
            "computed from the sEMG of a recording"
        )
    head = in_head_frame(recording["position"], head_frame, face["face_marker_position"])
    lips = head.sel(marker=list(LIP_MARKERS))
    check_lips(lips)
    simulated = motion["time"].values
    times = motion.attrs["recorded_start"] + motion.attrs["recorded_pace"] * simulated
    seen = lips.isel(time_marker=measured_span(lips))
    frames = seen["time_marker"].values
    # The activation may end between two frames; rounding must not extend it beyond the last frame.
    covered = np.zeros(len(times), dtype=bool)
    if frames.size:
        covered = (times >= frames[0] - 1e-9) & (times <= frames[-1] + 1e-9)
    if covered.sum() < 2:
        when = f"from {frames[0]:.4g} to {frames[-1]:.4g} s" if frames.size else "at no instant"
        raise MarkerError(
            f"all lip markers are visible {when}, the motion was simulated for "
            f"{times[0]:.4g} to {times[-1]:.4g} s of the recording: expected the recording "
            "from which the activation was computed, with its markers"
        )
    coords = {"time": ("time", simulated, {"units": "s"})}

    def at_simulated(data: xr.DataArray) -> xr.DataArray:
        sampled = resample(data, times[covered], dim="time_marker")
        values = np.full((*sampled.shape[:-1], len(times)), np.nan)
        values[..., covered] = sampled.values
        return xr.DataArray(values, dims=sampled.dims).assign_coords(coords)

    position = at_simulated(seen).assign_coords(marker=seen["marker"], axis=seen["axis"])
    white = xr.DataArray(
        unit_noise(frames.size), dims=("probe", "time_marker"), coords={"time_marker": frames}
    )
    keep = ("volunteer", "instruction", "repetition", "origin", "world")
    attrs = {name: recording.attrs[name] for name in keep if name in recording.attrs}
    attrs |= {k: head.attrs[k] for k in ("residual_rms", "bridged") if k in head.attrs}
    return xr.Dataset(
        {
            "position": position.assign_attrs(units="m"),
            "noise": marker_noise(lips),
            "white": at_simulated(white).assign_attrs(units="1"),
        },
        attrs=attrs,
    )


def check_motion(motion: xr.Dataset, face: xr.Dataset) -> None:
    """Refuse a motion whose lips have another size than those of the face, or exchanged names.

    Correlations do not depend on the unit of the positions, but amplitudes and distances do. Raises
    UnitsError and MarkerError.
    """
    if not {"marker_node", "position"} <= set(face.variables) or "marker" not in motion.coords:
        return
    names = [name for name in LIP_MARKERS if name in motion["marker"].values]
    if len(names) < len(LIP_MARKERS):
        return  # of other points, such as those of a jaw
    node = face["marker_node"].sel(marker=names).values
    rest = face["position"].values[node]
    position = motion["position"].sel(marker=names).transpose("marker", "axis", "time")
    sizes = [float(np.sqrt(((x - x.mean(axis=0)) ** 2).sum(axis=1).mean()))
             for x in (rest, position.values[:, :, 0])]  # fmt: skip
    if not sizes[0] / LARGEST_RATIO < sizes[1] < sizes[0] * LARGEST_RATIO:
        raise UnitsError(
            f"the lip markers of the motion are {sizes[1]:.3g} m (rms) from their centre, those of the "
            f"face {sizes[0]:.3g} m, expected at most a factor of {LARGEST_RATIO:g}: check the unit of "
            "its positions, and whether it is a motion of this face"
        )
    check_lips(position.rename(time="time_marker"), "motion")


def check_lips(lips: xr.DataArray, what: str = "recording or its sidecar") -> None:
    """Refuse lip markers whose names are exchanged (axis x points to the right, z upwards).

    On average, those of the left are to the left of those of the right, and those of the upper lip above
    those of the lower; markers that are never visible are not checked.
    """
    mean = lips.mean("time_marker")
    for axis, first, second, where in (
        ("x", "left", "right", "to the right of"),
        ("z", "lower", "upper", "above"),
    ):
        for name in (one for one in LIP_MARKERS if first in one):
            other = name.replace(first, second)
            apart = float((mean.sel(marker=other) - mean.sel(marker=name)).sel(axis=axis))
            if apart < 0:
                raise MarkerError(
                    f"{other} is not {where} {name}, but {-1e3 * apart:.3g} mm to the other side on "
                    f"average: exchange the two names in the {what}"
                )
