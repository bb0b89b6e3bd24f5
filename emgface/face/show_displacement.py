"""Pictures of deformed faces, coloured by how far the skin has moved."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray

from emgface.face.drawing import MM, VIEWS, normals, skin_faces, view_axes

Floats = NDArray[np.float64]

MARGIN: Final = 0.028
"""Skin shown round the lip markers [m]."""
HEADING: Final = 0.6
"""Height above the first row [inch]."""


def draw_displacement(
    face: xr.Dataset,
    shown: Mapping[str, Floats],
    path: Path,
    *,
    title: str,
    columns: tuple[str, ...] = tuple(VIEWS),
    dpi: int = 100,
) -> Path:
    """Draw the mouth region of a face in several states, coloured by displacement in mm.

    Parameters
    ----------
    face : Dataset
        Face model; displacement counts from the geometry it stores.
    shown : mapping
        Name to node positions (nodes, 3) [m]; one row each.
    path : Path
        Picture to write.
    title : str
        Over all; say what is simulated and how.
    columns : tuple of str
        Some of `VIEWS`.
    dpi : int
        Dots per inch.

    Returns
    -------
    Path
        The picture.
    """
    rest = face["position"].values
    lips = rest[face["marker_node"].values]
    low, high = lips.min(axis=0) - MARGIN, lips.max(axis=0) + MARGIN
    faces, _ = skin_faces(face)
    middle = rest[faces].mean(axis=1)
    near = ((middle > low) & (middle < high)).all(axis=1)
    faces = faces[near]
    every = np.concatenate([q[np.unique(faces)] for q in (rest, *shown.values())]) * MM
    largest = max(
        float(np.linalg.norm((q - rest)[np.unique(faces)], axis=1).max()) for q in shown.values()
    )
    norm = Normalize(0.0, max(MM * largest, 1e-3))
    colours = mpl.colormaps["YlOrRd"]
    height = 2.5 * len(shown) + HEADING
    figure = Figure(figsize=(3.2 * len(columns) + 1.0, height))
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize="medium")
    for row, (name, position) in enumerate(shown.items()):
        moved = MM * np.linalg.norm(position - rest, axis=1)
        for column, view in enumerate(columns):
            elevation, azimuth = VIEWS[view]
            place = row * len(columns) + column + 1
            layout = (len(shown), len(columns))
            axes = view_axes(figure, place, every, elevation, azimuth, layout=layout, zoom=1.3)
            axes.set_axis_off()
            corners = position[faces] * MM
            axes.add_collection3d(
                Poly3DCollection(
                    list(corners),
                    facecolors=_shaded(colours(norm(moved[faces].mean(axis=1))), corners),
                    edgecolors=(0.2, 0.2, 0.2, 0.25),
                    linewidths=0.15,
                )
            )
            axes.set_title(f"{name}, {view}" if column == 0 else view, fontsize="small")
    figure.subplots_adjust(0.0, 0.0, 0.9, 1.0 - HEADING / height, 0.0, 0.08)
    scale = ScalarMappable(norm, colours)
    bar = figure.colorbar(scale, cax=figure.add_axes((0.92, 0.2, 0.015, 0.6)))
    bar.set_label("displacement from rest (mm), simulated")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=dpi)
    return path


def _shaded(colour: Floats, corners: Floats) -> Floats:
    """Darken what does not face the light from the upper front."""
    light = np.array([0.35, 0.75, 0.55])
    shade = 0.55 + 0.45 * np.clip(normals(corners) @ (light / np.linalg.norm(light)), 0.0, 1.0)
    return np.column_stack([colour[:, :3] * shade[:, None], colour[:, 3]])
