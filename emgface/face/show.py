"""Pictures of a face: skin, muscles, fixed nodes and markers from three sides."""

import os
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.check import sheet_nodes
from emgface.face.parts import (
    FREE,
    MANDIBLE,
    OUTER,
    SKULL,
    arches_of,
    facets_of,
    fibres_of,
    surface_names,
)
from emgface.face.surface import boundary_faces
from emgface.muscles import MODELLED, MUSCLE_NAMES, SIDES

Floats = NDArray[np.float64]

MM: Final = 1e3
VIEWS: Final = {"front": (0, 90), "left side": (0, 180), "oblique": (20, 130)}
"""Elevation and azimuth in degrees; the camera of the front view looks along -y."""

SKIN, VERMILION, LINING, TEETH, BACK = "#e8c9b5", "#c98079", "#a8615d", "#f4f0e4", "#b3907d"
_EDGE = "#7d6150"
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


def skin_faces(ds: xr.Dataset) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Boundary faces that a look from outside meets, and those of the skin alone.

    Parameters
    ----------
    ds : xarray.Dataset
        A face_model.

    Returns
    -------
    visible, of_skin : ndarray of int, shape (faces, 4)
        Nodes of each face; the visible ones include the rims, not the inner sheet behind.
    """
    faces, element = boundary_faces(ds["connectivity"].values)
    skin = np.zeros(ds.sizes["node"], dtype=bool)
    skin[sheet_nodes(ds, OUTER)] = True
    of_skin = (ds["layer"].values[element] == OUTER) & skin[faces].all(axis=1)
    return faces[skin[faces].any(axis=1) | of_skin], faces[of_skin]


def view_axes(
    figure: Figure,
    place: int,
    position: Floats,
    elevation: int,
    azimuth: int,
    *,
    layout: tuple[int, int] = (2, len(VIEWS)),
    zoom: float = 1.0,
) -> Axes3D:
    """Axes that show a face in millimetres from one side, to scale.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    place : int
        Place among the subplots, from 1.
    position : ndarray, shape (nodes, 3)
        What must fit [mm].
    elevation, azimuth : int
        Of the camera [degrees], see `VIEWS`.
    layout : tuple of int
        Rows and columns of subplots.
    zoom : float
        Factor on the size in the axes [1].

    Returns
    -------
    mpl_toolkits.mplot3d.axes3d.Axes3D
    """
    axes = figure.add_subplot(*layout, place, projection="3d", computed_zorder=False)
    assert isinstance(axes, Axes3D)
    axes.view_init(elev=elevation, azim=azimuth)
    axes.set_proj_type("ortho")
    low, high = position.min(axis=0), position.max(axis=0)
    axes.set_box_aspect(tuple(high - low), zoom=zoom * (1.1 if elevation == 0 else 0.95))  # pyright: ignore[reportArgumentType]
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set(xlabel="x", ylabel="y", zlabel="z")
    axes.zaxis.labelpad = -4
    axes.tick_params(labelsize="x-small")
    for axis, extent in zip((axes.xaxis, axes.yaxis, axes.zaxis), high - low, strict=True):
        axis.set_major_locator(MaxNLocator(nbins=max(2, round(7 * extent / max(high - low)))))
    # Seen along an axis its labels lie on top of each other.
    if elevation == 0 and azimuth % 180 == 90:
        axes.set_yticks([])
        axes.set_ylabel("")
    if elevation == 0 and azimuth % 180 == 0:
        axes.set_xticks([])
        axes.set_xlabel("")
    return axes


def toward_camera(elevation: int, azimuth: int) -> Floats:
    """Unit vector from the face to the camera."""
    e, a = np.radians([elevation, azimuth])
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def _visible(offset: Floats, camera: Floats) -> NDArray[np.bool_]:
    """Whether points on a convex head face the camera, from their horizontal place round it."""
    return offset[:, :2] @ camera[:2] > -0.15 * np.linalg.norm(offset[:, :2], axis=1)


def coloured_parts(ds: xr.Dataset) -> list[tuple[NDArray[np.integer], str]]:
    """What of the tissue shows, by colour: skin, and of a face that names them lips and lining.

    Parameters
    ----------
    ds : xarray.Dataset
        A face_model.

    Returns
    -------
    list
        Nodes (facets, 4), outward, and colour.
    """
    visible, _ = skin_faces(ds)
    every, _ = boundary_faces(ds["connectivity"].values)
    lips: dict[str, list[NDArray[np.integer]]] = {VERMILION: [], LINING: []}
    for name in surface_names(ds):
        colour = LINING if name.endswith("inner") else VERMILION
        lips[colour].append(facets_of(ds, name))
    named = {frozenset(row) for rows in lips.values() for part in rows for row in part.tolist()}
    plain = np.array([frozenset(row) not in named for row in visible.tolist()], dtype=bool)
    named |= {frozenset(row) for row in visible.tolist()}
    behind = np.array([frozenset(row) not in named for row in every.tolist()], dtype=bool)
    parts = [(visible[plain], SKIN), (every[behind], BACK)]
    parts += [(np.concatenate(rows), colour) for colour, rows in lips.items() if rows]
    return parts


def draw_tissue(
    axes: Axes3D,
    ds: xr.Dataset,
    position: Floats,
    elevation: int,
    azimuth: int,
    *,
    teeth: bool = True,
) -> None:
    """Draw what shows of a face in colour: skin, red of the lips, lining of the mouth, teeth.

    Parameters
    ----------
    axes : mpl_toolkits.mplot3d.axes3d.Axes3D
    ds : xarray.Dataset
        A face_model.
    position : ndarray, shape (nodes, 3)
        Of the face, at rest or moved [mm].
    elevation, azimuth : int
        Of the camera [degrees]; facets that face away are left out.
    teeth : bool
        Whether to draw the dental arches.
    """
    parts = [(position[nodes], colour) for nodes, colour in coloured_parts(ds)]
    if teeth:
        parts += [(arch.points[arch.triangles] * MM, TEETH) for arch in arches_of(ds)]
    camera = toward_camera(elevation, azimuth)
    polygons: list[Floats] = []
    colours: list[Floats] = []
    edges: list[Floats] = []
    for corners, colour in parts:
        normal = _normals(corners)
        towards = normal @ camera > 0.0
        shaded = _shade(normal[towards])[:, None] * to_rgb(colour)
        polygons += list(corners[towards])
        colours.append(shaded)
        edges.append(0.82 * shaded)
    axes.add_collection3d(
        Poly3DCollection(
            polygons,
            facecolors=np.concatenate(colours),
            edgecolors=np.concatenate(edges),
            linewidths=0.25,
            zorder=1,
        )
    )


def draw_skin(
    axes: Axes3D, position: Floats, faces: NDArray[np.integer], *, alpha: float = 1.0
) -> None:
    """Draw faces of the skin with light from the upper front.

    Parameters
    ----------
    axes : mpl_toolkits.mplot3d.axes3d.Axes3D
    position : ndarray, shape (nodes, 3)
        [mm]
    faces : ndarray of int, shape (faces, 4)
    alpha : float
        Opacity [1].
    """
    corners = position[faces]
    shade = _shade(_normals(corners))
    colours = np.column_stack([shade[:, None] * to_rgb(SKIN), np.full(len(shade), alpha)])
    axes.add_collection3d(
        Poly3DCollection(
            list(corners),
            facecolors=colours,
            edgecolors=(*to_rgb(_EDGE), 0.6 * alpha + 0.05),
            linewidths=0.2,
            zorder=1,
        )
    )


def _normals(corners: Floats) -> Floats:
    """Unit normals (n, 3) of triangles or quadrilaterals (n, 3 or 4, 3)."""
    last = corners.shape[1] - 1
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, last] - corners[:, 1])
    if last == 2:
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return normal / np.where(length > 0, length, 1.0)


def _shade(normal: Floats) -> Floats:
    """Brightness: light from the upper front and some from the subject's left, so shape shows."""
    lights = np.array([[0.0, 0.75, 0.65], [-0.9, 0.2, 0.4]])
    lights /= np.linalg.norm(lights, axis=1, keepdims=True)
    return np.clip(0.55 + np.clip(normal @ lights.T, 0.0, 1.0) @ [0.35, 0.15], 0.0, 1.0)


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
