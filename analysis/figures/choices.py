"""How far the open choices of a study move its scores, and what the tests say."""

from textwrap import wrap
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import xarray as xr

from analysis.errors import FigureError
from analysis.figures.style import COLOURS, MARKS, blank, grid, heading, legend, styled, ticks
from analysis.tables import SHOWN
from analysis.typed import selected

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def sensitivity_plot(found: xr.Dataset) -> "Figure":
    """Draw the change that every level of every axis makes, the farthest-reaching axis on top.

    Parameters
    ----------
    found : xarray.Dataset
        Result of `analysis.sensitivity.sensitivity`.

    Returns
    -------
    matplotlib.figure.Figure
        Per choice the mean change with its interval in black (open where it is not shown to
        differ from zero) and the change of each strategy in colour.

    Raises
    ------
    FigureError
        The dataset is no result of `sensitivity`, or holds no choice.
    """
    if "by_strategy" not in found or not found.sizes.get("choice"):
        raise FigureError("expected the result of analysis.sensitivity with at least one choice")
    from matplotlib.lines import Line2D

    variable = str(found.attrs["variable"])
    _, unit, factor, _ = SHOWN.get(variable, ("1", "1", 1.0, 2))
    unit = "Fisher z" if found.attrs["scale"] == "Fisher z" else unit
    reach = dict(zip(found["axes"].values.tolist(), found["reach"].values.tolist(), strict=True))
    axis = [str(label) for label in found["axis"].values]
    order = sorted(range(len(axis)), key=lambda k: (-reach[axis[k]], axis[k], k))
    places: list[float] = []
    for rank, k in enumerate(order):
        gap = 0.0 if rank == 0 else (1.0 if axis[k] == axis[order[rank - 1]] else 1.6)
        places.append((places[-1] if places else 0.0) + gap)
    figure = blank(7.5, 1.3 + 0.5 * (places[-1] + 1))
    panel = grid(figure)[0][0]
    panel.axvline(0.0, color="0.5", linewidth=0.8, zorder=0)
    alpha = 1.0 - float(found.attrs["level"])
    strategies = [str(label) for label in found["strategy"].values]
    for place, k in zip(places, order, strict=True):
        one = found.isel(choice=k)
        low, high = factor * one["interval"].values
        if np.isfinite([low, high]).all():
            panel.plot([low, high], [place, place], color="black", linewidth=1.4, zorder=2)
        shown = float(one["p_joint"]) <= alpha * (1 + 1e-9)
        panel.plot(
            [factor * float(one["estimate"])], [place], "o", color="black", markersize=6,
            markerfacecolor="black" if shown else "white", zorder=4,
        )  # fmt: skip
        for i, strategy in enumerate(strategies):
            value = factor * float(selected(one["by_strategy"], {"strategy": strategy}))
            panel.plot(
                [value], [place + 0.18 * (i + 1)], MARKS[(i + 1) % 7], color=COLOURS[i % 7],
                markersize=5, markeredgecolor="black", markeredgewidth=0.4, zorder=3,
            )  # fmt: skip
    texts = [f"{axis[k]} = {found['level'].values[k]}".replace("_", " ") for k in order]
    ticks(panel, "y", places, texts)
    panel.set_ylim(places[-1] + 0.18 * (len(strategies) + 1.5), -0.5)
    panel.set_xlabel(f"change of {variable}" + (f" [{unit}]" if unit != "1" else ""))
    handles: list[Any] = [
        Line2D([], [], color="black", marker="o", label="all strategies, joint p small"),
        Line2D([], [], color="black", marker="o", markerfacecolor="white", label="not shown"),
    ]
    handles += [
        Line2D([], [], linestyle="", marker=MARKS[(i + 1) % 7], color=COLOURS[i % 7],
               markeredgecolor="black", markeredgewidth=0.4, label=strategy)
        for i, strategy in enumerate(strategies)
    ]  # fmt: skip
    handles[0].set_label(f"all strategies, joint p at most {alpha:.2g}")
    legend(figure, handles, most=3)
    reference = f"reference: {found.attrs['reference']}".replace("_", " ")
    panel.set_title("\n".join(wrap(reference, 80)), fontsize="small")
    heading(figure, f"what moves {variable}", str(cast(Any, found.attrs)["origin"]))
    return figure
