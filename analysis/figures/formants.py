"""Figure of the formants of a study over time."""

from collections.abc import Mapping
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.errors import FigureError
from analysis.figures.style import COLOURS, blank, grid, heading, legend, styled
from analysis.tables import origin_of
from analysis.typed import selected

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LINE_STYLES = ("-", "--", ":", "-.")


@styled
def formant_plot(cube: xr.Dataset, *, labels: Mapping[str, str] | None = None) -> "Figure":
    """Draw F1 and F2 over the duration of the trials, per instruction and strategy.

    Parameters
    ----------
    cube : xarray.Dataset
        With ``formant_frequency``, without further axes.
    labels : mapping, optional
        Title of the panels of an instruction, in place of its label.

    Returns
    -------
    matplotlib.figure.Figure
        Medians over volunteers and repetitions, and bands between the quartiles.

    Raises
    ------
    FigureError
        The cube contains no formants.
    """
    if "formant_frequency" not in cube or not np.isfinite(cube["formant_frequency"].values).any():
        raise FigureError("the cube contains no formants: add a table [tract] to study.toml")
    instructions = cube["instruction"].values
    figure = blank(max(7.5, 1.2 + 1.5 * len(instructions)), 4.6)
    panels = grid(figure, 2, len(instructions), sharex=True, sharey="row")
    lines: dict[str, Any] = {}
    for column, instruction in enumerate(instructions):
        for row, number in enumerate((2, 1)):
            panel = panels[row][column]
            for k, strategy in enumerate(cube["strategy"].values):
                where = {"instruction": instruction, "strategy": strategy, "formant": number}
                one = selected(cube, where)["formant_frequency"]
                values = one.transpose(..., "instant").values.reshape(-1, cube.sizes["instant"])
                line = _band(panel, cube["instant"].values, values, k)
                if line is not None:
                    lines.setdefault(str(strategy), line)
            if column == 0:
                panel.set_ylabel(f"F{number} [Hz]")
        panels[0][column].set_title(
            fill((labels or {}).get(str(instruction), str(instruction)), 16)
        )
        panels[1][column].set_xlabel("part of the trial")
    legend(figure, list(lines.values()), list(lines))
    heading(figure, "formants", origin_of(cube))
    return figure


def _band(panel: Any, x: NDArray[np.float64], values: NDArray[np.float64], k: int) -> Any:
    """Median over rows as a line in the style number `k`, quartiles as a band; None without rows."""
    known = values[np.isfinite(values).all(axis=1)]
    if not len(known):
        return None
    low, middle, high = np.quantile(known, [0.25, 0.5, 0.75], axis=0)
    colour = COLOURS[k % 7]
    panel.fill_between(x, low, high, color=colour, alpha=0.25, linewidth=0)
    return panel.plot(x, middle, color=colour, linestyle=LINE_STYLES[k % 4])[0]
