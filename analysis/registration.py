"""Registration of motions of the same movement in time, and their mean.

A mean over repetitions or persons whose movements begin at different instants would be flatter and
longer than each of them; each is therefore aligned first by `analysis.align.align`.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from analysis.align import align
from analysis.errors import AlignmentError, AnalysisError
from analysis.lag import within_lags
from analysis.trajectory import SMALLEST_MOTION, checked, measured_span
from analysis.trajectory import motion as motion_of
from analysis.typed import coordinates, relabelled

#: number of alignments of all motions: with one of them, then with their mean
ALIGNMENT_ROUNDS: Final = 2


def hold_ends(position: xr.Dataset | xr.DataArray) -> xr.DataArray:
    """Hold every marker before the first and after the last instant with all markers visible.

    Positions have the dims (marker, axis, time) [m]; gaps between these instants remain.
    """
    data = checked(position, "given")
    seen, values = measured_span(data), data.values.copy()
    if seen.stop > seen.start:
        values[:, :, : seen.start] = values[:, :, seen.start, None]
        values[:, :, seen.stop :] = values[:, :, seen.stop - 1, None]
    return data.copy(data=values)


def displacement(position: xr.Dataset | xr.DataArray) -> xr.DataArray:
    """Positions of markers from their own mean over time, x(t) - mean x [m], after `hold_ends`."""
    data = hold_ends(position)
    moved = data - data.mean("time")
    return moved.assign_attrs(units="m")


def registered(
    motions: Sequence[xr.Dataset | xr.DataArray],
    reference: xr.Dataset | xr.DataArray,
    options: Mapping[str, Any] | None = None,
) -> list[xr.DataArray | None]:
    """Align motions with a reference and interpolate them at its instants.

    Parameters
    ----------
    motions : sequence of xarray.Dataset or xarray.DataArray
        Positions, dims (marker, axis, time) [m], the same markers.
    reference : xarray.Dataset or xarray.DataArray
        Motion with which all others are aligned.
    options : mapping, optional
        Of `analysis.align.align`.

    Returns
    -------
    list of xarray.DataArray or None
        Displacements (marker, axis, time) [m] at the times of the reference, held before the first
        and after the last recorded instant; None for a motion that cannot be aligned.
    """
    displacements: list[xr.DataArray | None] = []
    for motion in motions:
        try:
            aligned = align(motion, reference, **dict(options or {}))["position"]
        except AnalysisError:
            displacements.append(None)
            continue
        displacements.append(displacement(aligned))
    return displacements


def mean_motion(
    motions: Sequence[xr.Dataset | xr.DataArray], options: Mapping[str, Any] | None = None
) -> xr.DataArray:
    """Mean of motions after registration in time.

    mean(t) = 1/n sum_k (x_k(t) - mean x_k), each x_k aligned with the motion of median size, then
    with the mean of the first round. The order of the motions does not matter.

    Parameters
    ----------
    motions : sequence of xarray.Dataset or xarray.DataArray
        Positions, dims (marker, axis, time) [m], the same markers.
    options : mapping, optional
        Of `analysis.align.align`.

    Returns
    -------
    xarray.DataArray
        Displacements (marker, axis, time) [m] at the times of the motion of median size. Attribute
        ``contributors``: number of motions in the mean, without those that cannot be aligned.

    Raises
    ------
    AlignmentError
        No motion is given, or none moves.
    """
    least = float(dict(options or {}).get("smallest_motion", SMALLEST_MOTION))
    sizes = [motion_of(hold_ends(each)) for each in motions]
    moving = sorted((size, k) for k, size in enumerate(sizes) if size >= least)
    if not moving:
        raise AlignmentError(
            f"none of {len(motions)} motions moves by {least:.2g} m: expected at least one that does"
        )
    reference = displacement(motions[moving[(len(moving) - 1) // 2][1]])
    for _ in range(ALIGNMENT_ROUNDS):
        kept = [one for one in registered(motions, reference, options) if one is not None]
        if not kept:
            raise AlignmentError(
                f"none of {len(motions)} motions can be aligned: expected at least one without gaps"
            )
        mean = np.mean([one.values for one in kept], axis=0)
        reference = kept[0].copy(data=mean).assign_attrs(contributors=len(kept))
    return reference


def retimed(
    position: xr.DataArray, time: xr.DataArray, *, shift: float, scale: float
) -> xr.DataArray:
    """Transform the times of a motion by the shift and scale of an alignment.

    x'(t) = x(t_m), t - t[0] = scale (t_m - t_m[0]) + shift, at the instants `time` [s]; held before
    the first and after the last sample.
    """
    t_m, t = position["time"].values, np.asarray(time.values, dtype=np.float64)
    _, source = within_lags(t_m[0] + (t - t[0] - shift) / scale, t_m)
    values = CubicSpline(t_m, position.transpose("marker", "axis", "time").values, axis=2)(source)
    moved = xr.DataArray(values, dims=("marker", "axis", "time"), attrs=dict(position.attrs))
    labels = coordinates(position)
    coords = {name: labels[name] for name in ("marker", "axis") if name in labels}
    return relabelled(moved, {**coords, "time": ("time", t, {"units": "s"})})
