"""Measures of a motion beyond the mean of other people: timing, asymmetry, variation.

Most of the path of a marker is determined by the instruction and equal in all persons; these
measures differ between persons and between trials.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from analysis.align import align
from analysis.errors import AnalysisError
from analysis.registration import hold_ends, mean_motion, registered, retimed
from analysis.trajectory import SMALLEST_MOTION, checked, same_markers

Array = NDArray[np.float64]

ONSET: Final = 0.2  #: fraction of the largest displacement that defines the onset of a movement
CUTOFF: Final = 10.0
"""Low-pass edge [Hz] of the displacement for the instants, as in the alignment."""


def instants(
    position: xr.Dataset | xr.DataArray, *, smallest_motion: float = SMALLEST_MOTION
) -> tuple[float, float]:
    """Instants at which a movement begins and at which it is largest [s]; NaN without motion.

    s(t) = sqrt(1/M sum_m |x_m(t) - x_m(0)|^2), low-passed at 10 Hz; onset: the first s = 0.2 max s,
    interpolated linearly; peak: s = max s, interpolated by a parabola. Positions, dims (marker,
    axis, time) [m], begin at rest.
    """
    data = hold_ends(position)
    values, time = data.values, np.asarray(data["time"].values, dtype=np.float64)
    if len(time) < 3 or not np.isfinite(values).all():
        return np.nan, np.nan
    start, time = float(time[0]), time - time[0]
    grid = np.asarray(np.linspace(0.0, time[-1], len(time)), dtype=np.float64)
    if not np.allclose(time, grid, rtol=0.0, atol=1e-6 * grid[1]):
        values = CubicSpline(time, values, axis=2)(grid)
    cutoff = min(CUTOFF, 0.2 / grid[1])
    sections = butter(2, 2.0 * cutoff * grid[1], output="sos")
    values = np.asarray(sosfiltfilt(sections, values, axis=2, padlen=min(15, len(grid) - 1)))
    size = np.sqrt(((values - values[:, :, :1]) ** 2).sum(axis=1).mean(axis=0))
    top = int(np.argmax(size))
    if not size[top] >= smallest_motion:
        return np.nan, np.nan
    peak = float(grid[top])
    if 0 < top < len(grid) - 1:
        left, middle, right = size[top - 1 : top + 2]
        bend = left - 2.0 * middle + right
        peak += grid[1] * (0.5 * (left - right) / bend if bend < 0 else 0.0)
    level = ONSET * size[top]
    first = int(np.flatnonzero(size >= level)[0])  # the first sample is 0 by definition
    before, after = size[first - 1], size[first]
    onset = grid[first - 1] + grid[1] * (level - before) / (after - before)
    return start + float(onset), start + peak


def asymmetry(
    position: xr.Dataset | xr.DataArray, *, smallest_motion: float = SMALLEST_MOTION
) -> float:
    """Asymmetry of a movement, (L - R) / (L + R).

    L and R are the root-mean-square displacements about their means over time of the markers whose
    names contain ``left`` and ``right``.

    Parameters
    ----------
    position : xarray.Dataset or xarray.DataArray
        Positions, dims (marker, axis, time) [m].
    smallest_motion : float
        L + R [m] below which the markers do not move.

    Returns
    -------
    float
        1 if only the left side moves, -1 if only the right side does; NaN if nothing moves or a
        side has no marker without gaps.
    """
    data = hold_ends(position)
    names = np.array([str(name) for name in data["marker"].values])
    sizes: list[float] = []
    for side in ("left", "right"):
        of_side = data.values[np.char.find(names, side) >= 0]
        of_side = of_side[np.isfinite(of_side).all(axis=(1, 2))]
        if not len(of_side):
            return np.nan
        moved = of_side - of_side.mean(axis=2, keepdims=True)
        sizes.append(float(np.sqrt((moved**2).sum(axis=1).mean())))
    left, right = sizes
    return (left - right) / (left + right) if left + right >= smallest_motion else np.nan


Together = tuple[xr.DataArray, list[xr.DataArray | None]]
"""Mean of repetitions, and the repetitions registered with it."""


def together(
    motions: Sequence[xr.Dataset | xr.DataArray], options: Mapping[str, Any] | None = None
) -> Together:
    """Register repetitions with their mean; errors as of `mean_motion`."""
    mean = mean_motion(motions, options)
    return mean, registered(motions, mean, options)


def within_instruction(
    measured: Sequence[xr.Dataset | xr.DataArray],
    simulated: Sequence[xr.Dataset | xr.DataArray],
    options: Mapping[str, Any] | None = None,
    *,
    known: Together | None = None,
) -> xr.DataArray:
    """Correlation of the deviations of repetitions from their mean, measured with simulated.

    With D_r = v_r - mean_r v_r and E_r = w_r - mean_r w_r, displacements of a marker over axes and
    time in repetition r,

        rho_w = sum_r <D_r, E_r> / sqrt(sum_r |D_r|^2 sum_r |E_r|^2)

    Repetitions are registered in time separately among the measured and among the simulated
    motions; then the two means are aligned. No simulated motion is therefore fitted to its own
    measured one, and because the E_r sum to zero, the mean of rho_w over all orders of the
    simulated repetitions is 0. rho_w is undefined for a motion that is the same in every
    repetition, such as a template.

    Parameters
    ----------
    measured, simulated : sequence of xarray.Dataset or xarray.DataArray
        The repetitions of one person and instruction, two or more, in the same order; dims (marker,
        axis, time) [m].
    options : mapping, optional
        Of `analysis.align.align`.
    known : optional
        `together` of the measured repetitions, where several sets of simulated ones need it.

    Returns
    -------
    xarray.DataArray
        rho_w [1], dim marker; NaN with fewer than two registered repetitions, or without variation.
    """
    markers = checked(simulated[0], "simulated")["marker"].values
    nothing = xr.DataArray(
        np.full(len(markers), np.nan), dims="marker", coords={"marker": markers},
        attrs={"units": "1"}, name="within_rho",
    )  # fmt: skip
    try:
        ours, theirs = known or together(measured, options), together(simulated, options)
        fit = align(ours[0], theirs[0], **dict(options or {}))
    except AnalysisError:
        return nothing
    both = [
        (v, w) for v, w in zip(ours[1], theirs[1], strict=True) if v is not None and w is not None
    ]
    if len(both) < 2:
        return nothing
    shift, scale = float(fit["shift"]), float(fit["scale"])
    covered = np.isfinite(fit["position"].values).all(axis=(0, 1))
    w = np.stack([each.values[:, :, covered] for _, each in both])
    moved = [retimed(each, w_["time"], shift=shift, scale=scale) for each, w_ in both]
    v = np.stack([same_markers(each, both[0][1]).values[:, :, covered] for each in moved])
    # Each repetition about its own mean over time, which registration does not determine.
    v, w = (each - each.mean(axis=3, keepdims=True) for each in (v, w))
    D, E = v - v.mean(axis=0), w - w.mean(axis=0)
    product = (D * E).sum(axis=(0, 2, 3))
    size = np.sqrt((D**2).sum(axis=(0, 2, 3))) * np.sqrt((E**2).sum(axis=(0, 2, 3)))
    varies = size > 1e-12 * np.sqrt((v**2).sum(axis=(0, 2, 3)) * (w**2).sum(axis=(0, 2, 3)))
    values = np.full(len(size), np.nan)
    values[varies] = np.clip(product[varies] / size[varies], -1.0, 1.0)
    return nothing.copy(data=values)
