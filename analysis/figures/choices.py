"""Figure of the effects of open choices on scores, with their tests."""

from textwrap import wrap
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import xarray as xr

from analysis.errors import FigureError
from analysis.figures.style import COLOURS, MARKS, blank, grid, heading, legend, styled, ticks
from analysis.tables import TABLE_UNITS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def sensitivity_plot(effects: xr.Dataset) -> "Figure":
    """Draw the change with every level of every axis, the axis with the largest change on top.

    Parameters
    ----------
    effects : xarray.Dataset
        Result of `analysis.sensitivity.sensitivity`.

    Returns
    -------
    matplotlib.figure.Figure
        Per choice and strategy the mean change with its interval; the mark is open if the change is
        not significant after Holm's correction.

    Raises
    ------
    FigureError
        The dataset is not a result of `sensitivity`, or contains no choice.
    """
    if "reach" not in effects or not effects.sizes.get("choice"):
        raise FigureError("expected the result of analysis.sensitivity with at least one choice")
    from matplotlib.lines import Line2D

    variable = str(effects.attrs["variable"])
    _, unit, factor, _ = TABLE_UNITS.get(variable, ("1", "1", 1.0, 2))
    unit = "Fisher z" if effects.attrs["scale"] == "Fisher z" else unit
    reach = dict(
        zip(effects["axes"].values.tolist(), effects["reach"].values.tolist(), strict=True)
    )
    strategies = list(dict.fromkeys(str(label) for label in effects["strategy"].values))
    kinds = [
        (str(a), str(b))
        for a, b in zip(effects["axis"].values, effects["level"].values, strict=True)
    ]
    order = sorted(dict.fromkeys(kinds), key=lambda kind: (-reach[kind[0]], kind[0]))
    places: dict[tuple[str, str], float] = {}
    for kind, before in zip(order, [None, *order], strict=False):
        gap = 0.0 if before is None else (1.0 if kind[0] == before[0] else 1.6)
        places[kind] = (places[before] if before else 0.0) + gap
    last = places[order[-1]]
    figure = blank(7.5, 1.3 + (0.3 + 0.2 * len(strategies)) * (last + 1))
    panel = grid(figure)[0][0]
    panel.axvline(0.0, color="0.5", linewidth=0.8, zorder=0)
    alpha = 1.0 - float(effects.attrs["level"])
    apart = 0.7 / len(strategies)
    for k, kind in enumerate(kinds):
        one = effects.isel(choice=k)
        i = strategies.index(str(one["strategy"].values))
        place = places[kind] + (i - (len(strategies) - 1) / 2) * apart
        low, high = factor * one["interval"].values
        if np.isfinite([low, high]).all():
            panel.plot([low, high], [place, place], color=COLOURS[i % 7], linewidth=1.4, zorder=2)
        shown = float(one["p_holm"]) <= alpha * (1 + 1e-9)
        panel.plot(
            [factor * float(one["estimate"])], [place], MARKS[(i + 1) % 7], color=COLOURS[i % 7],
            markersize=6, markerfacecolor=COLOURS[i % 7] if shown else "white", zorder=4,
        )  # fmt: skip
    texts = [f"{axis} = {level}".replace("_", " ") for axis, level in order]
    ticks(panel, "y", [places[kind] for kind in order], texts)
    panel.set_ylim(last + 0.7, -0.7)
    named = variable.replace("_", " ")
    panel.set_xlabel(f"change of {named}" + (f" [{unit}]" if unit != "1" else ""))
    handles: list[Any] = [
        Line2D(
            [], [], linestyle="", marker=MARKS[(i + 1) % 7], color=COLOURS[i % 7], label=strategy
        )
        for i, strategy in enumerate(strategies)
    ]
    handles.append(
        Line2D([], [], linestyle="", marker="o", color="black", markerfacecolor="white",
               label=f"open: p above {alpha:.2g} after Holm")
    )  # fmt: skip
    legend(figure, handles, most=4)
    reference = f"reference: {effects.attrs['reference']}".replace("_", " ")
    panel.set_title("\n".join(wrap(reference, 80)), fontsize="small")
    heading(figure, f"effect of the choices on {named}", str(cast(Any, effects.attrs)["origin"]))
    return figure
