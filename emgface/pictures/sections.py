"""Midsagittal sections of a face with lips and teeth."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.figures.style import literal
from emgface.face.check import TO_MM
from emgface.face.landmarks import MIDLINE
from emgface.face.parts import arches_of
from emgface.face.surface import boundary_edges, element_faces
from emgface.pictures.body import PART_COLOURS, SKIN_PART
from emgface.pictures.stills import write_figure

Floats = NDArray[np.float64]

SECTION_MARGIN: Final = 0.022  #: margin of tissue shown around the lips [m]


def midline_faces(face: xr.Dataset) -> NDArray[np.int64]:
    """Faces of elements (n, 4) in the midsagittal plane at rest; few in asymmetric faces."""
    faces, _ = element_faces(face["connectivity"].values)
    flat = (np.abs(face["position"].values[faces, 0]) < MIDLINE).all(axis=1)
    faces = faces[flat]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return faces[first]


def cut_section(points: Floats, triangles: NDArray[np.integer]) -> Floats:
    """Segments (n, 2, 2) in y and z in which triangles (m, 3) intersect the plane x = 0."""
    corners = points[triangles]
    ahead = np.roll(corners, -1, axis=1)
    # A corner in the plane is assigned to its positive side, so that two edges are cut, or none.
    crossed = (corners[..., 0] >= 0.0) != (ahead[..., 0] >= 0.0)
    step = np.where(crossed, ahead[..., 0] - corners[..., 0], 1.0)
    at = corners - (corners[..., :1] / step[..., None]) * (ahead - corners)
    return at[crossed][:, 1:].reshape(-1, 2, 2)


@literal
def draw_sections(
    face: xr.Dataset, shown: Mapping[str, Floats], path: Path, *, title: str, dpi: int = 110
) -> Path:
    """Draw the section through lips and teeth in several states to a file.

    `shown` contains node positions (nodes, 3) [m] by name, one panel each, with the outline of the
    section at rest. `title` should state what is simulated.
    """
    rest, faces = face["position"].values, midline_faces(face)
    lips = rest[face["lip_opening_node"].values][:, 1:]
    middle = lips.mean(axis=0) * TO_MM
    figure = Figure(figsize=(3.4 * len(shown) + 0.4, 4.4), layout="constrained")
    figure.suptitle(title, fontsize="medium")
    outline = boundary_edges(faces)
    for place, (name, position) in enumerate(shown.items(), start=1):
        axes = figure.add_subplot(1, len(shown), place)
        for arch in arches_of(face):
            segments = cut_section(arch.points, arch.triangles) * TO_MM
            axes.add_collection(LineCollection(list(segments), colors="#8a8060", linewidths=1.6))
        axes.add_collection(
            PolyCollection(
                list(position[faces][..., 1:] * TO_MM),
                facecolors=PART_COLOURS[SKIN_PART],
                edgecolors="#7d6150",
                linewidths=0.35,
                alpha=0.75,
            )
        )
        axes.add_collection(
            LineCollection(
                list(rest[outline][..., 1:] * TO_MM),
                colors="#1b6ca8",
                linewidths=0.9,
                linestyles=":",
            )
        )
        reach = SECTION_MARGIN * TO_MM
        axes.set_xlim(middle[0] - 1.2 * reach, middle[0] + 0.8 * reach)
        axes.set_ylim(middle[1] - reach, middle[1] + reach)
        axes.set(aspect="equal", title=name, xlabel="y, forward (mm)")
        if place == 1:
            axes.set_ylabel("z, up (mm)")
    return write_figure(figure, path, dpi=dpi)
