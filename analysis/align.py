"""Alignment of a measured with a simulated trajectory in time.

Both trajectories are reduced to one coefficient vector by a principal component analysis (Eskes
et al. 2017, Eqs 9-10); the shift that maximises the correlation of the two vectors, and a linear
stretch of time, are then applied to the measured positions.

A measured instant t_m falls on the simulated instant t_s through

    t_s - t_s[0] = scale (t_m - t_m[0]) + shift ,

so a positive shift moves the measurement to later times and a scale above 1 slows it down.
"""

from typing import Final, Literal

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from analysis.components import principal_component
from analysis.errors import AlignmentError
from analysis.lag import LEAST_MOTION, Array, Search, within
from analysis.trajectory import SMALLEST_MOTION, checked, motion, same_markers, without_gaps
from analysis.typed import coordinates

Scaling = Literal["length", "search", "none"]
Sign = Literal["correlation", "direction"]

LEAST_SAMPLES: Final = 8
"""Fewest samples of a trajectory that is aligned; a correlation over fewer says nothing."""


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
    sign: Sign = "correlation",
    centred: bool = True,
    subsample: bool = True,
    smallest_motion: float = SMALLEST_MOTION,
) -> xr.Dataset:
    """Shift and stretch a measured trajectory in time so that it matches a simulated one.

    The correlation of the two coefficient vectors is taken at every shift over the samples that
    overlap, means and norms over that overlap alone. Nothing is padded. The unexplained variance
    1 - r^2 then decides: a farther peak is preferred to a nearer one, and a stretch to none, only
    if it lowers the unexplained variance by the fraction `least_gain`, so that noise and a
    periodic movement create neither shifts nor stretches of their own.

    Parameters
    ----------
    measured, simulated : xarray.Dataset or xarray.DataArray
        Positions, dims (marker, axis, time) [m], the same markers in any order; the time dims may
        have other names, lengths and sampling rates.
    scaling : {"length", "search", "none"}
        ``"length"``: the measured duration is stretched to the simulated one (durations that
        differ by at most one sampling period count as equal). ``"search"``: besides, factors of
        `scale_range` times that stretch are tried. ``"none"``: scale 1.
    scale_range : (float, float)
        Least and greatest factor of the search [1].
    scale_step : float
        Relative step of the factors [1]; the best one is refined between its neighbours.
    max_shift : float, optional
        Greatest shift in either direction [s]; without it `least_overlap` alone bounds the shift.
    least_overlap : float
        Least fraction of the shorter trajectory's duration that must overlap [1].
    least_gain : float
        See above [1]; 0 takes the plain maximum.
    cutoff : float, optional
        Low-pass [Hz, simulated time] of both coefficient vectors in the search only; at most a
        fifth of the slower sampling rate. None leaves them as they are.
    sign : {"correlation", "direction"}
        The sign of a principal component is arbitrary. ``"correlation"``: the larger of the two
        correlation maxima decides. ``"direction"``: the one for which both components point the
        same way, u_measured . u_simulated > 0.
    centred : bool
        See `principal_component`.
    subsample : bool
        Refine shift and stretch between the points of the grid; otherwise the shift is a multiple
        of the simulated period.
    smallest_motion : float
        Root-mean-square displacement [m] below which a trajectory does not move.

    Returns
    -------
    xarray.Dataset
        ``position`` (marker, axis, time) [m], the measured positions at the simulated times, NaN
        where nothing was measured; ``shift`` [s]; ``scale`` [1]; ``sign`` [1], applied to
        ``b_measured``; ``b_correlation`` [1] of the aligned and low-passed vectors;
        ``overlap`` [1], fraction of the simulated samples covered;
        ``explained_variance_measured`` and ``explained_variance_simulated`` [1];
        ``direction_cosine`` [1], u_measured . u_simulated after the sign; ``shift_at_bound`` 0
        or 1: no peak lay inside the allowed shifts; ``b_measured`` (time_measured),
        ``b_simulated`` (time), ``b_aligned`` (time) [m].

    Raises
    ------
    TrajectoryError
        Different markers, gaps, fewer than 8 samples, wrong dims or units.
    AlignmentError
        A trajectory does not move, no shift leaves enough overlap, or an option lies outside its
        range.

    Notes
    -----
    Source: Eskes et al. 2017, "Synchronisation of repetitions and model output". The bounds, the
    preference for small changes and the search for a scale are additions of this package. Under
    white marker noise the search reaches the Cramer-Rao bound of shift and scale; with the
    default `least_gain` it stretches 2 to 7 % of 160-sample trials that need no stretch.
    """
    _check_options(
        scaling, scale_range, scale_step, max_shift, least_overlap, least_gain, cutoff, sign
    )
    model = checked(simulated, "simulated")
    given = same_markers(checked(measured, "measured"), model)
    for role, data in (("measured", given), ("simulated", model)):
        without_gaps(data, role, least=LEAST_SAMPLES)
        moved = motion(data)
        if not moved >= smallest_motion:
            raise AlignmentError(
                f"the {role} trajectory does not move (root-mean-square displacement "
                f"{moved:.2g} m, expected at least {smallest_motion:.2g} m): it cannot be aligned"
            )
    component_m = principal_component(given, centred=centred)
    component_s = principal_component(model, centred=centred)
    t_m, t_s = given["time"].values, model["time"].values
    b_m, b_s = component_m["b"].values, component_s["b"].values
    cosine = float((component_m["u"] * component_s["u"]).sum())
    fixed = None if sign == "correlation" else (1 if cosine >= 0 else -1)

    nominal = 1.0 if scaling == "none" else _length_ratio(t_m, t_s)
    search = Search(
        (t_m, b_m),
        (t_s, b_s),
        nominal=nominal,
        sign=fixed,
        cutoff=cutoff,
        max_shift=max_shift,
        least_overlap=least_overlap,
        least_gain=least_gain,
    )
    best = search.at_scale(nominal, subsample=subsample)
    if scaling == "search":
        least, most = nominal * scale_range[0], nominal * scale_range[1]
        top = search.over_scales(nominal, least, most, scale_step, subsample=subsample)
        if best is None or (
            top is not None and top.unexplained < (1.0 - least_gain) * best.unexplained
        ):
            best = top
    if best is None:
        raise AlignmentError(
            f"no shift leaves an overlap of {least_overlap:.0%} of the time and "
            f"{LEAST_MOTION:.0%} of the motion (measured {np.ptp(t_m):.3g} s, simulated "
            f"{np.ptp(t_s):.3g} s): widen max_shift, lower least_overlap, or use scaling='length'"
        )

    chosen = fixed if fixed is not None else (1 if best.r >= 0 else -1)
    source = t_m[0] + (t_s - t_s[0] - best.shift) / best.scale
    inside, source = within(source, t_m)
    aligned = np.full(model.shape, np.nan)
    aligned[:, :, inside] = CubicSpline(t_m, given.values, axis=2)(source[inside])
    b_aligned = np.full(len(t_s), np.nan)
    b_aligned[inside] = chosen * CubicSpline(t_m, b_m)(source[inside])

    metre, one = {"units": "m"}, {"units": "1"}
    second = {"units": "s"}
    coords = {name: coord for name, coord in coordinates(model).items() if name in model.dims}
    result = xr.Dataset(
        {
            "position": (("marker", "axis", "time"), aligned, metre),
            "shift": ((), best.shift, second),
            "scale": ((), best.scale, one),
            "sign": ((), chosen, one),
            "b_correlation": ((), chosen * best.r, one),
            "overlap": ((), float(inside.mean()), one),
            "explained_variance_measured": component_m["explained_variance"],
            "explained_variance_simulated": component_s["explained_variance"],
            "direction_cosine": ((), chosen * cosine, one),
            "shift_at_bound": ((), int(best.at_bound), one),
            "b_measured": ("time_measured", chosen * b_m, metre),
            "b_simulated": ("time", b_s, metre),
            "b_aligned": ("time", b_aligned, metre),
        },
        coords={**coords, "time_measured": ("time_measured", t_m, second)},
        attrs=_identity(measured, simulated),
    )
    result["time"].attrs["units"] = "s"
    result.attrs |= {
        "scaling": scaling,
        "scale_range": list(scale_range),
        "scale_step": scale_step,
        "max_shift": "bounded by least_overlap" if max_shift is None else max_shift,
        "least_overlap": least_overlap,
        "least_gain": least_gain,
        "cutoff": "none" if cutoff is None else cutoff,
        "sign_by": sign,
        "centred": int(centred),
        "subsample": int(subsample),
        "time_mapping": "t_s - t_s[0] = scale (t_m - t_m[0]) + shift",
    }
    return result


def _length_ratio(t_m: Array, t_s: Array) -> float:
    """Return simulated over measured duration; 1 where they differ by no more than a period."""
    span_m, span_s = float(t_m[-1] - t_m[0]), float(t_s[-1] - t_s[0])
    period = max(span_m / (len(t_m) - 1), span_s / (len(t_s) - 1))
    return 1.0 if abs(span_m - span_s) <= period * (1 + 1e-9) else span_s / span_m


def _identity(
    measured: xr.Dataset | xr.DataArray, simulated: xr.Dataset | xr.DataArray
) -> dict[str, object]:
    """Attributes that say which trial this is; the origin is that of the measured side."""
    keys = ("volunteer", "instruction", "repetition", "strategy")
    kept: dict[str, object] = {
        key: data.attrs[key] for data in (simulated, measured) for key in keys if key in data.attrs
    }
    if "origin" in measured.attrs:
        kept["origin"] = measured.attrs["origin"]
    return kept


def _check_options(
    scaling: str,
    scale_range: tuple[float, float],
    scale_step: float,
    max_shift: float | None,
    least_overlap: float,
    least_gain: float,
    cutoff: float | None,
    sign: str,
) -> None:
    """Raise for an option outside its range."""
    if scaling not in ("length", "search", "none"):
        raise AlignmentError(f"scaling is {scaling!r}, expected 'length', 'search' or 'none'")
    if sign not in ("correlation", "direction"):
        raise AlignmentError(f"sign is {sign!r}, expected 'correlation' or 'direction'")
    if not 0 < scale_range[0] <= 1 <= scale_range[1]:
        raise AlignmentError(f"scale_range is {scale_range}, expected 0 < least <= 1 <= greatest")
    if not 0 < scale_step < 0.5:
        raise AlignmentError(f"scale_step is {scale_step}, expected a value between 0 and 0.5")
    if max_shift is not None and not max_shift >= 0:
        raise AlignmentError(f"max_shift is {max_shift} s, expected 0 or more")
    if not 0 < least_overlap <= 1:
        raise AlignmentError(f"least_overlap is {least_overlap}, expected above 0 and at most 1")
    if cutoff is not None and not cutoff > 0:
        raise AlignmentError(f"cutoff is {cutoff} Hz, expected above 0 or None")
    if not 0 <= least_gain < 1:
        raise AlignmentError(f"least_gain is {least_gain}, expected from 0 to below 1")
