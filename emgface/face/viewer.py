"""Shaded pictures of a face, and a window to turn it in, by pyvista where it is installed."""

import os
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.drawing import MM, TEETH, VIEWS, coloured_parts, toward_camera
from emgface.face.parts import MANDIBLE, SKULL, arches_of, fibres_of
from emgface.face.show import BONE, FACE_MARKER, MARKER
from emgface.muscles import MODELLED, SIDES

Floats = NDArray[np.float64]

FORMATS: Final = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
"""Pixel formats that pyvista writes."""
_CREASE: Final = 60.0
"""Angle between facets beyond which an edge stays sharp [degrees]."""
_FIBRE, _POINT = 1.1, 1.3
"""Radius of drawn fibres and markers [mm]."""
_PANEL: Final = (640, 600)


def viewer_is_available() -> bool:
    """Whether pyvista is installed."""
    return find_spec("pyvista") is not None


def draw_shaded(
    ds: xr.Dataset, path: str | os.PathLike[str], *, position: Floats | None = None
) -> Path:
    """Draw a face from the front, the left and obliquely, smoothly shaded, and write the picture.

    The upper row shows skin, lips, teeth and markers, the lower one muscle fibres, fixed nodes and
    teeth through the skin.

    Parameters
    ----------
    ds : xarray.Dataset
        A face_model that passed `emgface.face.validity.check_face`.
    path : path-like
        Picture to write, one of `FORMATS`.
    position : ndarray, shape (nodes, 3), optional
        Moved nodes [m]; at rest when absent. Fibres are drawn at rest alone.

    Returns
    -------
    Path
        The picture.

    Raises
    ------
    FaceError
        pyvista is not installed, the format is unknown or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise FaceError(f"{path} has no pixel format, expected one of {', '.join(FORMATS)}")
    pv = _pyvista()
    size = (_PANEL[0] * len(VIEWS), 2 * _PANEL[1])
    plotter = pv.Plotter(off_screen=True, shape=(2, len(VIEWS)), window_size=size, border=False)
    try:
        _fill(plotter, ds, position)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            plotter.screenshot(path)
        except OSError as error:
            raise FaceError(
                f"{path} cannot be written ({error}): check folder and space"
            ) from error
    finally:
        plotter.close()
    return path


def open_window(ds: xr.Dataset) -> None:
    """Open a window in which the face can be turned, and wait until it is closed.

    Raises
    ------
    FaceError
        pyvista is not installed, or there is no display.
    """
    pv = _pyvista()
    if os.name == "posix" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        import sys

        if sys.platform != "darwin":
            raise FaceError(
                "there is no display for a window: expected DISPLAY to be set, write a picture "
                "instead (--out)"
            )
    plotter = pv.Plotter(shape=(1, 2), title=str(ds.attrs["name"]))
    for column, inside in enumerate((False, True)):
        plotter.subplot(0, column)
        _add_face(plotter, ds, ds["position"].values * MM, inside=inside)
        _look(plotter, ds, *VIEWS["oblique"])
    plotter.link_views()
    plotter.show()


def _pyvista() -> Any:
    # by name, since the package is optional and a check of types may run without it
    try:
        pyvista = import_module("pyvista")
    except ImportError as error:
        raise FaceError(
            "pyvista is not installed, which draws shaded pictures: install emgface[viewer], or use "
            "the renderer matplotlib"
        ) from error
    try:
        logger = import_module("vtkmodules.vtkCommonCore").vtkLogger
        # Without a display VTK warns and then renders in software.
        logger.SetStderrVerbosity(logger.VERBOSITY_ERROR)
    except ImportError:
        pass
    return pyvista


def _fill(plotter: Any, ds: xr.Dataset, position: Floats | None) -> None:
    moved = (ds["position"].values if position is None else position) * MM
    kind = "generated" if ds.attrs["origin"] == "generated" else "imported"
    for column, (title, (elevation, azimuth)) in enumerate(VIEWS.items()):
        for row, inside in enumerate((False, True)):
            if inside and position is not None:
                continue
            plotter.subplot(row, column)
            _add_face(plotter, ds, moved, inside=inside)
            _look(plotter, ds, elevation, azimuth)
            heading = f"{ds.attrs['name']}, {kind}" if row == column == 0 else title
            plotter.add_text(heading, font_size=9, color="black", position="lower_left")
    if position is None:
        plotter.subplot(1, 0)
        names = [muscle for muscle in MODELLED if f"{muscle}_L" in ds["muscle"].values]
        labels = {name: _colours()[MODELLED.index(name)] for name in names}
        plotter.add_legend(
            labels,  # pyright: ignore[reportArgumentType]  # its decorator hides the signature
            bcolor=None,
            face="rectangle",
            size=(0.13, 0.3),
            loc="upper left",
        )


def _add_face(plotter: Any, ds: xr.Dataset, position: Floats, *, inside: bool) -> None:
    look = {"smooth_shading": True, "split_sharp_edges": True, "feature_angle": _CREASE}
    for nodes, colour in coloured_parts(ds):
        opacity = 0.16 if inside else 1.0
        mesh = _surface(position, nodes)
        plotter.add_mesh(mesh, color=colour, opacity=opacity, specular=0.1, **look)
    for arch in arches_of(ds):
        plotter.add_mesh(_surface(arch.points * MM, arch.triangles), color=TEETH)
    if inside:
        _add_muscles(plotter, ds)
        for bone in (MANDIBLE, SKULL):
            points = position[ds["fixed"].values == bone]
            if len(points):
                plotter.add_points(points, color=BONE[bone], point_size=3.0, opacity=0.6)
        return
    groups = [(position[ds["marker_node"].values], MARKER)]
    if "face_marker_position" in ds:
        groups.append((ds["face_marker_position"].values * MM, FACE_MARKER))
    for points, colour in groups:
        for point in points:
            plotter.add_mesh(_ball(point), color=colour)


def _add_muscles(plotter: Any, ds: xr.Dataset) -> None:
    pv = _pyvista()
    known = {str(name) for name in ds["muscle"].values}
    for muscle, colour in zip(MODELLED, _colours(), strict=True):
        for name in (f"{muscle}_{side}" for side in SIDES):
            for fibre in fibres_of(ds, name) if name in known else []:
                line = pv.lines_from_points(fibre * MM)
                plotter.add_mesh(line.tube(radius=_FIBRE), color=colour, smooth_shading=True)


def _look(plotter: Any, ds: xr.Dataset, elevation: int, azimuth: int) -> None:
    """Parallel view of the face at rest, so that a moved face keeps its place."""
    position = ds["position"].values * MM
    low, high = position.min(axis=0), position.max(axis=0)
    if "face_marker_position" in ds:
        high = np.maximum(high, ds["face_marker_position"].values.max(axis=0) * MM)
    middle = 0.5 * (low + high) + [0.0, 0.0, 3.0]
    camera = plotter.camera
    camera.focal_point = tuple(middle)
    camera.position = tuple(middle + 500.0 * toward_camera(elevation, azimuth))
    camera.up = (0.0, 0.0, 1.0)
    camera.parallel_projection = True
    camera.parallel_scale = 0.54 * float((high - low)[[0, 2]].max())
    plotter.reset_camera_clipping_range()


def _surface(points: Floats, facets: NDArray[np.integer]) -> Any:
    pv = _pyvista()
    count = np.full((len(facets), 1), facets.shape[1])
    return pv.PolyData(points, np.hstack([count, facets]).ravel())


def _ball(point: Sequence[float] | Floats) -> Any:
    return _pyvista().Sphere(radius=_POINT, center=tuple(point))


def _colours() -> list[tuple[float, float, float]]:
    return list(mpl.colormaps["tab10"].colors)  # pyright: ignore[reportAttributeAccessIssue]
