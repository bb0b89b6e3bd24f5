"""Alignment of a measured with a simulated trajectory in time.

Both trajectories are reduced to one coefficient vector by a principal component analysis (Eskes
et al. 2017, Eqs 9-10); the shift that maximises the correlation of the two vectors, and a linear
stretch of time, are then applied to the measured positions.

A measured instant t_m falls on the simulated instant t_s through

    t_s - t_s[0] = scale (t_m - t_m[0]) + shift ,

so a positive shift moves the measurement to later times and a scale above 1 slows it down.
"""

from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from analysis.components import first_component
from analysis.errors import AlignmentError
from analysis.lag import Array, within_lags
from analysis.matching import (
    CLEAR_COSINE,
    ComponentPair,
    Options,
    Scaling,
    Sign,
    scale_at_bound,
    signed_match,
)
from analysis.noise import SMALLEST_SNR, marker_noise, sampled_share
from analysis.trajectory import (
    SMALLEST_MOTION,
    checked,
    measured_span,
    motion,
    same_markers,
    without_gaps,
)
from analysis.typed import coordinates, selected

LEAST_SAMPLES: Final = 8  #: least number of samples of a trajectory for an alignment
WEAK_MATCH: Final = 0.7
"""Correlation of the aligned components below which they share less than half of their variance."""


def align(
    measured: xr.Dataset | xr.DataArray,
    simulated: xr.Dataset | xr.DataArray,
    *,
    scaling: Scaling = "length",
    scale_range: tuple[float, float] = (0.8, 1.25),
    scale_step: float = 0.01,
    max_shift: float | None = None,
    least_overlap: float = 0.75,
    least_gain: float = 0.2,
    cutoff: float | None = 10.0,
    sign: Sign = "direction",
    clear_cosine: float = CLEAR_COSINE,
    centred: bool = True,
    subsample: bool = True,
    smallest_motion: float = SMALLEST_MOTION,
    smallest_snr: float = SMALLEST_SNR,
) -> xr.Dataset:
    """Shift and stretch a measured trajectory in time so that it matches a simulated one.

    The correlation of the two coefficient vectors is computed at every shift over the samples that
    overlap, without padding. A farther peak is preferred to a nearer one, and a stretch to none,
    only if it lowers the unexplained variance 1 - r^2 by the fraction `least_gain`, so that noise
    and periodic movements cause neither shifts nor stretches.

    Parameters
    ----------
    measured, simulated : xarray.Dataset or xarray.DataArray
        Positions, dims (marker, axis, time) [m], the same markers in any order. Measured samples
        before the first and after the last instant with all markers visible are omitted. A measured
        dataset may contain ``noise`` (marker) [m] of the recorded frames and ``white``
        (probe, time), `analysis.noise.unit_noise` sampled in the same way; otherwise
        `analysis.noise.marker_noise` estimates the noise.
    scaling : {"length", "search", "none"}
        ``"length"``: the measured duration is stretched to the simulated one (durations that differ
        by at most one sampling period count as equal). ``"search"``: factors of `scale_range` times
        that stretch are tried. ``"none"``: scale 1.
    scale_range : (float, float)
        Bounds of the searched factors, and of a scale that is not flagged [1].
    scale_step : float
        Relative step of the factors [1]; the best one is refined between its neighbours.
    max_shift : float, optional
        Largest shift in either direction [s]; by default only `least_overlap` bounds the shift.
    least_overlap : float
        Smallest fraction of the shorter trajectory's duration that must overlap [1].
    least_gain : float
        See above [1]; 0 selects the maximum of the correlation.
    cutoff : float, optional
        Low-pass edge [Hz, simulated time] of both vectors in the search, at most a fifth of the
        slower sampling rate; None disables the filter.
    sign : {"direction", "correlation"}
        The sign of a principal component is arbitrary. ``"direction"``: the sign for which
        u_measured . u_simulated > 0, if the absolute value of that cosine reaches `clear_cosine`;
        otherwise, and with ``"correlation"``, the sign with the larger correlation, which may match
        a movement with its mirror image.
    clear_cosine : float
        See `sign` [1].
    centred : bool
        See `analysis.components.principal_component`.
    subsample : bool
        Refine shift and stretch between the samples; otherwise the shift is a multiple of the
        simulated period.
    smallest_motion : float
        Root-mean-square displacement [m] below which a trajectory does not move.
    smallest_snr : float
        Ratio of the variances of measured motion and noise below which it does not move [1].

    Returns
    -------
    xarray.Dataset
        ``position`` (marker, axis, time) [m], measured positions at the simulated times, NaN
        outside the measurement, and their ``noise`` (marker) [m]; ``shift`` [s]; ``scale`` [1];
        ``sign`` [1] of ``b_measured``; ``sign_by_direction`` [1]; ``b_correlation`` [1] of the
        aligned, filtered vectors; ``overlap`` [1], fraction of the simulated samples covered;
        ``unseen_ends`` [s], duration of the omitted samples; ``explained_variance_measured`` and
        ``explained_variance_simulated`` [1]; ``direction_cosine`` [1]; ``b_measured``
        (time_measured), ``b_simulated`` (time), ``b_aligned`` (time) [m]; and those of
        `analysis.flags.FLAGS` that an alignment determines, 0 or 1.

    Raises
    ------
    TrajectoryError
        Different markers, gaps, fewer than 8 samples, wrong dims or units.
    AlignmentError
        A trajectory does not move (the measured one: not beyond its noise), no shift leaves enough
        overlap, or an option lies outside its range.

    Notes
    -----
    Source: Eskes et al. 2017, "Synchronisation of repetitions and model output"; the bounds, the
    preference for small changes and the search for a scale are additions. With white marker noise
    the search reaches the Cramer-Rao bound of shift and scale; with the default `least_gain` it
    stretches 2 to 7 % of the 160-sample trials that need no stretch.
    """
    options = Options(
        scaling, scale_range, scale_step, max_shift, least_overlap, least_gain, cutoff, sign,
        clear_cosine, centred, subsample,
    )  # fmt: skip
    model = checked(simulated, "simulated")
    whole = same_markers(checked(measured, "measured"), model)
    seen = measured_span(whole)
    if seen.stop == 0:  # no instant with all markers
        without_gaps(whole, "measured", least=LEAST_SAMPLES)
    given = whole.isel(time=seen)
    for role, data in (("measured", given), ("simulated", model)):
        without_gaps(data, role, least=LEAST_SAMPLES)
    noise, white = _noise_of(measured, whole, seen)
    t_whole, t_m, t_s = (data["time"].values for data in (whole, given, model))
    _check_motion({"measured": given, "simulated": model}, smallest_motion)
    b_m, u_m, explained_m = first_component(given.values, centred=centred)
    _check_signal(b_m, noise * sampled_share(white, t_m, t_m) ** 0.5, smallest_snr)
    b_s, u_s, explained_s = first_component(model.values, centred=centred)
    cosine = float((u_m * u_s).sum())
    nominal = 1.0 if scaling == "none" else _length_ratio(t_whole, t_s)
    pair = ComponentPair((t_m, b_m), (t_s, b_s), float(t_whole[0]), nominal)
    chosen, best, clear, disagrees = signed_match(pair, cosine, options)

    source = t_whole[0] + (t_s - t_s[0] - best.shift) / best.scale
    inside, source = within_lags(source, t_m)
    overlap, matched = float(inside.mean()), chosen * best.r
    numbers = {
        "scale": best.scale,
        "sign": chosen,
        "sign_by_direction": int(clear and sign == "direction"),
        "b_correlation": matched,
        "overlap": overlap,
        "explained_variance_measured": explained_m,
        "explained_variance_simulated": explained_s,
        "direction_cosine": chosen * cosine,
        "sign_disagrees": int(disagrees),
        "shift_at_bound": int(best.at_bound),
        "scale_at_bound": int(scale_at_bound(best.scale, nominal, options)),
        "little_overlap": int(overlap < least_overlap * (1 - 1e-12)),
        "weak_match": int(matched < WEAK_MATCH),
    }
    metre, second = {"units": "m"}, {"units": "s"}
    coords = {name: coord for name, coord in coordinates(model).items() if name in model.dims}
    positions = _taken(given.values, t_m, source, inside)
    kept = noise * sampled_share(white, t_m, source[inside]) ** 0.5
    result = xr.Dataset(
        {
            "position": (("marker", "axis", "time"), positions, metre),
            "noise": ("marker", kept, metre),
            "shift": ((), best.shift, second),
            **{name: ((), value, {"units": "1"}) for name, value in numbers.items()},
            "unseen_ends": ((), float(np.ptp(t_whole) - np.ptp(t_m)), second),
            "b_measured": ("time_measured", chosen * b_m, metre),
            "b_simulated": ("time", b_s, metre),
            "b_aligned": ("time", chosen * _taken(b_m, t_m, source, inside), metre),
        },
        coords={**coords, "time_measured": ("time_measured", t_m, second)},
        attrs=_identity(measured, simulated) | options.recorded(),
    )
    result["time"].attrs["units"] = "s"
    result.attrs["time_mapping"] = "t_s - t_s[0] = scale (t_m - t_m[0]) + shift"
    return result


def _taken(values: Array, time: Array, source: Array, inside: NDArray[np.bool_]) -> Array:
    """Values (..., time) at the instants of the source that lie inside; NaN elsewhere."""
    resampled = np.full((*values.shape[:-1], len(source)), np.nan)
    resampled[..., inside] = CubicSpline(time, values, axis=-1)(source[inside])
    return resampled


def _noise_of(
    measured: xr.Dataset | xr.DataArray, whole: xr.DataArray, seen: slice
) -> tuple[Array, Array | None]:
    """Noise of the frames, markers as in `whole` [m], and white noise sampled in the same way."""
    if not isinstance(measured, xr.Dataset) or "noise" not in measured:
        return marker_noise(whole).values, None
    noise = selected(measured["noise"], {"marker": whole["marker"].values}).values
    if "white" not in measured:
        return noise, None
    return noise, measured["white"].transpose("probe", ...).values[:, seen]


def _check_motion(sides: dict[str, xr.DataArray], smallest: float) -> None:
    """Raise for a trajectory without motion."""
    for role, data in sides.items():
        moved = motion(data)
        if not moved >= smallest:
            raise AlignmentError(
                f"the {role} trajectory does not move (root-mean-square displacement "
                f"{moved:.2g} m, expected at least {smallest:.2g} m): it cannot be aligned"
            )


def _check_signal(b: Array, noise: Array, smallest_snr: float) -> None:
    """Raise for a measured component that does not exceed the noise.

    White noise of variance s^2 in each of p coordinates and n samples has a first component of
    variance s^2 (1 + sqrt(p / n))^2 (Marchenko and Pastur 1967).
    """
    known = noise[~np.isnan(noise)]
    per_axis = float((known**2).sum()) / max(3 * known.size, 1)
    chance = per_axis * (1.0 + (3 * noise.size / len(b)) ** 0.5) ** 2
    if float(np.var(b)) < (1.0 + smallest_snr) * chance:
        raise AlignmentError(
            f"the measured trajectory does not move beyond its noise (first component "
            f"{np.std(b):.2g} m, that of noise {chance**0.5:.2g} m, expected {1 + smallest_snr:g} "
            "times its variance): it cannot be aligned"
        )


def _length_ratio(t_m: Array, t_s: Array) -> float:
    """Return simulated over measured duration; 1 where they differ by no more than a period."""
    span_m, span_s = float(t_m[-1] - t_m[0]), float(t_s[-1] - t_s[0])
    period = max(span_m / (len(t_m) - 1), span_s / (len(t_s) - 1))
    return 1.0 if abs(span_m - span_s) <= period * (1 + 1e-9) else span_s / span_m


def _identity(
    measured: xr.Dataset | xr.DataArray, simulated: xr.Dataset | xr.DataArray
) -> dict[str, object]:
    """Attributes that identify the trial; the origin is that of the measured motion."""
    keys = ("volunteer", "instruction", "repetition", "strategy")
    kept: dict[str, object] = {
        key: data.attrs[key] for data in (simulated, measured) for key in keys if key in data.attrs
    }
    kept |= {key: measured.attrs[key] for key in ("origin", "world") if key in measured.attrs}
    return kept
