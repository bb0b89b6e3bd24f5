"""Box plots of a score over volunteers, instructions and markers."""

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.cube import MARKER_DIMS
from analysis.descriptives import descriptives
from analysis.errors import CubeError
from analysis.figures.style import COLOURS, HATCHES, blank, boxes, heading, legend, styled, ticks
from analysis.tables import TABLE_UNITS, origin_of
from analysis.trajectory import names
from analysis.typed import scored_values, selected

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TITLES: Final = {
    "rho": ("3D correlation", "rho"),
    "amplitude_ratio": ("amplitude, simulated over measured", "ratio"),
    "rmse": ("root-mean-square distance", "distance"),
}
"""Title and label of the axis."""


@styled
def box_plots(
    cube: xr.Dataset,
    *,
    variable: str = "rho",
    by: Sequence[str] = ("volunteer", "instruction", "marker"),
    labels: Mapping[str, str] | None = None,
) -> "Figure":
    """Draw the distribution of a variable per volunteer, instruction and marker, by strategy.

    Boxes span the quartiles with the median as a line and the mean as a dot; whiskers reach the
    last value within 1.5 times the interquartile range, values beyond are crosses. Fewer than 8 values
    are drawn as points, with their median as a line. Ratios have a logarithmic axis, linear below 0.1
    if some are 0. The legend counts the values shown, and those that are undefined, failed, excluded or
    missing.

    Parameters
    ----------
    cube : xarray.Dataset
        Result of `analysis.cube.build_cube`.
    variable : str
        ``"rho"``, ``"amplitude_ratio"`` or ``"rmse"``.
    by : sequence of str
        One panel for each of these dims.
    labels : mapping, optional
        Text at the axis for a volunteer, instruction or marker, in place of its label.

    Raises
    ------
    CubeError
        Unknown variable or dim.

    Notes
    -----
    After Fig. 6 of Eskes et al. 2017.
    """
    if variable not in TITLES or variable not in cube:
        raise CubeError(f"cannot draw {variable!r}, expected one of {names([*TITLES])}")
    wrong = [dim for dim in by if dim not in MARKER_DIMS or dim == "strategy"]
    if wrong or not by:
        raise CubeError(f"cannot draw panels by {names(wrong) or 'nothing'}, expected trial dims")
    from matplotlib.patches import Patch

    _, shown, factor, _ = TABLE_UNITS[variable]
    data = scored_values(cube)[variable] * factor
    strategies = [str(label) for label in cube["strategy"].values]
    figure = blank(8.0, 0.6 + 2.6 * len(by))
    axes = figure.subplots(len(by), 1, squeeze=False)[:, 0]
    for panel, dim in zip(axes, by, strict=True):
        _boxes(panel, data, dim, labels or {})
        panel.set_ylabel(TITLES[variable][1] + (f" [{shown}]" if shown != "1" else ""))
        panel.set_xlabel(dim)
        if variable == "rho":
            panel.set_ylim(-1.05, 1.05)
            panel.axhline(0.0, color="0.6", linewidth=0.8, zorder=0)
        elif variable == "amplitude_ratio":
            _ratios(panel, data.values)
        else:
            panel.set_ylim(bottom=0.0)
    statistics = descriptives(cube, variable=variable)
    handles: list[Patch] = []
    for i, strategy in enumerate(strategies):
        # The legend also counts the trials that are not in the boxes.
        n, *left = (
            int(selected(statistics[name], {"strategy": strategy}))
            for name in ("n", "n_undefined", "n_failed", "n_excluded", "n_missing")
        )
        label = f"{strategy} (n = {n}, not drawn {sum(left)})"
        colour, hatch = COLOURS[i % 7], HATCHES[i % 7]
        handles.append(Patch(facecolor=colour, hatch=hatch, edgecolor="black", label=label))
    legend(figure, handles)
    heading(figure, TITLES[variable][0], origin_of(cube))
    return figure


def _ratios(panel: "Axes", values: NDArray[np.float64]) -> None:
    """Axis on which a ratio and its inverse are equally far from 1."""
    finite = values[np.isfinite(values)]
    axis = cast(Any, panel)
    if (finite > 0.0).all():
        axis.set_yscale("log")
    else:  # 0 has no logarithm
        axis.set_yscale("symlog", linthresh=0.1)
        axis.set_ylim(bottom=0.0)
    low, high = axis.get_ylim()
    shown = [
        t for t in (0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0) if low <= t <= high
    ]
    axis.set_yticks(shown, [f"{t:g}" for t in shown])
    axis.minorticks_off()
    axis.axhline(1.0, color="0.6", linewidth=0.8, zorder=0)


def _boxes(panel: "Axes", data: xr.DataArray, dim: str, named: Mapping[str, str]) -> None:
    """Draw one group of boxes per label of a dim, one box per strategy."""
    labels, strategies = data[dim].values, data["strategy"].values
    width = 0.8 / len(strategies)
    for i, strategy in enumerate(strategies):
        groups: dict[float, NDArray[np.float64]] = {}
        for place, label in enumerate(labels):
            values = selected(data, {"strategy": strategy, dim: label}).values.ravel()
            values = values[np.isfinite(values)]
            if len(values):
                groups[place + (i - (len(strategies) - 1) / 2) * width] = values
        if groups:
            boxes(panel, groups, 0.85 * width, i)
    shown = [named.get(str(label), str(label)) for label in labels]
    text = [fill(s, 14) if s not in map(str, labels) else s for s in shown]
    if dim == "marker":
        text = [s.replace("_", "\n") for s in text]
    ticks(panel, "x", range(len(labels)), text)
    panel.set_xlim(-0.6, len(labels) - 0.4)
