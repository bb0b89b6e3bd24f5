"""How run time grows with the size of a mesh."""

from typing import TYPE_CHECKING, Any, cast

import numpy as np
import xarray as xr

from analysis.errors import FigureError
from analysis.figures.style import COLOURS, MARKS, blank, grid, legend, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def growth(found: xr.Dataset, *, title: str = "") -> "Figure":
    """Draw the time of every phase of a step against the number of elements.

    Parameters
    ----------
    found : xarray.Dataset
        ``seconds(mesh, phase)`` [s], ``exponent(phase)`` and the coord ``elements(mesh)``.
    title : str
        Names the scene.

    Returns
    -------
    matplotlib.figure.Figure
        Both axes logarithmic; the fitted exponents stand in the legend.

    Raises
    ------
    FigureError
        Other dims.
    """
    if "seconds" not in found or set(found["seconds"].dims) != {"mesh", "phase"}:
        raise FigureError("expected seconds with dims mesh and phase")
    elements = np.asarray(found["elements"].values, dtype=np.float64)
    figure = blank(6.0, 4.0)
    panel = grid(figure)[0][0]
    handles: list[Any] = []
    seconds = found["seconds"].transpose("phase", "mesh").values
    exponents = found["exponent"].values
    for i, phase in enumerate(map(str, found["phase"].values)):
        handles += panel.plot(
            elements,
            1e3 * seconds[i],
            marker=MARKS[i % 7],
            color=COLOURS[i % 7],
            linewidth=2.0 if phase == "step" else 1.0,
            label=f"{phase}, exponent {exponents[i]:.2f}",
        )
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_xlabel("elements")
    panel.set_ylabel("time [ms]")
    panel.grid(which="major", color="0.9", linewidth=0.6)
    legend(figure, handles)
    cast(Any, figure).suptitle(title or "growth of a step (simulated)")
    return figure
