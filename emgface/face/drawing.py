"""How tissue is drawn: views, colours of its parts, light."""

from typing import Final

import numpy as np
import xarray as xr
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray

from emgface.face.check import sheet_nodes
from emgface.face.parts import OUTER, arches_of, facets_of, surface_names
from emgface.face.surface import boundary_faces

Floats = NDArray[np.float64]

MM: Final = 1e3
VIEWS: Final = {"front": (0, 90), "left side": (0, 180), "oblique": (20, 130)}
"""Elevation and azimuth in degrees; the camera of the front view looks along -y."""

SKIN, VERMILION, LINING, TEETH, BACK = "#e8c9b5", "#c98079", "#a8615d", "#f4f0e4", "#b3907d"
_EDGE = "#7d6150"


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
        normal = normals(corners)
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
    shade = _shade(normals(corners))
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


def normals(corners: Floats) -> Floats:
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
