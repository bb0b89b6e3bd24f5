"""Conclusions under every varied choice: medians, order of strategies, gain over a template."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import xarray as xr

from analysis.axes import further_axes, reference_cube
from analysis.baselines import has_baselines
from analysis.flags import FLAGS
from analysis.statistics.skill import against_baselines
from analysis.tables import Column, Table, origin_of, recordings
from analysis.typed import selected, texts

OF_ALIGNMENT: Final = tuple(name for name in FLAGS if name != "inaccurate")
"""Flags of trials whose alignment may be incorrect."""
WITHOUT_FLAGGED: Final = ("flagged alignments", "left out")
REFERENCE: Final = ("reference", "")
Place = tuple[str, str]
"""Axis and level."""


def levels_of(cube: xr.Dataset) -> dict[Place, xr.Dataset]:
    """Trials at the reference, at every other level of every axis, and without flagged alignments.

    One axis at a time differs from its reference. Flagged trials are left out at the reference only,
    if there are any.
    """
    axes = further_axes(cube)
    base = reference_cube(cube)
    levels: dict[Place, xr.Dataset] = {REFERENCE: base}
    for axis in axes:
        others = {name: cube[name].values[0] for name in axes if name != axis}
        for label in cube[axis].values[1:]:
            one = selected(cube, others | {axis: label}).drop_vars(axes)
            text = f"{label:g}" if isinstance(label, float) else str(label)
            levels[axis, text] = one.assign_attrs(cube.attrs)
    flagged = _flagged(base)
    if flagged.any():
        levels[WITHOUT_FLAGGED] = base.assign(
            rho=base["rho"].where(~flagged),
            status=texts(base["status"].where(~flagged, "excluded")),
        )
    return levels


def _flagged(cube: xr.Dataset) -> xr.DataArray:
    """Return True for trials with a flag of their alignment."""
    flags = [cube[name] == 1.0 for name in OF_ALIGNMENT if name in cube]
    flagged = xr.zeros_like(cube["status"], dtype=bool)
    for one in flags:
        flagged = flagged | one
    return flagged


def robustness(cube: xr.Dataset, *, draws: int = 1000) -> xr.Dataset:
    """Median rho, order of the strategies and gain over the template under every choice.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube, with further axes if choices were varied.
    draws : int
        Bootstrap samples of the intervals of the gain (`analysis.statistics.skill.against_baselines`).

    Returns
    -------
    xarray.Dataset
        Dims choice, strategy, bound. ``axis`` and ``level`` (choice); ``median`` [1] of rho over
        trials and markers, ``trials`` with a score, ``rank`` of the strategy (1 for the highest
        median; NaN without scores), ``gain`` [1] over the template of all persons and
        ``gain_interval``, both NaN without baselines. The first choice is the reference.
    """
    parts: list[xr.Dataset] = []
    strategies = [str(label) for label in cube["strategy"].values]
    for one in levels_of(cube).values():
        ok = texts(one["status"]) == "ok"
        rho = one["rho"].where(ok)
        trials = rho.notnull().any("marker")
        medians = np.array(
            [_median(selected(rho, {"strategy": name}).values) for name in strategies]
        )
        order = np.argsort(np.argsort(-np.nan_to_num(medians, nan=-np.inf), kind="stable")) + 1.0
        gain, bounds = np.full(len(strategies), np.nan), np.full((len(strategies), 2), np.nan)
        if has_baselines(one) and bool(trials.any()):
            skill = against_baselines(one, draws=draws)
            gain, bounds = skill["gain_template"].values, skill["gain_template_interval"].values
        counts = [int(selected(trials, {"strategy": name}).sum()) for name in strategies]
        parts.append(
            xr.Dataset(
                {
                    "median": ("strategy", medians, {"units": "1"}),
                    "rank": ("strategy", np.where(np.isfinite(medians), order, np.nan)),
                    "trials": ("strategy", counts),
                    "gain": ("strategy", gain, {"units": "1"}),
                    "gain_interval": (("strategy", "bound"), bounds, {"units": "1"}),
                },
                coords={"strategy": strategies, "bound": ["lower", "upper"]},
            )
        )
    places = list(levels_of(cube))
    result = xr.concat(parts, dim="choice")
    result["axis"] = ("choice", [axis for axis, _ in places])
    result["level"] = ("choice", [level for _, level in places])
    reference = {name: _text(cube[name].values[0]) for name in further_axes(cube)}
    description = ", ".join(f"{name} = {value}" for name, value in reference.items())
    return result.assign_attrs(origin=origin_of(cube), reference=description)


def _text(label: Any) -> str:
    return f"{label:g}" if isinstance(label, float) else str(label)


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else np.nan


def robustness_table(compared: xr.Dataset) -> Table:
    """Tabulate the result of `robustness`, one row per choice and strategy."""
    columns = (
        Column("axis"), Column("level"), Column("strategy"), Column("median rho"), Column("rank"),
        Column("gain over all persons"), Column("lower"), Column("upper"), Column("trials"),
    )  # fmt: skip
    rows: list[tuple[object, ...]] = []
    for index in range(compared.sizes["choice"]):
        one = compared.isel(choice=index)
        for k, strategy in enumerate(compared["strategy"].values.tolist()):
            rank = float(one["rank"].values[k])
            low, high = one["gain_interval"].values[k].tolist()
            rows.append(
                (
                    str(one["axis"].values), str(one["level"].values) or "-", strategy,
                    float(one["median"].values[k]), int(rank) if np.isfinite(rank) else "-",
                    float(one["gain"].values[k]), low, high, int(one["trials"].values[k]),
                )
            )  # fmt: skip
    origin = str(compared.attrs["origin"])
    return Table(
        f"conclusions under every choice, {recordings(origin)}",
        columns,
        tuple(rows),
        origin,
        f"Reference: {compared.attrs['reference'] or 'the parameters of the study'}. One choice at a "
        "time differs from it. Gain: rho minus that of the template of infinitely many persons, with "
        "its 95 % interval over volunteers, which requires enough of them. An interval that contains 0 "
        "shows no gain. Trials: with a score.",
    )


def robustness_sentences(compared: xr.Dataset) -> list[str]:
    """State which conclusions of the reference hold under every choice, and which do not."""
    places = [
        " = ".join(filter(None, (str(a), str(b))))
        for a, b in zip(compared["axis"].values, compared["level"].values, strict=True)
    ]
    sentences: list[str] = []
    orders = [_order(compared.isel(choice=k)) for k in range(compared.sizes["choice"])]
    if compared.sizes["strategy"] > 1:
        other = {places[k]: orders[k] for k in range(1, len(orders)) if orders[k] != orders[0]}
        sentences.append(
            f"Order of the medians at the reference: {orders[0]}. "
            + (
                "It is the same under every choice."
                if not other
                else f"It changes with {_listed(other)}."
            )
        )
    medians = compared["median"].values
    if np.isfinite(medians).any():
        spans = [
            f"{name} {np.nanmin(column):.2f} to {np.nanmax(column):.2f}"
            for name, column in zip(compared["strategy"].values, medians.T, strict=True)
            if np.isfinite(column).any()
        ]
        sentences.append("Range of the medians over all choices: " + ", ".join(spans) + ".")
    for name in compared["strategy"].values.tolist():
        bounds = selected(compared["gain_interval"], {"strategy": name}).values
        said = [_said(low, high) for low, high in bounds.tolist()]
        if said[0] == "":
            continue
        other = {
            places[k]: f"{said[k]} it" for k in range(1, len(said)) if said[k] not in ("", said[0])
        }
        sentences.append(
            f"{name}: at the reference, rho is {said[0]} that of a template without EMG"
            + (
                ", and so it is under every choice."
                if not other
                else f"; this changes with {_listed(other)}."
            )
        )
    return sentences


def _listed(other: Mapping[str, str]) -> str:
    return "; ".join(f"{at}: {what}" for at, what in other.items())


def _order(one: xr.Dataset) -> str:
    rank = one["rank"].values
    known = np.argsort(np.where(np.isfinite(rank), rank, np.inf))[: int(np.isfinite(rank).sum())]
    return " > ".join(str(one["strategy"].values[k]) for k in known)


def _said(low: float, high: float) -> str:
    if not np.isfinite(low):
        return ""
    return "above" if low > 0.0 else "below" if high < 0.0 else "not distinguishable from"
