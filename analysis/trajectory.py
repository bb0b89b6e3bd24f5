"""Checks of marker trajectories before their comparison."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.errors import TrajectoryError
from analysis.typed import coordinates, floats, relabelled, selected

SMALLEST_MOTION: Final = 1e-9
"""Root-mean-square displacement [m] below which a trajectory is regarded as not moving.

A nanometre is far below the resolution of a camera and above the tolerance of a converged solver,
whose residual motion must not be scored as movement.
"""

LARGEST_POSITION: Final = 1e150
"""Position whose square, summed over the samples, approaches the largest float64; it is a gap [m]."""


def names(labels: list[str], most: int = 4) -> str:
    """Join labels for a message, the first few of them."""
    return ", ".join(labels[:most]) + (
        f" and {len(labels) - most} more" if len(labels) > most else ""
    )


def require_real(data: xr.DataArray, what: str) -> None:
    """Raise TrajectoryError for complex numbers, dates and texts."""
    if data.dtype.kind not in "fiu":
        raise TrajectoryError(f"the {what}: type {data.dtype}, expected real numbers in SI units")


def checked(data: xr.Dataset | xr.DataArray, role: str) -> xr.DataArray:
    """Check a trajectory and return it as float64 `position(marker, axis, time)`.

    Positions [m] have the dims marker, axis (3) and one time dim of any name, which becomes
    ``time``; in a Dataset they are the variable ``position``. `role` is the name in messages, such
    as ``"measured"``. Raises TrajectoryError for no ``position``, other dims, no labels, repeated
    markers, units other than metre and second, values that are not real numbers, or time not strictly
    increasing.
    """
    if isinstance(data, xr.Dataset):
        if "position" not in data:
            raise TrajectoryError(
                f"the {role} dataset has no variable 'position' (found: "
                f"{names([str(name) for name in data.data_vars]) or 'none'}): "
                "rename the marker positions to 'position'"
            )
        position = data["position"]
    else:
        position = data
    others = [str(dim) for dim in position.dims if dim not in ("marker", "axis")]
    if len(others) != 1 or position.ndim != 3:
        raise TrajectoryError(
            f"the {role} positions have dims {tuple(map(str, position.dims))}, expected "
            "(marker, axis, time): select one trial first"
        )
    time_dim = others[0]
    for dim in ("marker", time_dim):
        if dim not in coordinates(position):
            raise TrajectoryError(
                f"the {role} positions have no coordinate '{dim}': add its labels"
            )
    if position.sizes["axis"] != 3:
        raise TrajectoryError(
            f"the {role} positions have {position.sizes['axis']} axes, expected x, y and z"
        )
    units = position.attrs.get("units")
    if units != "m":
        raise TrajectoryError(
            f"the {role} positions are in {units!r}, expected units 'm': convert them and set "
            "attrs['units']"
        )
    markers = [str(marker) for marker in position["marker"].values]
    repeated = sorted({marker for marker in markers if markers.count(marker) > 1})
    if repeated:
        raise TrajectoryError(f"the {role} positions contain a marker twice: {names(repeated)}")
    clock = position[time_dim].attrs.get("units", "s")
    if clock != "s":
        raise TrajectoryError(
            f"the {role} time is in {clock!r}, expected units 's': convert it and set attrs['units']"
        )
    require_real(position, f"{role} positions")
    require_real(position[time_dim], f"{role} time")
    time = np.asarray(position[time_dim].values, dtype=np.float64)
    if not (np.isfinite(time).all() and (np.diff(time) > 0).all()):
        raise TrajectoryError(
            f"the {role} time is not strictly increasing: sort it and remove repeated samples"
        )
    if time_dim != "time":
        # A scalar coordinate "time" would conflict with the new name.
        position = position.drop_vars("time", errors="ignore").rename({time_dim: "time"})
    return floats(position.transpose("marker", "axis", "time"))


def same_markers(measured: xr.DataArray, simulated: xr.DataArray) -> xr.DataArray:
    """Return the measured positions with markers (and axes) in the order of the simulated ones."""
    for dim in ("marker", "axis"):
        if dim not in coordinates(measured) or dim not in coordinates(simulated):
            continue
        ours = [str(label) for label in measured[dim].values]
        theirs = [str(label) for label in simulated[dim].values]
        absent = [label for label in theirs if label not in ours]
        extra = [label for label in ours if label not in theirs]
        if absent or extra:
            parts = [f"not measured: {names(absent)}"] if absent else []
            parts += [f"not simulated: {names(extra)}"] if extra else []
            raise TrajectoryError(
                f"the two trajectories have different {dim} labels ({'; '.join(parts)}): "
                "select the same ones on both sides"
            )
        if ours != theirs:
            measured = selected(measured, {dim: simulated[dim].values})
    return measured


def motion(position: xr.DataArray) -> float:
    """Root-mean-square displacement of all markers about their mean positions [m], 0 in gaps.

    The dims are (marker, axis, time).
    """
    values = position.values
    seen = ~np.isnan(values)
    with np.errstate(invalid="ignore"):  # of a marker that is never seen
        mean = values.sum(axis=2, where=seen, keepdims=True) / seen.sum(axis=2, keepdims=True)
    squares = np.square(values - mean).sum(axis=(1, 2), where=seen)
    return float(np.sqrt(squares.mean() / values.shape[2]))


def without_gaps(position: xr.DataArray, role: str, *, least: int) -> None:
    """Raise unless all samples are finite and their number suffices."""
    count = position.sizes["time"]
    bad = ~np.isfinite(position.values)
    seen: NDArray[np.bool_] = np.any(~bad, axis=(1, 2))
    labels = [str(marker) for marker in position["marker"].values]
    never = [label for label, visible in zip(labels, seen.tolist(), strict=True) if not visible]
    if never and count:
        raise TrajectoryError(
            f"the {role} marker{'s' if len(never) > 1 else ''} {names(never)} "
            f"{'are' if len(never) > 1 else 'is'} visible at no instant, expected positions of every "
            "marker: omit such markers on both sides, or omit the trial"
        )
    if count < least:
        raise TrajectoryError(
            f"the {role} trajectory has {count} samples, expected at least {least}: pass the whole trial"
        )
    if bad.any():
        markers = position["marker"].values[bad.any(axis=(1, 2))]
        instants = int(bad.any(axis=(0, 1)).sum())
        raise TrajectoryError(
            f"the {role} trajectory has gaps at {instants} of {count} instants "
            f"({names([str(marker) for marker in markers])}) between instants at which every "
            "marker is visible: interpolate short gaps first, or omit the trial"
        )


def measured_span(position: xr.DataArray) -> slice:
    """Samples from the first to the last at which every marker is finite; empty if there is none."""
    whole = np.flatnonzero(np.isfinite(position.values).all(axis=(0, 1)))
    return slice(int(whole[0]), int(whole[-1]) + 1) if len(whole) else slice(0, 0)


def pair(
    measured: xr.DataArray, simulated: xr.DataArray, dim: str
) -> tuple[xr.DataArray, xr.DataArray]:
    """Check two trajectories against each other; NaN from `LARGEST_POSITION` on."""
    for role, data in (("measured", measured), ("simulated", simulated)):
        if not isinstance(data, xr.DataArray):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise TrajectoryError(
                f"the {role} trajectory is of type {type(data).__name__}, expected a DataArray with "
                f"the dims axis and {dim}: label it"
            )
        require_real(data, f"{role} trajectory")
        absent = [name for name in ("axis", dim) if name not in data.dims]
        if absent:
            raise TrajectoryError(
                f"the {role} trajectory has dims {tuple(map(str, data.dims))} and lacks "
                f"{names(absent)}"
            )
        if not data.sizes["axis"]:
            raise TrajectoryError(
                f"the {role} trajectory has no axis, expected at least one: check what was selected"
            )
    both = (measured, simulated)
    single = [
        d for d in ("marker", "axis") if any(d in coordinates(v) and d not in v.dims for v in both)
    ]
    several = [d for d in single if any(d in v.dims for v in both)]
    if several or dim == "axis":
        raise TrajectoryError(
            f"the trajectories have dims {tuple(map(str, measured.dims))} and "
            f"{tuple(map(str, simulated.dims))} with samples along {dim}, expected the same markers on "
            "both sides, and samples over time: select one entry on both sides"
        )
    n = simulated.sizes[dim]
    if n != measured.sizes[dim] or n < 2:
        raise TrajectoryError(
            f"the trajectories have {measured.sizes[dim]} and {n} samples, expected the same "
            "number, at least 2: align them first"
        )
    units = measured.attrs.get("units"), simulated.attrs.get("units")
    if units[0] != units[1]:
        raise TrajectoryError(
            f"the trajectories are in {units[0]!r} and {units[1]!r}, expected the same units"
        )
    v = same_markers(measured, simulated)
    if dim in coordinates(v) and dim in coordinates(simulated):
        same_time(v, simulated, dim)
        # The labels may differ by rounding, and xarray would keep only identical ones.
        v = relabelled(v, {dim: simulated[dim]})
    v, w = floats(v), floats(simulated)
    return v.where(abs(v) < LARGEST_POSITION), w.where(abs(w) < LARGEST_POSITION)


@dataclass(frozen=True)
class Pair:
    """Measured and simulated positions, about their means, and their sums of squares."""

    given: dict[str, xr.DataArray]
    centred: dict[str, xr.DataArray]
    squares: dict[str, xr.DataArray]
    dim: str

    @classmethod
    def from_positions(cls, measured: xr.DataArray, simulated: xr.DataArray, dim: str) -> "Pair":
        """Check two trajectories against each other and centre them."""
        v, w = pair(measured, simulated, dim)
        given = {"measured": v, "simulated": w}
        centred = {role: data - data.mean(dim, skipna=False) for role, data in given.items()}
        squares = {r: (data**2).sum(["axis", dim], skipna=False) for r, data in centred.items()}
        return cls(given, centred, squares, dim)

    @property
    def samples(self) -> int:
        """Number of samples."""
        return self.given["measured"].sizes[self.dim]

    def root(self, role: str) -> xr.DataArray:
        """Root-mean-square displacement from the mean, all axes together."""
        return (self.squares[role] / self.samples) ** 0.5


def same_time(measured: xr.DataArray, simulated: xr.DataArray, dim: str = "time") -> None:
    """Raise unless both have the same instants, within a thousandth of the sampling period."""
    ours, theirs = measured[dim].values, simulated[dim].values
    if len(ours) == len(theirs):
        period = abs(float(theirs[-1] - theirs[0])) / max(1, len(theirs) - 1)
        if np.allclose(ours, theirs, rtol=0.0, atol=1e-3 * period):
            return
    raise TrajectoryError(
        f"the two trajectories have different values of {dim!r}: align the measured one first"
    )
