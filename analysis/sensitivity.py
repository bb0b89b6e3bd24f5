"""Which of the choices that a paper leaves open move the result, and which do not."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import xarray as xr

from analysis.cube import MARKER_DIMS
from analysis.errors import StatisticsError
from analysis.statistics.finding import check_level, collected
from analysis.statistics.paired import LIMIT, Paired, Scale, paired
from analysis.statistics.sign_flip import flip_finding, joint_p
from analysis.tables import SHOWN, Column, Table, origin_of, recordings
from analysis.trajectory import names
from analysis.typed import selected

DRAWS: Final = 19_999


def sensitivity(
    cube: xr.Dataset,
    *,
    axes: Sequence[str] | None = None,
    reference: Mapping[str, Any] | None = None,
    variable: str = "rho",
    scale: Scale = "raw",
    level: float = 0.95,
    seed: int = 0,
    limit: float = LIMIT,
) -> xr.Dataset:
    """Compare every level of every axis with its reference, all other axes at theirs.

    Differences are taken within trial, strategy and marker and averaged to one per volunteer, as
    between strategies; the sign-flip test over volunteers gives interval and p.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with further dims, one per axis, such as ``mapping_stage`` or ``sigma_max``; trials
        off the reference of several axes at once may be missing.
    axes : sequence of str, optional
        Axes to compare; all dims beyond those of a cube where not given.
    reference : mapping of str to label, optional
        Reference level per axis; its first level where not given.
    variable : str
        ``"rho"``, ``"amplitude_ratio"`` or ``"rmse"``.
    scale : {"raw", "z"}
        The values themselves, or Fisher's z of rho.
    level, seed, limit
        As in `analysis.statistics.sign_flip.sign_flip`.

    Returns
    -------
    xarray.Dataset
        As `analysis.statistics.finding.collected` with dim choice ("axis = level") in place of
        contrast: ``estimate`` is level minus reference; besides ``axis`` and ``level`` (choice),
        ``by_strategy`` (choice, strategy), the mean change per strategy, and ``reach`` (axis
        names), the largest absolute estimate of each. Attribute ``reference``.

    Raises
    ------
    StatisticsError
        No axis, an axis or reference level that the cube does not have, or a level outside 0-1.

    Notes
    -----
    One axis is moved at a time, so that the effect of two together is not seen.
    """
    check_level(level)
    if variable not in cube:
        raise StatisticsError(f"the cube has no variable {variable!r}")
    found = [str(dim) for dim in cube[variable].dims if dim not in MARKER_DIMS]
    chosen = found if axes is None else list(axes)
    wrong = [axis for axis in chosen if axis not in found]
    if wrong or not chosen:
        raise StatisticsError(
            f"cannot compare along {names(wrong) or 'nothing'}: the cube has the further dims "
            f"{names(found) or 'none'}"
        )
    base = {axis: cube[axis].values[0] for axis in found} | dict(reference or {})
    for axis, label in base.items():
        if axis not in found or label not in cube[axis].values:
            raise StatisticsError(
                f"the reference {axis} = {label} is not in the cube, expected one of "
                f"{names([str(each) for each in cube[axis].values]) if axis in found else names(found)}"
            )
    data: list[Paired] = []
    of: list[tuple[str, str]] = []
    strategies = [str(label) for label in cube["strategy"].values]
    changes: list[list[float]] = []
    for axis in chosen:
        others = {other: label for other, label in base.items() if other != axis}
        # Scores carry the axes; what is the same for all levels, such as labels, does not.
        held = selected(cube[[variable, "status"]].assign_attrs(cube.attrs), others)
        held = held.drop_vars(list(others))
        for label in cube[axis].values:
            if label == base[axis]:
                continue
            each = paired(
                held, label, base[axis], dim=axis, variable=variable, scale=scale, limit=limit
            )
            data.append(Paired(f"{axis} = {_words(label)}", *_rest(each)))
            of.append((axis, _words(label)))
            per = each.differences.mean("repetition", skipna=True)
            per = per.mean([dim for dim in per.dims if dim not in ("volunteer", "strategy")])
            changes.append(per.mean("volunteer").transpose("strategy").values.tolist())
    joint = joint_p([each.means.values for each in data], DRAWS, seed)
    findings = [
        flip_finding(each, float(p), level, DRAWS, seed)
        for each, p in zip(data, joint, strict=True)
    ]
    units = str(cube[variable].attrs.get("units", "1"))
    attrs = {
        "variable": variable, "scale": "Fisher z" if scale == "z" else "as it is",
        "units": units, "origin": origin_of(cube), "seed": seed,
        "reference": ", ".join(f"{axis} = {_words(label)}" for axis, label in base.items()),
    }  # fmt: skip
    method = "level minus reference, sign-flip permutation over volunteers"
    result = collected(findings, method=method, level=level, attrs=attrs)
    result = result.rename({"contrast": "choice"})
    result["axis"] = ("choice", np.array([axis for axis, _ in of], dtype=str))
    result["level"] = ("choice", np.array([label for _, label in of], dtype=str))
    table = np.array(changes, dtype=np.float64).reshape(len(data), len(strategies))
    result["by_strategy"] = (("choice", "strategy"), table, {"units": units})
    result["strategy"] = strategies
    size = np.abs(result["estimate"].values)
    reach = [float(np.max(size[[each == axis for each, _ in of]], initial=0.0)) for axis in chosen]
    result["reach"] = ("axes", np.array(reach), {"units": units})
    result["axes"] = chosen
    result.attrs["summary"] = _summary(result)
    return result


def choices_table(found: xr.Dataset) -> Table:
    """List what every level of every axis changes.

    Parameters
    ----------
    found : xarray.Dataset
        Result of `sensitivity`.

    Returns
    -------
    Table
        One row per choice: axis, level, change, interval, p, joint p and volunteers.
    """
    variable = str(found.attrs["variable"])
    units, shown, factor, digits = SHOWN.get(variable, ("1", "1", 1.0, 2))
    if found.attrs["scale"] == "Fisher z":
        units, shown, factor = "1", "1", 1.0
    columns = (
        Column("axis"), Column("level"),
        *(Column(name, units, shown, factor, digits) for name in ("change", "lower", "upper")),
        Column("p", digits=3), Column("p joint", digits=3), Column("volunteers"), Column("pairs"),
    )  # fmt: skip
    rows: list[tuple[object, ...]] = []
    for index in range(found.sizes["choice"]):
        one = found.isel(choice=index)
        low, high = one["interval"].values.tolist()
        rows.append(
            (
                str(one["axis"].values), str(one["level"].values), float(one["estimate"]),
                float(low), float(high), float(one["p"]), float(one["p_joint"]), int(one["n"]),
                int(one["pairs"]),
            )
        )  # fmt: skip
    origin = str(found.attrs["origin"])
    return Table(
        f"change of {variable} with each choice, {recordings(origin)}",
        columns,
        tuple(rows),
        origin,
        f"Reference: {found.attrs['reference']}. One choice is moved at a time.",
    )


def _words(label: Any) -> str:
    """Write a level: a number without needless digits, 50000 and not 50000.0."""
    return f"{label:g}" if isinstance(label, float) else str(label)


def _rest(data: Paired) -> tuple[xr.DataArray, xr.DataArray, dict[str, int], str, float]:
    return data.differences, data.means, data.counts, data.unit, data.factor


def _summary(result: xr.Dataset) -> str:
    """Name the axes that move the variable, the farthest first, and those not shown to."""
    alpha = 1.0 - float(result.attrs["level"])
    variable = str(result.attrs["variable"])
    _, unit, factor, _ = SHOWN.get(variable, ("1", "1", 1.0, 2))
    unit = "" if unit == "1" else f" {unit}"
    moving: list[str] = []
    still: list[str] = []
    order = np.argsort(-result["reach"].values, kind="stable")
    for index in order:
        axis = str(result["axes"].values[index])
        here = result.isel(choice=np.flatnonzero(result["axis"].values == axis))
        text = f"{axis} (up to {factor * float(result['reach'][index]):.2f}{unit})"
        (moving if (here["p_joint"] <= alpha * (1 + 1e-9)).any() else still).append(text)
    parts = [f"{variable} moves with {names(moving, 20)}."] if moving else []
    parts += [f"No change of {variable} is shown with {names(still, 20)}."] if still else []
    return " ".join(parts)
