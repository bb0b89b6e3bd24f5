"""Figure of rho of every strategy with its baselines and ceiling."""

from collections.abc import Mapping
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from analysis.baselines import has_baselines
from analysis.descriptives import mean_defined
from analysis.errors import FigureError
from analysis.figures.style import (
    COLOURS,
    MARKS,
    blank,
    grid,
    heading,
    legend,
    logarithmic,
    styled,
    ticks,
)
from analysis.tables import origin_of
from analysis.typed import selected, status_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def baseline_plot(cube: xr.Dataset, *, labels: Mapping[str, str] | None = None) -> "Figure":
    """Draw rho with template, ceiling and nulls, per instruction and strategy.

    Parameters
    ----------
    cube : xarray.Dataset
        With baselines, without further axes.
    labels : mapping, optional
        Text at the axis for an instruction, in place of its label.

    Returns
    -------
    matplotlib.figure.Figure
        Above, rho; below, 1 - rho on a logarithmic axis, which resolves values near 1. Large marks
        are means over volunteers, small ones individual values; the band spans the range from template
        to ceiling.

    Raises
    ------
    FigureError
        The cube contains no baselines.
    """
    if not has_baselines(cube):
        raise FigureError("the cube contains no baselines: run the study again with this version")
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    instructions = [str(label) for label in cube["instruction"].values]
    strategies = [str(label) for label in cube["strategy"].values]
    figure = blank(max(6.5, 1.2 + 1.15 * len(instructions)), 7.0)
    panels = [row[0] for row in grid(figure, 2, 1, height_ratios=[1.0, 1.0], sharex=True)]
    for panel, near_one in zip(panels, (False, True), strict=True):
        for place, instruction in enumerate(instructions):
            _instruction(panel, selected(cube, {"instruction": instruction}), place, near_one)
        text = [fill((labels or {}).get(one, one), 14) for one in instructions]
        ticks(panel, "x", range(len(instructions)), text)
        panel.set_xlim(-0.6, len(instructions) - 0.4)
    panels[0].set_ylabel("rho")
    panels[0].axhline(0.0, color="0.6", linewidth=0.8, zorder=0)
    panels[1].set_ylabel("1 - rho (better is up)")
    logarithmic(panels[1])
    panels[1].invert_yaxis()
    panels[1].set_xlabel("instruction")
    handles: list[Any] = [
        Patch(facecolor="0.88", label="range from template to ceiling"),
        Line2D([], [], color="black", linewidth=2, label="template: other volunteers, no EMG"),
        Line2D([], [], color="black", linewidth=1.2, linestyle=":", label="ceiling of repetitions"),
    ]
    handles += [
        Line2D([], [], linestyle="", marker=MARKS[i % 7], color=COLOURS[i % 7],
               markeredgecolor="black", markeredgewidth=0.5, label=name)
        for i, name in enumerate(strategies)
    ]  # fmt: skip
    handles += [
        Line2D([], [], linestyle="", marker="_", color="black", markersize=9,
               label="EMG of another repetition"),
        Line2D([], [], linestyle="", marker="x", color="0.35", markersize=5,
               label="wrong instruction, mean"),
        Line2D([], [], linestyle="", marker="2", color="0.35", markersize=7,
               label="wrong instruction, best"),
    ]  # fmt: skip
    legend(figure, handles)
    heading(figure, "rho and its baselines", origin_of(cube))
    return figure


def _instruction(panel: Any, cube: xr.Dataset, place: int, near_one: bool) -> None:
    """Draw one instruction: the band, then strategies side by side."""

    def shown(value: float) -> float:
        return max(1.0 - value, 1e-4) if near_one else value

    low, high = mean_defined(cube["template_rho"]), mean_defined(cube["ceiling"])
    edges = (place - 0.45, place + 0.45)
    if np.isfinite(low) and np.isfinite(high):
        panel.fill_between(edges, shown(low), shown(high), color="0.88", linewidth=0, zorder=0)
    if np.isfinite(low):
        panel.plot(edges, [shown(low)] * 2, color="black", linewidth=2, zorder=1)
    if np.isfinite(high):
        panel.plot(edges, [shown(high)] * 2, color="black", linewidth=1.2, linestyle=":", zorder=1)
    strategies = cube["strategy"].values
    for i, strategy in enumerate(strategies):
        one = selected(cube, {"strategy": strategy})
        one = one.where(status_of(one) == "ok")
        x = place + (i - (len(strategies) - 1) / 2) * 0.8 / len(strategies)
        rho = one["rho"].mean(["marker", "repetition"], skipna=True).values
        rho = rho[np.isfinite(rho)]
        if not len(rho):
            continue
        colour = COLOURS[i % 7]
        side = x + 0.25 * 0.8 / len(strategies)
        panel.plot([side] * len(rho), [shown(v) for v in rho], ".", color=colour, markersize=4)
        panel.plot(
            [x], [shown(float(rho.mean()))], MARKS[i % 7], color=colour, markersize=8,
            markeredgecolor="black", markeredgewidth=0.6, zorder=4,
        )  # fmt: skip
        for name, mark, ink, size in (
            ("shuffled_rho", "_", "black", 13), ("wrong_rho", "x", "0.35", 5),
            ("wrong_rho_max", "2", "0.35", 7),
        ):  # fmt: skip
            value = mean_defined(one[name])
            if np.isfinite(value):
                panel.plot([x], [shown(value)], mark, color=ink, markersize=size, zorder=5)
