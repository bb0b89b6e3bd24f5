"""Muscle activations: one trial as a heat map, all trials as box plots."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.errors import FigureError
from analysis.figures.style import (
    COLOURS,
    HATCHES,
    SHADES,
    blank,
    boxes,
    grid,
    heading,
    legend,
    styled,
    ticks,
    trial_label,
)
from analysis.statistics.finding import persons
from analysis.tables import origin_of
from analysis.trajectory import names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIDE_TITLES: Final = {"L": "left", "R": "right"}


@styled
def activation_heat_map(activation: xr.Dataset) -> "Figure":
    """Draw the activation of every muscle over time.

    Parameters
    ----------
    activation : xarray.Dataset
        ``activation`` (muscle, time) [1], 0 to 1, time in seconds; attributes origin and, if known,
        volunteer, instruction, repetition, strategy.

    Returns
    -------
    matplotlib.figure.Figure
        One row per muscle; the labels of muscles without activation are grey.

    Raises
    ------
    FigureError
        The variable is missing or has other dims.
    """
    data = _over_time(activation, "activation")
    muscles = [str(label) for label in data["muscle"].values]
    values, time = data.values, data["time"].values
    figure = blank(7.0, 1.2 + 0.19 * len(muscles))
    panel = grid(figure)[0][0]
    step = (time[-1] - time[0]) / max(1, len(time) - 1)
    edges = np.concatenate([time - step / 2, [time[-1] + step / 2]])
    rows = np.arange(len(muscles) + 1) - 0.5
    mesh = panel.pcolormesh(edges, rows, values, cmap=SHADES, vmin=0.0, vmax=1.0, rasterized=True)
    panel.invert_yaxis()
    ticks(panel, "y", range(len(muscles)), muscles)
    for label, row in zip(panel.get_yticklabels(), values, strict=True):
        label.set_color("black" if row.any() else "0.6")
    sides = [muscle.rpartition("_")[2] for muscle in muscles]
    for place in range(1, len(muscles)):
        if sides[place] != sides[place - 1]:
            panel.axhline(place - 0.5, color="white", linewidth=1.5)
    panel.set_xlabel("time [s]")
    panel.tick_params(axis="y", length=0)
    cast(Any, figure).colorbar(mesh, ax=panel, label="activation", pad=0.02)
    heading(figure, f"muscle activation {trial_label(activation)}", origin_of(activation))
    return figure


@styled
def feature_boxes(
    activations: Iterable[xr.Dataset],
    *,
    variable: str = "activation",
    labels: Mapping[str, str] | None = None,
) -> "Figure":
    """Draw the distribution of normalised features per muscle, one panel per instruction.

    Boxes span the quartiles of all samples of all trials of an instruction, with the median as a
    line and the mean as a dot; whiskers span the 5th to the 95th percentile, and samples beyond are
    not drawn.

    Parameters
    ----------
    activations : iterable of xarray.Dataset
        One per trial: `variable` (muscle, time) [1]; attribute ``instruction`` and, if known,
        ``volunteer``.
    variable : str
        Name of the variable.
    labels : mapping, optional
        Title of the panel of an instruction, in place of its label.

    Returns
    -------
    matplotlib.figure.Figure
        Muscles whose names end in _L and _R share a position, left next to right.

    Raises
    ------
    FigureError
        No trial, other muscles, a missing attribute, or measured and simulated trials together.

    Notes
    -----
    After Fig. 5 of Eskes et al. 2017.
    """
    from matplotlib.patches import Patch

    groups: dict[str, list[xr.Dataset]] = {}
    for trial in activations:
        _over_time(trial, variable)
        if "instruction" not in trial.attrs:
            raise FigureError("a trial has no attribute 'instruction': it cannot be grouped")
        groups.setdefault(str(trial.attrs["instruction"]), []).append(trial)
    if not groups:
        raise FigureError("there are no trials to draw")
    every = [trial for group in groups.values() for trial in group]
    muscles = [str(label) for label in every[0]["muscle"].values]
    if any([str(label) for label in trial["muscle"].values] != muscles for trial in every):
        raise FigureError("the trials have different muscles, expected the same in each")
    origins = {origin_of(trial) for trial in every}
    if len(origins) > 1:
        raise FigureError("measured and simulated trials cannot share a figure: draw one of each")
    parts = [muscle.rpartition("_") for muscle in muscles]
    stems = [stem if side in SIDE_TITLES else stem + gap + side for stem, gap, side in parts]
    places = list(dict.fromkeys(stems))
    sides = [side for side in SIDE_TITLES if any(part[2] == side for part in parts)]
    columns = 1 if len(groups) < 3 else 2
    rows = -(-len(groups) // columns)
    figure = blank(max(3.9 * columns + 0.6, 5.5), 0.7 + 2.0 * rows)
    axes = [panel for row in grid(figure, rows, columns, sharex=True, sharey=True) for panel in row]
    for panel, (instruction, trials) in zip(axes, sorted(groups.items()), strict=False):
        groups_of: dict[int, dict[float, NDArray[np.float64]]] = {}
        for index, (stem, (_, _, side)) in enumerate(zip(stems, parts, strict=True)):
            values = np.concatenate([trial[variable].transpose("muscle", "time").values[index]
                                     for trial in trials])  # fmt: skip
            paired = side in SIDE_TITLES
            which = sides.index(side) if paired else 0
            shift = (which - (len(sides) - 1) / 2) * 0.4 if paired else 0.0
            groups_of.setdefault(which, {})[places.index(stem) + shift] = values
        for which, samples in groups_of.items():
            boxes(panel, samples, 0.34, which, whiskers=(5, 95))
        people = {str(trial.attrs.get("volunteer", "")) for trial in trials} - {""}
        count = f"{len(trials)} trial{'s' * (len(trials) > 1)}"
        count += f", {persons(len(people))}" if people else ""
        panel.set_title(f"{(labels or {}).get(instruction, instruction)} ({count})")
        if variable == "activation":
            panel.set_ylim(-0.03, 1.03)
        ticks(panel, "x", range(len(places)), places)
        panel.tick_params(axis="x", rotation=60)
    for panel in axes[len(groups) :]:
        panel.set_visible(False)
    for row in range(rows):
        axes[row * columns].set_ylabel("normalised" if variable == "activation" else variable)
    if sides:
        patches = [
            Patch(
                facecolor=COLOURS[i], hatch=HATCHES[i], edgecolor="black", label=SIDE_TITLES[side]
            )
            for i, side in enumerate(sides)
        ]
        legend(figure, patches)
    what = "normalised features" if variable == "activation" else variable
    heading(figure, f"{what} per muscle and instruction", origins.pop())
    return figure


@styled
def difference_map(pairs: Mapping[str, Sequence[tuple[xr.Dataset, xr.Dataset]]]) -> "Figure":
    """Draw where the activations of strategies differ from those of another one.

    Parameters
    ----------
    pairs : mapping of str to sequence of (Dataset, Dataset)
        For every strategy, one pair per trial: its ``activation`` (muscle, time) [1] and that of the
        strategy with which it is compared; attributes ``instruction``, ``origin`` and, of the second,
        ``strategy``.

    Returns
    -------
    matplotlib.figure.Figure
        For every strategy two panels over muscle and instruction: the mean difference, and the
        correlation over time, both means over the trials; grey where an activation does not change.

    Raises
    ------
    FigureError
        There is no trial, or a variable or attribute is missing.
    """
    each = [pair for trials in pairs.values() for pair in trials]
    if not each:
        raise FigureError("there are no trials to draw")
    muscles = [str(label) for label in each[0][0]["muscle"].values]
    instructions = sorted({str(one.attrs["instruction"]) for one, _ in each})
    width = 1.4 + len(pairs) * (1.6 + 0.5 * len(instructions))
    figure = blank(max(width, 6.4), 1.4 + 0.19 * len(muscles))  # the title has 6 inches
    panels = grid(figure, 1, 2 * len(pairs), sharey=True)[0]
    other, mesh = str(each[0][1].attrs.get("strategy", "the other")), None
    for k, (strategy, trials) in enumerate(pairs.items()):
        maps = np.full((2, len(muscles), len(instructions)), np.nan)
        for column, instruction in enumerate(instructions):
            both = [_compared(*p) for p in trials if p[0].attrs["instruction"] == instruction]
            if both:
                known = np.isfinite(both)
                total = np.where(known, both, 0.0).sum(axis=0)
                maps[:, :, column] = total / np.where(known.any(axis=0), known.sum(axis=0), np.nan)
        for panel, values, title in zip(
            panels[2 * k :], maps, ("mean difference", "correlation"), strict=False
        ):
            panel.set_facecolor("0.85")
            mesh = panel.pcolormesh(values, cmap="PuOr_r", vmin=-1.0, vmax=1.0)
            sign = "\u2212" if title == "mean difference" else "and"
            panel.set_title(f"{strategy} {sign} {other}\n{title}")
            ticks(panel, "x", [i + 0.5 for i in range(len(instructions))], instructions)
            ticks(panel, "y", [i + 0.5 for i in range(len(muscles))], muscles)
            panel.tick_params(length=0)
    panels[0].invert_yaxis()
    cast(Any, figure).colorbar(mesh, ax=panels, pad=0.02)
    origins = {origin_of(one) for one, _ in each}
    heading(figure, f"activations compared with {other}", origins.pop())
    return figure


def _compared(one: xr.Dataset, other: xr.Dataset) -> NDArray[np.float64]:
    """Mean difference and correlation over time (2, muscle) of two activations."""
    a, b = _over_time(one, "activation"), _over_time(other, "activation")
    if list(a["muscle"].values) != list(b["muscle"].values):
        raise FigureError("the trials have different muscles, expected the same in each")
    time, given = a["time"].values, b["time"].values
    inside = (time >= given[0]) & (time <= given[-1])
    x = a.values[:, inside]
    at, rows = np.asarray(time[inside], dtype=np.float64), np.asarray(b.values, dtype=np.float64)
    y = np.zeros((len(rows), len(at)))
    for k, row in enumerate(rows):
        y[k] = np.interp(at, given, row)
    u, v = x - x.mean(axis=1, keepdims=True), y - y.mean(axis=1, keepdims=True)
    size = np.sqrt((u**2).sum(axis=1) * (v**2).sum(axis=1))
    moving = size > 1e-12
    r = np.where(moving, (u * v).sum(axis=1) / np.where(moving, size, 1.0), np.nan)
    return np.array([(x - y).mean(axis=1), r])


def _over_time(data: xr.Dataset, variable: str) -> xr.DataArray:
    """Return a variable over muscle and time, or raise."""
    if variable not in data or set(data[variable].dims) != {"muscle", "time"}:
        present = [f"{name} {tuple(map(str, each.dims))}" for name, each in data.data_vars.items()]
        raise FigureError(
            f"expected a variable {variable!r} with dims (muscle, time), found "
            f"{names(present) or 'none'}"
        )
    return data[variable].transpose("muscle", "time")
