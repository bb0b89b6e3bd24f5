"""Rendered faces: one per instruction and strategy, seen from the front."""

from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.errors import FigureError
from analysis.figures.style import COLOURS, blank, grid, heading, legend, styled
from analysis.tables import origin_of
from analysis.trajectory import names

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

SKIN: Final = (0.91, 0.79, 0.71)
DIMS: Final = ("instruction", "strategy", "node", "axis")
# Light from the upper front and some from the subject's left, so that shape shows.
LIGHTS: Final = ((0.0, 0.75, 0.65, 0.40), (-0.9, 0.2, 0.4, 0.20))
"""Direction and strength."""


@styled
def rendered_faces(faces: xr.Dataset) -> "Figure":
    """Draw the face at its farthest from rest, per instruction and strategy.

    Parameters
    ----------
    faces : xarray.Dataset
        ``position`` (instruction, strategy, node, axis) [m], NaN where there is no simulation;
        ``triangle`` (triangle, corner), indices of nodes, counter-clockwise from outside.
        Optionally ``simulated`` and ``measured`` (instruction, strategy, marker, axis) [m], markers
        at the same instants. Axes x to the subject's right, y anterior, z superior. Attribute
        ``origin``, of the recordings.

    Returns
    -------
    matplotlib.figure.Figure
        One row per strategy, one column per instruction, all to one scale.

    Raises
    ------
    FigureError
        Other dims, another unit, or nothing to draw.

    Notes
    -----
    After Fig. 4 of Eskes et al. 2017.
    """
    if "position" not in faces or faces["position"].dims != DIMS:
        found = [f"{name} {tuple(map(str, each.dims))}" for name, each in faces.data_vars.items()]
        raise FigureError(
            f"expected position with dims {names([*DIMS])}, found {names(found) or 'nothing'}"
        )
    units = faces["position"].attrs.get("units")
    if units != "m":
        raise FigureError(f"the positions are in {units!r}, expected 'm'")
    position = 1e3 * faces["position"].values.astype(np.float64)
    here = np.asarray(np.isfinite(position).all(axis=(2, 3)))
    if not here.any():
        raise FigureError("there is no face to draw: every trial lacks a simulation")
    corners = faces["triangle"].values
    low, high = np.nanmin(position, axis=(0, 1, 2)), np.nanmax(position, axis=(0, 1, 2))
    marked = (
        1e3 * faces["simulated"].values.reshape(-1, 3) if "simulated" in faces else np.empty((0, 3))
    )
    marked = marked[np.isfinite(marked).all(axis=-1)]
    if len(marked) > 1 and np.ptp(marked[:, 0]) > 0:
        # The lips are what is compared: a face around them, not a head.
        middle, half = marked.mean(axis=0), 1.9 * float(np.ptp(marked, axis=0).max()) / 2
        low, high = np.maximum(low, middle - half), np.minimum(high, middle + half)
    instructions = [str(label) for label in faces["instruction"].values]
    strategies = [str(label) for label in faces["strategy"].values]
    width = min(1.9, 9.0 / len(instructions))
    height = width * (high[2] - low[2]) / (high[0] - low[0])
    figure = blank(width * len(instructions) + 0.9, (height + 0.15) * len(strategies) + 0.9)
    panels = grid(figure, len(strategies), len(instructions))
    for column, instruction in enumerate(instructions):
        for row, strategy in enumerate(strategies):
            panel = panels[row][column]
            panel.set_xlim(high[0], low[0])  # the subject's right is on the left of the picture
            panel.set_ylim(low[2], high[2])
            panel.set_aspect("equal")
            panel.set_xticks([])
            panel.set_yticks([])
            for spine in panel.spines.values():
                spine.set_visible(False)
            if row == 0:
                panel.set_title(instruction)
            if column == 0:
                panel.set_ylabel(strategy)
            if not here[column, row]:
                panel.text(0.5, 0.5, "none", transform=panel.transAxes, ha="center", color="0.4")
                continue
            _draw(panel, position[column, row], corners)
            one = faces.isel(instruction=column, strategy=row)
            for name, style in _MARKS.items():
                if name in one:
                    points = 1e3 * one[name].transpose("marker", "axis").values
                    panel.plot(points[:, 0], points[:, 2], zorder=3, **style)
    shown = [name for name in _MARKS if name in faces]
    if shown:
        from matplotlib.lines import Line2D

        handles = [Line2D([], [], label=f"{name} markers", **_MARKS[name]) for name in shown]
        legend(figure, handles)
    heading(figure, "faces farthest from rest, simulated", origin_of(faces))
    return figure


_MARKS: Final[dict[str, dict[str, Any]]] = {
    "simulated": {
        "linestyle": "", "marker": "o", "markersize": 2.6, "color": COLOURS[4],
        "markeredgecolor": "white", "markeredgewidth": 0.3,
    },
    "measured": {
        "linestyle": "", "marker": "D", "markersize": 2.4, "markerfacecolor": "none",
        "markeredgecolor": COLOURS[5], "markeredgewidth": 0.8,
    },
}  # fmt: skip


def _draw(panel: "Axes", position: Floats, corners: NDArray[np.integer]) -> None:
    """Draw the triangles that face the viewer, the farthest first."""
    from matplotlib.collections import PolyCollection

    points = position[corners]
    normal = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    # Normals of nodes, averaged over their triangles by area, show a smooth skin.
    smooth = np.zeros_like(position)
    for corner in range(3):
        np.add.at(smooth, corners[:, corner], normal)
    front = normal[:, 1] > 0
    points, normal = points[front], smooth[corners[front]].sum(axis=1)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.where(length > 0, length, 1.0)
    order = np.argsort(points[:, :, 1].mean(axis=1))
    lights = np.asarray(LIGHTS)
    towards = lights[:, :3] / np.linalg.norm(lights[:, :3], axis=1, keepdims=True)
    shade = 0.5 + np.clip(normal @ towards.T, 0.0, 1.0) @ lights[:, 3]
    colours = np.clip(shade[:, None], 0.0, 1.0) * np.asarray(SKIN)
    # Pixels: a vector for every triangle would make files of many megabytes.
    drawn = PolyCollection(
        list(points[order][:, :, [0, 2]]),
        facecolors=colours[order],
        edgecolors=colours[order],
        linewidths=0.3,
        rasterized=True,
    )
    panel.add_collection(drawn)
