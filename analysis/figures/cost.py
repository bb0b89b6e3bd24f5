"""What the parts of a scene cost."""

from typing import TYPE_CHECKING, Any, cast

import numpy as np
import xarray as xr

from analysis.errors import FigureError
from analysis.figures.style import COLOURS, HATCHES, blank, grid, legend, styled, ticks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STACKED = ("tangent", "factorisation", "solution")
NEW = "step with a new factor"


@styled
def cost_of_parts(found: xr.Dataset, *, title: str = "") -> "Figure":
    """Draw the time of a step of every scene, and of its phases.

    Parameters
    ----------
    found : xarray.Dataset
        ``seconds(scene, phase)`` [s] with the phases tangent, factorisation, solution, step and, if
        there is one, step with a new factor.
    title : str
        Names the face.

    Returns
    -------
    matplotlib.figure.Figure
        One bar per scene, divided into its phases; what is left of the step is its rest. What a new
        factor adds stands empty.

    Raises
    ------
    FigureError
        Other dims or phases.
    """
    from matplotlib.patches import Patch

    if "seconds" not in found or set(found["seconds"].dims) != {"scene", "phase"}:
        raise FigureError("expected seconds with dims scene and phase")
    phases = [str(p) for p in found["phase"].values]
    missing = [p for p in (*STACKED, "step") if p not in phases]
    if missing:
        raise FigureError(f"the phase {missing[0]} is missing")
    milli = 1e3 * found["seconds"].transpose("scene", "phase").values
    parts = [milli[:, phases.index(p)] for p in STACKED]
    whole = milli[:, phases.index("step")]
    parts.append(np.maximum(whole - np.sum(parts, axis=0), 0.0))
    labels = [str(s) for s in found["scene"].values]
    figure = blank(7.0, 1.0 + 0.3 * len(labels))
    panel = grid(figure)[0][0]
    place, left = np.arange(len(labels)), np.zeros(len(labels))
    handles: list[Any] = []
    for i, (name, width) in enumerate(zip((*STACKED, "rest"), parts, strict=True)):
        look: dict[str, Any] = {"facecolor": COLOURS[i], "hatch": HATCHES[i], "edgecolor": "white"}
        panel.barh(place, width, 0.75, left=left, **look)
        handles.append(Patch(label=name, **look))
        left = left + width
    if NEW in phases:
        more = np.maximum(milli[:, phases.index(NEW)] - left, 0.0)
        empty: dict[str, Any] = {"facecolor": "none", "edgecolor": "0.4", "linestyle": ":"}
        panel.barh(place, more, 0.75, left=left, **empty)
        handles.append(Patch(label="where a new factor is made", **empty))
    ticks(panel, "y", range(len(labels)), labels)
    panel.set_ylim(len(labels) - 0.5, -0.5)
    panel.set_xlabel("time of a step [ms]")
    legend(figure, handles)
    cast(Any, figure).suptitle(title or "what each part costs (simulated)")
    return figure
