"""Pictures of a face: skin, muscles, fixed nodes and markers from three sides."""

import os
from pathlib import Path

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.drawing import (
    MM,
    VIEWS,
    Floats,
    draw_skin,
    draw_tissue,
    skin_faces,
    toward_camera,
    view_axes,
)
from emgface.face.parts import (
    FREE,
    MANDIBLE,
    SKULL,
    fibres_of,
)
from emgface.muscles import MODELLED, MUSCLE_NAMES, SIDES

MARKER, FACE_MARKER, BONE = "#111111", "#1b6ca8", {MANDIBLE: "#c44e00", SKULL: "#4c78a8"}


def draw_face(ds: xr.Dataset, path: str | os.PathLike[str], *, dpi: int = 150) -> Path:
    """Draw a face from the front, the left and obliquely, and write the picture.

    Parameters
    ----------
    ds : xarray.Dataset
        A face_model that passed `emgface.face.validity.check_face`.
    path : path-like
        Picture to write; its ending chooses the format (png, pdf, svg).
    dpi : int
        Dots per inch of pixel formats.

    Returns
    -------
    Path
        The picture.

    Raises
    ------
    FaceError
        The format is unknown or the file cannot be written.
    """
    path = Path(path)
    figure = face_figure(ds)
    kinds = figure.canvas.get_supported_filetypes()
    if path.suffix.lstrip(".").lower() not in kinds:
        raise FaceError(
            f"{path} has no known picture format, expected one of {', '.join(sorted(kinds))}"
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=dpi)
    except OSError as error:
        raise FaceError(f"{path} cannot be written ({error}): check folder and space") from error
    return path


def face_figure(ds: xr.Dataset) -> Figure:
    """Make the figure that `draw_face` writes.

    The upper row shows skin and markers, the lower one muscle fibres of both sides, fixed nodes and
    the outline of the skin.

    Parameters
    ----------
    ds : xarray.Dataset
        A face_model that passed `emgface.face.validity.check_face`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = Figure(figsize=(14, 10.5), layout="constrained")
    FigureCanvasAgg(figure)
    kind = "generated" if ds.attrs["origin"] == "generated" else "imported"
    figure.suptitle(f"{ds.attrs['name']} ({kind}: {ds.attrs['source']}), mm\n")
    _, of_skin = skin_faces(ds)
    position = ds["position"].values * MM
    for column, (title, (elevation, azimuth)) in enumerate(VIEWS.items(), start=1):
        above = view_axes(figure, column, position, elevation, azimuth)
        above.set_title(f"{title}: skin and markers")
        draw_tissue(above, ds, position, elevation, azimuth)
        _draw_markers(above, ds, position, elevation, azimuth)
        below = view_axes(figure, column + len(VIEWS), position, elevation, azimuth)
        below.set_title(f"{title}: muscle fibres and fixed nodes")
        draw_skin(below, position, of_skin, alpha=0.10)
        _draw_fixed(below, ds, position)
        _draw_fibres(below, ds)
        if column == 1:
            handles = above.get_legend_handles_labels()
            lower = below.get_legend_handles_labels()
            figure.legend(
                handles[0] + lower[0],
                handles[1] + lower[1],
                loc="outside lower center",
                borderaxespad=1.5,
                ncols=4,
                fontsize="small",
            )
    return figure


def _visible(offset: Floats, camera: Floats) -> NDArray[np.bool_]:
    """Whether points on a convex head face the camera, from their horizontal place round it."""
    return offset[:, :2] @ camera[:2] > -0.15 * np.linalg.norm(offset[:, :2], axis=1)


def _draw_markers(
    axes: Axes3D, ds: xr.Dataset, position: Floats, elevation: int, azimuth: int
) -> None:
    # Drawing order is fixed, so points on the far side of the head must be left out by hand.
    middle = position.mean(axis=0)
    camera = toward_camera(elevation, azimuth)
    lips = position[ds["marker_node"].values]
    face = ds["face_marker_position"].values * MM
    for points, colour, label in (
        (lips, MARKER, "lip markers"),
        (face, FACE_MARKER, "face markers"),
    ):
        points = points[_visible(points - middle, camera)]
        axes.scatter(
            points[:, 0],
            points[:, 1],
            zs=points[:, 2],  # pyright: ignore[reportArgumentType]
            s=14,
            color=colour,
            depthshade=False,
            label=label,
            zorder=5,
        )


def _draw_fixed(axes: Axes3D, ds: xr.Dataset, position: Floats) -> None:
    fixed = ds["fixed"].values
    for kind, label in ((MANDIBLE, "fixed to mandible"), (SKULL, "fixed to skull")):
        points = position[fixed == kind]
        axes.scatter(
            points[:, 0],
            points[:, 1],
            zs=points[:, 2],  # pyright: ignore[reportArgumentType]
            s=3,
            color=BONE[kind],
            alpha=0.6,
            depthshade=False,
            label=f"{label} ({len(points)} of {int((fixed != FREE).sum())} fixed nodes)",
            zorder=2,
        )


def _draw_fibres(axes: Axes3D, ds: xr.Dataset) -> None:
    known = {str(name) for name in ds["muscle"].values}
    for muscle, colour in zip(MODELLED, mpl.colormaps["tab10"].colors, strict=True):  # pyright: ignore[reportAttributeAccessIssue]
        lines: list[Floats] = []
        for side in SIDES:
            if f"{muscle}_{side}" in known:
                lines += [fibre * MM for fibre in fibres_of(ds, f"{muscle}_{side}")]
        axes.add_collection3d(
            Line3DCollection(
                lines,
                colors=[colour],
                linewidths=2.2,
                label=f"{muscle} {MUSCLE_NAMES[muscle]}",
                zorder=4,
            )
        )
