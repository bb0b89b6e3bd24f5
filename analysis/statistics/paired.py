"""Paired differences between strategies, with counts of missing pairs.

The volunteer is the unit of analysis, because markers, repetitions and instructions of one person
are not independent. Two strategies are compared within the same trial and marker; the differences
are averaged over repetitions, then over instructions and markers, to one number per volunteer.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.cube import MARKER_DIMS, TRIAL_DIMS
from analysis.errors import StatisticsError
from analysis.statistics.scope import told_scope, too_few_volunteers
from analysis.tables import TABLE_UNITS, origin_of
from analysis.trajectory import names
from analysis.typed import selected, status_of

Array = NDArray[np.float64]
Scale = Literal["z", "raw"]

LIMIT: Final = 0.9999
"""Largest |rho| for Fisher's z; beyond it, one value would outweigh all others."""

WHY: Final = ("failed", "excluded", "missing", "undefined")
"""Reasons for missing pairs; the first that applies to either side is counted."""


@dataclass(frozen=True)
class PairedScores:
    """Differences of one contrast."""

    label: str  #: "first - second"
    #: first - second on the scale of the analysis, dims volunteer, repetition and the others; NaN
    #: unless both are defined
    differences: xr.DataArray
    means: xr.DataArray  #: one number per volunteer, NaN for a volunteer without a pair
    #: ``pairs`` in use, missing ones by cause (``lost_failed``, ``lost_excluded``,
    #: ``lost_missing``, ``lost_undefined``), and ``clipped``, those with a clipped value
    counts: dict[str, int]
    unit: str = ""  #: unit for the display of a difference
    factor: float = 1.0  #: factor for its display

    def shown(self, value: float) -> str:
        """Format a difference in its displayed unit."""
        return f"{value * self.factor:+z.2f}{self.unit}"

    def shown_interval(self, lower: float, upper: float, level: float) -> str:
        """Format an interval with its level, or the reason for its absence."""
        if few := too_few_volunteers(len(self.values)):
            return few
        if np.isnan(lower) or np.isnan(upper):
            return "no interval"
        if np.isinf(lower) or np.isinf(upper):
            return f"no bounded {100 * level:.3g} % interval"
        low, high = lower * self.factor, upper * self.factor
        return f"{100 * level:.3g} % interval {low:z.2f} to {high:z.2f}"

    @property
    def values(self) -> Array:
        """Means of the volunteers with a pair, shape (n,)."""
        means = self.means.values
        return means[np.isfinite(means)]

    @property
    def volunteers(self) -> list[str]:
        """Labels of `values`."""
        kept = np.isfinite(self.means.values)
        return [str(label) for label in self.means["volunteer"].values[kept]]


def fisher_z(rho: xr.DataArray, *, limit: float = LIMIT) -> xr.DataArray:
    """Fisher's variance-stabilising transform of a correlation [1], artanh(clip(rho, -limit, limit)).

    Raises StatisticsError if `limit` lies outside 0-1, or a value outside -1 to 1.
    """
    if not 0 < limit < 1:
        raise StatisticsError(f"the limit of Fisher's z is {limit}, expected between 0 and 1")
    values = np.asarray(rho.values, dtype=np.float64)
    if (np.abs(values) > 1 + 1e-9).any():
        raise StatisticsError(
            f"found a correlation of {np.nanmax(np.abs(values)):.4g}, expected -1 to 1: "
            "Fisher's z applies to correlations, use scale='raw'"
        )
    return rho.copy(data=np.arctanh(np.clip(values, -limit, limit))).assign_attrs(units="1")


def sound_cube(cube: xr.Dataset, variable: str) -> xr.Dataset:
    """Return a cube with its trials in the order of their names, on which random draws depend.

    Raises StatisticsError for labels that occur twice, and infinite values of scored trials. Values
    that are undefined are NaN; an infinite one is the result of a division by zero elsewhere.
    """
    for dim in MARKER_DIMS:
        labels = [str(label) for label in cube[dim].values] if dim in cube.coords else []
        if twice := sorted({label for label in labels if labels.count(label) > 1}):
            raise StatisticsError(
                f"the cube contains the {dim} {names(twice)} more than once, expected every {dim} "
                "once: rename or select them"
            )
    data = cube[variable]
    if data.dtype.kind == "f":
        infinite = np.isinf(data.where(status_of(cube) == "ok").values)
        if infinite.any():
            raise StatisticsError(
                f"{variable} is infinite in {int(infinite.sum())} scored trials and markers, expected "
                "numbers, or NaN where it is undefined: repair the cube"
            )
    ordered = [dim for dim in TRIAL_DIMS[:3] if dim in cube.indexes]
    if all(cube.indexes[dim].is_monotonic_increasing for dim in ordered):
        return cube
    return cube.sortby(ordered)


def on_scale(cube: xr.Dataset, variable: str, scale: Scale, limit: float) -> xr.DataArray:
    """Return the values of scored trials on the scale of the analysis, NaN elsewhere."""
    if variable not in cube or "marker" not in cube[variable].dims:
        known = [str(name) for name, data in cube.data_vars.items() if "marker" in data.dims]
        known = [name for name in known if cube[name].dtype.kind == "f"]
        raise StatisticsError(f"cannot test {variable!r}, expected one of {names(known)}")
    if scale not in ("z", "raw"):
        raise StatisticsError(f"the scale is {scale!r}, expected 'z' or 'raw'")
    lacking = [dim for dim in MARKER_DIMS if dim not in cube[variable].dims]
    if lacking:
        raise StatisticsError(
            f"{variable} lacks the dim {names(lacking)}: keep it by selecting with a list"
        )
    cube = sound_cube(cube, variable)
    data = cube[variable].where(status_of(cube) == "ok")
    data = data.where(np.isfinite(data)).transpose(*MARKER_DIMS, ...)
    return fisher_z(data, limit=limit) if scale == "z" else data


def chosen_contrasts(
    labels: Sequence[str], contrasts: Sequence[tuple[str, str]] | None
) -> list[tuple[str, str]]:
    """Return the pairs (first, second) to compare; default: all pairs, later minus earlier."""
    if contrasts is None:
        return [(second, first) for first, second in combinations(labels, 2)]
    for first, second in contrasts:
        wrong = [label for label in (first, second) if label not in labels]
        if wrong or first == second:
            raise StatisticsError(
                f"cannot compare {first!r} with {second!r}, expected two of {names([*labels])}"
            )
    return [(first, second) for first, second in contrasts]


def paired(
    cube: xr.Dataset,
    first: str,
    second: str,
    *,
    dim: str = "strategy",
    variable: str = "rho",
    scale: Scale = "z",
    limit: float = LIMIT,
) -> PairedScores:
    """Compute the differences first - second between two labels of `dim`, within trial and marker.

    `variable`, `scale` and `limit` are those of `compare`.
    """
    data = on_scale(cube, variable, scale, limit)
    return _paired(data, cube, first, second, dim, variable, limit if scale == "z" else None)


def _paired(
    data: xr.DataArray,
    cube: xr.Dataset,
    first: str,
    second: str,
    dim: str,
    variable: str,
    limit: float | None,
) -> PairedScores:
    """Differences of the values of `on_scale`, which are Fisher's z if there is a limit."""
    status = status_of(cube).broadcast_like(data).transpose(*data.dims)
    sides = [selected(data, {dim: label}).drop_vars(dim) for label in (first, second)]
    kinds = [selected(status, {dim: label}).drop_vars(dim).values for label in (first, second)]
    differences = sides[0] - sides[1]
    defined = np.isfinite(differences.values)
    failed = np.any([np.char.startswith(kind.astype(str), "failed") for kind in kinds], axis=0)
    excluded = np.any([kind == "excluded" for kind in kinds], axis=0) & ~failed
    missing = np.any([kind == "missing" for kind in kinds], axis=0) & ~failed & ~excluded
    counts = {
        "pairs": int(defined.sum()),
        "lost_failed": int((~defined & failed).sum()),
        "lost_excluded": int((~defined & excluded).sum()),
        "lost_missing": int((~defined & missing).sum()),
        "lost_undefined": int((~defined & ~failed & ~excluded & ~missing).sum()),
        "clipped": 0,
    }
    if limit is not None:
        most = float(np.arctanh(limit))
        at_limit = [np.abs(side.values) >= most for side in sides]
        counts["clipped"] = int((defined & (at_limit[0] | at_limit[1])).sum())
    _, unit, factor, _ = TABLE_UNITS.get(variable, ("1", "1", 1.0, 2))
    unit = " in z" if limit is not None else "" if unit == "1" else f" {unit}"
    label = f"{first} - {second}"
    return PairedScores(label, differences, volunteer_means(differences), counts, unit, factor)


def volunteer_means(data: xr.DataArray, *keep: str) -> xr.DataArray:
    """Average over repetitions, then over all but the volunteers and the dims to keep."""
    data = data.mean("repetition", skipna=True)
    rest = [dim for dim in data.dims if dim not in ("volunteer", *keep)]
    return data.mean(rest, skipna=True)


@dataclass(frozen=True)
class Comparison:
    """Contrasts of the strategies of a cube."""

    values: xr.DataArray  #: values of scored trials on the scale of the analysis, NaN elsewhere
    pairs: tuple[PairedScores, ...]  #: one per contrast
    attrs: dict[str, Any]  #: attributes of every result: variable, scale, units, origin, scope


def compare(
    cube: xr.Dataset,
    *,
    contrasts: Sequence[tuple[str, str]] | None = None,
    variable: str = "rho",
    scale: Scale | None = None,
    limit: float = LIMIT,
) -> Comparison:
    """Compute the differences between strategies for the tests of `analysis.statistics`.

    `contrasts` are strategies (first, second), compared as first - second; by default all pairs.
    `variable` is ``"rho"``, ``"amplitude_ratio"`` or ``"rmse"``, and `scale` Fisher's z or the
    values themselves; by default z for rho, otherwise raw. `limit` is that of `fisher_z`. Raises
    StatisticsError for an unknown strategy, variable or scale, or a cube with further axes, whose
    levels are not repetitions of each other.
    """
    used: Scale = scale if scale is not None else ("z" if variable == "rho" else "raw")
    data = on_scale(cube, variable, used, limit)
    extra = [str(dim) for dim in data.dims[len(MARKER_DIMS) :]]
    if extra:
        raise StatisticsError(
            f"the cube has the further dims {names(extra)}: select one level of each, or use "
            "analysis.sensitivity"
        )
    chosen = chosen_contrasts([str(label) for label in cube["strategy"].values], contrasts)
    clipped = limit if used == "z" else None
    pairs = [_paired(data, cube, *each, "strategy", variable, clipped) for each in chosen]
    attrs = described(cube, variable, used) | ({"clipped_at": limit} if used == "z" else {})
    return Comparison(data, tuple(pairs), attrs)


def described(cube: xr.Dataset, variable: str, scale: Scale) -> dict[str, Any]:
    """Properties of the data that every result states as attributes."""
    return {
        "variable": variable,
        "scale": "Fisher z" if scale == "z" else "raw scale",
        "units": str(cube[variable].attrs.get("units", "1")),
        "origin": origin_of(cube),
        "scope": told_scope("these instructions", cube.sizes["instruction"]),
    }
