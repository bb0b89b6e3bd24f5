"""Faces of a study at their largest displacement, side by side."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from analysis.figures.style import blank, grid, heading, legend, styled
from analysis.tables import origin_of
from emgface.pictures.body import Body
from emgface.pictures.render import VIEWS
from emgface.pictures.stills import MARKER_SYMBOLS, lips_window, marks, paint, recording_label


@styled
def study_faces(faces: xr.Dataset, body: Body) -> Figure:
    """Draw the face at its largest displacement, one row per strategy, one column per instruction.

    `faces` contains ``position`` (instruction, strategy, node, axis) [m] of the nodes of the skin,
    NaN without simulation, and ``simulated`` and ``measured`` (instruction, strategy, marker, axis)
    [m] at the same instants, with the attribute ``origin`` of the recordings. All panels have the
    same scale. After Fig. 4 of Eskes et al. 2017.
    """
    instructions = [str(label) for label in faces["instruction"].values]
    strategies = [str(label) for label in faces["strategy"].values]
    view = VIEWS["front"]
    known = faces["simulated"].values.reshape(-1, 3)
    # The region of the lips, which are compared.
    window = lips_window(known[np.isfinite(known).all(axis=1)], view)
    width = min(1.9, 9.0 / len(instructions))
    height = width * (window.top - window.bottom) / (window.right - window.left)
    # At least as wide as the title.
    figure = blank(
        max(7.0, width * len(instructions) + 0.9), (height + 0.15) * len(strategies) + 0.9
    )
    panels = grid(figure, len(strategies), len(instructions))
    for column, instruction in enumerate(instructions):
        for row, strategy in enumerate(strategies):
            panel = panels[row][column]
            if row == 0:
                panel.set_title(instruction)
            if column == 0:
                panel.text(-0.04, 0.5, strategy, rotation=90, transform=panel.transAxes,
                           ha="right", va="center")  # fmt: skip
            one = faces.isel(instruction=column, strategy=row)
            if not np.isfinite(one["position"].values).all():
                panel.text(0.5, 0.5, "none", transform=panel.transAxes, ha="center", color="0.4")
                panel.set_axis_off()
                continue
            paint(panel, body, one["position"].values, view, window, pixels=260)
            for name, style in MARKER_SYMBOLS.items():
                marks(panel, one[name].values, view, **style)
    texts = {
        "simulated": "simulated by the face model",
        "measured": recording_label(origin_of(faces)),
    }
    handles = [Line2D([], [], linestyle="", label=texts[n], **s) for n, s in MARKER_SYMBOLS.items()]
    legend(figure, handles)
    heading(figure, "simulated faces, farthest from rest", origin_of(faces))
    return figure
