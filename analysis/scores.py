"""Agreement of a simulated with a measured trajectory for each marker."""

from typing import Final, Literal

import numpy as np
import xarray as xr

from analysis.errors import TrajectoryError
from analysis.flags import FLAGS
from analysis.noise import SMALLEST_SNR, attenuation
from analysis.trajectory import SMALLEST_MOTION, Pair, checked, pair, same_markers, same_time
from analysis.typed import selected, texts

Form = Literal["consistent", "as_printed"]
Reference = Literal["mean", "first", "origin"]

MOTION_ROUNDING: Final = 64 * float(np.finfo(np.float64).eps)
"""Displacement relative to the position below which a motion is due to rounding."""

DROWNED: Final = "the measured motion does not exceed its noise"
"""Reason of a marker whose motion cannot be distinguished from the noise."""

MEASURED_STILL: Final = "the measured marker does not move"
SIMULATED_STILL: Final = "the simulated marker does not move"

CARRIED: Final = (
    "shift", "scale", "sign", "sign_by_direction", "b_correlation", "overlap", "unseen_ends",
    "explained_variance_measured", "explained_variance_simulated", "direction_cosine", "noise",
    *FLAGS,
)  # fmt: skip
"""Variables of the alignment that are kept in the scores."""


def correlation_3d(
    measured: xr.DataArray,
    simulated: xr.DataArray,
    *,
    dim: str = "time",
    form: Form = "consistent",
    smallest_motion: float = 0.0,
) -> xr.DataArray:
    """Correlation of 3D trajectories.

    rho = sum (v - mean v).(w - mean w) / sqrt(sum |v - mean v|^2 sum |w - mean w|^2)

    It is computed from centred values, because the difference of large means in Eq. 13 loses all
    digits for positions far from the origin.

    Parameters
    ----------
    measured, simulated : xarray.DataArray
        v and w, dims (..., axis, `dim`), the same unit, the same labels.
    dim : str
        The dim of the samples.
    form : {"consistent", "as_printed"}
        As printed, Eq. 13 divides its numerator by n and Eq. 12 by n - 1, so that the correlation
        of a trajectory with itself is (n - 1) / n. ``"consistent"`` uses the same divisor for both.
    smallest_motion : float
        Root-mean-square displacement, in the unit of the positions, below which a trajectory is
        undefined; motion due to rounding is always regarded as no motion.

    Returns
    -------
    xarray.DataArray
        rho [1], dims (...), NaN where `undefined_reason` gives a reason.

    Raises
    ------
    TrajectoryError
        Dims, labels, samples or units differ, or fewer than two samples; `form` is unknown, or
        `smallest_motion` is negative or not finite.

    Notes
    -----
    Source: Eskes et al. 2017, Eqs 11-13, after Pitermann and Munhall. rho is invariant to shift
    and positive scale of either trajectory, not to rotation.
    """
    both = Pair.from_positions(measured, simulated, dim)
    return _correlation(both, _reason(both, smallest_motion) == "", form)


def undefined_reason(
    measured: xr.DataArray,
    simulated: xr.DataArray,
    *,
    dim: str = "time",
    smallest_motion: float = 0.0,
    noise: xr.DataArray | None = None,
    smallest_snr: float = SMALLEST_SNR,
) -> xr.DataArray:
    """Reason for an undefined correlation; empty where it is defined.

    Parameters
    ----------
    measured, simulated, dim, smallest_motion
        As in `correlation_3d`, which raises the same errors.
    noise : xarray.DataArray, optional
        Root mean square of the noise of the measured positions, three axes together, dims (...),
        in their unit.
    smallest_snr : float
        Ratio of the variances of measured motion and noise, V / N - 1, below which the marker does
        not move [1].

    Returns
    -------
    xarray.DataArray
        Text, dims (...).
    """
    return _reason(
        Pair.from_positions(measured, simulated, dim), smallest_motion, noise, smallest_snr
    )


def amplitude_ratio(
    measured: xr.DataArray,
    simulated: xr.DataArray,
    *,
    dim: str = "time",
    smallest_motion: float = 0.0,
) -> xr.DataArray:
    """Amplitude of the simulated relative to the measured movement, sigma_w / sigma_v [1].

    Parameters and errors are those of `correlation_3d`. 0 if the simulated marker does not move,
    NaN if the measured one does not move or either has gaps. Source of sigma: Eskes et al. 2017,
    Eq. 12.
    """
    both = Pair.from_positions(measured, simulated, dim)
    return _ratio(both, _reason(both, smallest_motion))


def rmse(
    measured: xr.DataArray,
    simulated: xr.DataArray,
    *,
    dim: str = "time",
    reference: Reference = "mean",
) -> xr.DataArray:
    """Root-mean-square distance of two trajectories, sqrt(1/n sum |v_i - w_i|^2).

    Parameters
    ----------
    measured, simulated, dim
        As in `correlation_3d`, which raises the same errors.
    reference : {"mean", "first", "origin"}
        Origin of v and w: ``"mean"``, the mean of each over time, so that the movements of
        different faces are compared; ``"first"``, the first sample of each; ``"origin"``, that of
        the coordinates.

    Returns
    -------
    xarray.DataArray
        Distance in the unit of the positions, dims (...); NaN where either has gaps.
    """
    v, w = pair(measured, simulated, dim)
    difference = v - w
    if reference == "mean":
        difference = difference - difference.mean(dim, skipna=False)
    elif reference == "first":
        difference = difference - difference.isel({dim: 0}, drop=True)
    elif reference != "origin":
        raise TrajectoryError(f"reference is {reference!r}, expected 'mean', 'first' or 'origin'")
    distance = ((difference**2).sum(["axis", dim], skipna=False) / v.sizes[dim]) ** 0.5
    attrs = {
        "units": measured.attrs.get("units", "1"),
        "long_name": "root-mean-square distance",
        "reference": reference,
    }
    return _named(distance, "rmse", attrs)


def score(
    aligned: xr.Dataset | xr.DataArray,
    simulated: xr.Dataset | xr.DataArray,
    *,
    form: Form = "consistent",
    reference: Reference = "mean",
    smallest_motion: float = SMALLEST_MOTION,
    smallest_snr: float = SMALLEST_SNR,
) -> xr.Dataset:
    """Score one trial.

    Instants at the beginning and the end at which `aligned` is NaN for every marker are omitted; a
    gap between them makes the scores of its marker undefined.

    Parameters
    ----------
    aligned : xarray.Dataset or xarray.DataArray
        Measured positions on the simulated time base, dims (marker, axis, time) [m]; a dataset
        may contain their ``noise`` (marker) [m].
    simulated : xarray.Dataset or xarray.DataArray
        Simulated positions, the same dims and markers.
    form, reference
        See `correlation_3d` and `rmse`.
    smallest_motion : float
        Root-mean-square displacement [m] below which a marker does not move.
    smallest_snr : float
        Ratio of the variances of a marker's measured motion and noise below which it does not move
        [1].

    Returns
    -------
    xarray.Dataset
        ``rho`` (marker) [1], ``amplitude_ratio`` (marker) [1], ``rmse`` (marker) [m], ``reason``
        (marker) for which rho is undefined, number of scored ``samples`` [1]; ``attenuation``
        (marker) [1], by which noise is expected to lower rho (not corrected), if the noise is
        known; and the variables `CARRIED` of `aligned`.

    Raises
    ------
    TrajectoryError
        Different markers or time bases, wrong dims or units, fewer than two samples in common; an
        option is unknown, negative or not finite.
    """
    model = checked(simulated, "simulated")
    given = same_markers(checked(aligned, "aligned"), model)
    same_time(given, model)
    covered = np.flatnonzero(np.isfinite(given.values).any(axis=(0, 1)))
    span = slice(int(covered[0]), int(covered[-1]) + 1) if len(covered) else slice(0, 0)
    v, w = given.isel(time=span), model.isel(time=span)
    noise = aligned.get("noise") if isinstance(aligned, xr.Dataset) else None
    noise = noise if noise is None else selected(noise, {"marker": model["marker"].values})
    both = Pair.from_positions(v, w, "time")
    reason = _reason(both, smallest_motion, noise, smallest_snr)
    result = xr.Dataset(
        {
            "rho": _correlation(both, reason == "", form),
            "amplitude_ratio": _ratio(both, reason),
            "rmse": rmse(v, w, reference=reference),
            "reason": reason,
            "samples": ((), v.sizes["time"], {"units": "1"}),
        }
    )
    if noise is not None:
        result["attenuation"] = attenuation(both.root("measured"), noise)
    if isinstance(aligned, xr.Dataset):
        result = result.assign({name: aligned[name] for name in CARRIED if name in aligned})
    result.attrs = {name: value for name, value in aligned.attrs.items() if name != "units"}
    return result.assign_attrs(
        form=form, reference=reference, smallest_motion=smallest_motion, smallest_snr=smallest_snr
    )


def _reason(
    both: Pair,
    smallest_motion: float,
    noise: xr.DataArray | None = None,
    smallest_snr: float = SMALLEST_SNR,
) -> xr.DataArray:
    """Reason for an undefined correlation, as `undefined_reason`."""
    for name, least in (("smallest_motion", smallest_motion), ("smallest_snr", smallest_snr)):
        if not 0.0 <= least < np.inf:
            raise TrajectoryError(f"{name} is {least}, expected a finite number of 0 or more")
    dims = ["axis", both.dim]
    gaps = {role: data.isnull().any(dims) for role, data in both.given.items()}
    still: dict[str, xr.DataArray] = {}
    for role, data in both.given.items():
        moved, rounding = both.root(role), MOTION_ROUNDING * abs(data).max(dims)
        still[role] = ~(moved > rounding) | (moved < smallest_motion)
    drowned = xr.zeros_like(still["measured"])
    if noise is not None:
        below = both.root("measured") ** 2 < (1.0 + smallest_snr) * noise**2
        drowned = below & ~still["measured"]
        still["measured"] = still["measured"] | below
    reason = xr.full_like(gaps["measured"], "", dtype="U48")
    for what, one_of in (("does not move", still), ("has gaps", gaps)):
        bad_both = one_of["measured"] & one_of["simulated"]
        for role, bad in one_of.items():
            reason = reason.where(~bad, f"the {role} marker {what}")
        reason = reason.where(~bad_both, "neither moves" if one_of is still else "both have gaps")
    reason = reason.where(~(drowned & (reason == MEASURED_STILL)), DROWNED)
    return _named(texts(reason), "reason", {"long_name": "reason for which rho is undefined"})


def _correlation(both: Pair, defined: xr.DataArray, form: Form) -> xr.DataArray:
    """Correlation of two trajectories where it is defined, as `correlation_3d`."""
    if form not in ("consistent", "as_printed"):
        raise TrajectoryError(f"form is {form!r}, expected 'consistent' or 'as_printed'")
    v, w = both.centred["measured"], both.centred["simulated"]
    product = (v * w).sum(["axis", both.dim], skipna=False)
    # The product of the two sums could underflow for very small motions.
    norm = both.squares["measured"] ** 0.5 * both.squares["simulated"] ** 0.5
    # Rounding may violate the Cauchy-Schwarz inequality.
    rho = (product / norm.where(defined)).clip(-1.0, 1.0)
    if form == "as_printed":
        rho = rho * ((both.samples - 1) / both.samples)
    attrs = {"units": "1", "long_name": "correlation of 3D trajectories", "form": form}
    return _named(rho, "rho", attrs)


def _ratio(both: Pair, reason: xr.DataArray) -> xr.DataArray:
    """Ratio of amplitudes where the measured marker moves, as `amplitude_ratio`."""
    size_v, size_w = (each**0.5 for each in both.squares.values())
    ratio = size_w / size_v.where(reason.isin(["", SIMULATED_STILL]))
    ratio = ratio.where(reason != SIMULATED_STILL, 0.0)
    attrs = {"units": "1", "long_name": "simulated divided by measured amplitude of movement"}
    return _named(ratio, "amplitude_ratio", attrs)


def _named(data: xr.DataArray, name: str, attrs: dict[str, str]) -> xr.DataArray:
    """Set the name and the attributes of a result."""
    data = data.rename(name)
    data.attrs = dict(attrs)
    return data
