"""What a fresh process costs until its first result."""

from typing import TYPE_CHECKING, Any, cast

import numpy as np
import xarray as xr

from analysis.errors import FigureError
from analysis.figures.style import COLOURS, HATCHES, blank, grid, legend, styled, ticks

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def first_results(found: xr.Dataset, *, title: str = "") -> "Figure":
    """Draw the phases of fresh processes, and the time that imports take.

    Parameters
    ----------
    found : xarray.Dataset
        ``seconds(volume, phase)`` [s], ``peak(volume)`` [B] and ``import_time(module)`` [s].
    title : str
        Names the face.

    Returns
    -------
    matplotlib.figure.Figure
        One bar per process; those of whole results are divided into phases and tell their memory.

    Raises
    ------
    FigureError
        Other dims.
    """
    from matplotlib.patches import Patch

    if "seconds" not in found or set(found["seconds"].dims) != {"volume", "phase"}:
        raise FigureError("expected seconds with dims volume and phase")
    seconds = found["seconds"].transpose("volume", "phase").values
    imports, peaks = found["import_time"].values, found["peak"].values / 1e6
    labels = [f"first output, {v}" for v in found["volume"].values]
    labels += [f"import {m}" for m in found["module"].values]
    figure = blank(7.0, 1.2 + 0.3 * len(labels))
    panel = grid(figure)[0][0]
    place, left = np.arange(len(peaks)), np.zeros(len(peaks))
    handles: list[Any] = []
    for i, phase in enumerate(found["phase"].values):
        look: dict[str, Any] = {"facecolor": COLOURS[i], "hatch": HATCHES[i], "edgecolor": "white"}
        panel.barh(place, seconds[:, i], 0.75, left=left, **look)
        handles.append(Patch(label=str(phase), **look))
        left = left + seconds[:, i]
    panel.barh(len(peaks) + np.arange(len(imports)), imports, 0.75, color="0.6")
    for k, total in enumerate([*left.tolist(), *imports.tolist()]):
        memory = f", {peaks[k]:.0f} MB" if k < len(peaks) and np.isfinite(peaks[k]) else ""
        panel.annotate(
            f"{total:.2f} s{memory}", (total, k), xytext=(4, 0), textcoords="offset points",
            va="center", fontsize="x-small",
        )  # fmt: skip
    ticks(panel, "y", range(len(labels)), labels)
    panel.set_ylim(len(labels) - 0.5, -0.5)
    panel.set_xlim(0.0, 1.3 * float(max(left.max(), imports.max())))
    panel.set_xlabel("wall time of a fresh process [s]")
    legend(figure, handles, most=4)
    cast(Any, figure).suptitle(f"{title or 'from nothing to the first result'} (simulated)")
    return figure
