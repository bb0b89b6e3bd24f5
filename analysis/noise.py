"""Noise of marker positions, and the attenuation of a correlation by noise."""

from math import comb
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from analysis.trajectory import require_real

Array = NDArray[np.float64]

DIFFERENCE_ORDER: Final = 3  #: order of the differences from which the noise is estimated
SMALLEST_SNR: Final = 1.0
"""Ratio of the variances of motion and noise below which a marker is regarded as not moving.

At this ratio, noise lowers a correlation by the factor 0.71. The estimated ratio of a marker at
rest has mean 0 and standard deviation 0.15 (180 frames), so that none of a thousand exceeds the
threshold.
"""
PROBES: Final = 64  #: number of rows of white noise for the effect of the sampling
#: least number of differences of a marker for an estimate of its noise
LEAST_DIFFERENCES: Final = 8


def noise_level(values: Array) -> float:
    """Noise of one marker, from differences of successive frames.

    sigma^2 = sum over axes of (median |D^k x| / 0.6745)^2 / C(2k, k), k = 3

    A difference of order k multiplies a motion of frequency f by (2 sin(pi f / rate))^k and the
    variance of white noise by C(2k, k), so that motion far below the frame rate is removed. The
    median limits the effect of leaps; 0.6745 is that of |x| for a normal distribution of variance
    one.

    `values` (axis, time) are positions at uniform instants, in any unit of length; NaN where the
    marker is not visible. Returns the root mean square of the noise of all axes together, in the
    same unit; NaN with fewer than 8 finite differences.

    From 180 frames of white noise the estimate scatters by 7 % (three axes). A motion of 5 mm and 2
    Hz adds 0.4 um at 100 frames a second, 17 um at 30. Noise that a tracker has smoothed over
    several frames is underestimated.
    """
    difference = np.diff(values, DIFFERENCE_ORDER, axis=1)
    difference = difference[:, np.isfinite(difference).all(axis=0)]
    if difference.shape[1] < LEAST_DIFFERENCES:
        return float("nan")
    spread = np.median(np.abs(difference), axis=1) / 0.6745
    return float(np.sqrt(np.sum(spread**2) / comb(2 * DIFFERENCE_ORDER, DIFFERENCE_ORDER)))


def marker_noise(position: xr.DataArray) -> xr.DataArray:
    """Noise of every marker by `noise_level`.

    Parameters
    ----------
    position : xarray.DataArray
        Dims (marker, axis, and one of time) [m], uniformly sampled as recorded: resampling
        changes the noise.

    Returns
    -------
    xarray.DataArray
        Root mean square of the three axes together [m], dims (marker); NaN if the instants are not
        uniform.
    """
    time = next(dim for dim in position.dims if dim not in ("marker", "axis"))
    require_real(position, "positions")
    require_real(position[time], "time")
    ordered = position.transpose("marker", "axis", time)
    levels = [noise_level(np.asarray(values, dtype=np.float64)) for values in ordered.values]
    steps = np.diff(np.asarray(position[time].values, dtype=np.float64))
    if steps.size and not np.allclose(steps, steps.mean(), rtol=0.01, atol=0.0):
        levels = [float("nan")] * len(levels)
    attrs = {"units": "m", "long_name": "noise of the marker, three axes together"}
    return xr.DataArray(levels, coords={"marker": position["marker"]}, dims="marker", attrs=attrs)


def unit_noise(frames: int) -> Array:
    """Reproducible white noise of variance one, shape (64, frames), for the effect of the sampling.

    The variance of 160 samples of all rows is known to 1.4 %.
    """
    return np.random.default_rng(0).standard_normal((PROBES, frames))


def sampled_share(white: Array | None, time: Array, source: Array) -> float:
    """Mean variance of white noise after sampling by a cubic spline, relative to that of the frames [1].

    It is about 1 if every instant is a frame and 0.76 half-way between frames. `white` (probe,
    time) is `unit_noise` of the recorded frames, sampled like the given samples; if absent, each
    sample is a frame. `time` are the instants of the given samples, and `source` those at which the
    spline is evaluated [s].
    """
    given = unit_noise(len(time)) if white is None else white
    read = CubicSpline(time, given, axis=1)(source)
    return float((read**2).mean())


def attenuation(size: xr.DataArray, noise: xr.DataArray) -> xr.DataArray:
    """Factor by which noise on one trajectory lowers its correlation with another.

    sqrt(S / (S + N)),  S = max(0, V - N)

    V is the variance of the measured trajectory and N that of its noise, both summed over the axes.
    Noise that is independent of the other trajectory adds to V and not to the covariance.

    Parameters
    ----------
    size, noise : xarray.DataArray
        Roots of V and N [m].

    Returns
    -------
    xarray.DataArray
        Factor from 0 to 1 [1].

    Notes
    -----
    Spearman 1904, Am J Psychol 15:72-101: the factor is the root of the reliability. It is an
    expectation; no score is corrected by it.
    """
    total, white = size**2, noise**2
    motion = (total - white).clip(min=0.0)
    share = (motion / total.where(total > 0)) ** 0.5
    share = share.where(total.isnull() | noise.isnull() | (total > 0), 0.0)
    share.attrs = {"units": "1", "long_name": "expected attenuation of rho by noise"}
    return share.rename("attenuation")
