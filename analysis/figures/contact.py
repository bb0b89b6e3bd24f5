"""How the lips close with and without contact."""

from typing import TYPE_CHECKING, Any, cast

import numpy as np
import xarray as xr

from analysis.errors import FigureError
from analysis.figures.style import COLOURS, blank, grid, legend, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LINES = ("-", "--", "-.", ":")
ACROSS = 3


@styled
def opening_over_time(found: xr.Dataset, *, title: str = "") -> "Figure":
    """Draw the opening of the lips over time, one panel per case.

    Parameters
    ----------
    found : xarray.Dataset
        ``opening(case, contact, time)`` [m], below zero where the lips have passed each other.
    title : str
        Names the face.

    Returns
    -------
    matplotlib.figure.Figure
        One line per kind of contact.

    Raises
    ------
    FigureError
        Other dims.
    """
    if "opening" not in found or set(found["opening"].dims) != {"case", "contact", "time"}:
        raise FigureError("expected opening with dims case, contact and time")
    cases = [str(case) for case in found["case"].values]
    columns = min(ACROSS, len(cases))
    rows = -(-len(cases) // columns)
    figure = blank(2.4 * columns + 0.8, 2.0 * rows + 0.8)
    panels = [panel for row in grid(figure, rows, columns, sharex=True) for panel in row]
    handles: list[Any] = []
    opening = found["opening"].transpose("case", "contact", "time").values
    time = np.asarray(found["time"].values, dtype=np.float64)
    for panel, case, lines in zip(panels, cases, opening, strict=False):
        handles = []
        for i, name in enumerate(map(str, found["contact"].values)):
            look = {"color": COLOURS[i % 7], "linestyle": LINES[i % 4]}
            label = "no contact" if name == "none" else name
            handles += panel.plot(time, 1e3 * lines[i], label=label, **look)
        panel.axhline(0.0, color="0.6", linewidth=0.6)
        panel.set_title(case if len(case) > 1 else f"instruction {case}")
        panel.set_xlabel("time [s]")
        panel.set_ylabel("opening [mm]")
    for panel in panels[len(cases) :]:
        panel.set_visible(False)
    legend(figure, handles)
    cast(Any, figure).suptitle(title or "opening of the lips (simulated)")
    return figure
