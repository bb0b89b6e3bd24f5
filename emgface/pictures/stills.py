"""Figures of faces: at rest with their muscles, moved, and coloured by displacement."""

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, cast

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from analysis.figures.style import COLOURS, blank, grid, legend, styled
from emgface.errors import DataError
from emgface.face.check import TO_MM
from emgface.face.parts import FREE, MANDIBLE, SKULL, fibres_of
from emgface.files import replace_file
from emgface.muscles import MODELLED, MUSCLE_NAMES, SIDES
from emgface.pictures.body import Body, body_of, skin_of
from emgface.pictures.render import (
    DISPLACEMENT,
    PICTURE_VIEWS,
    VIEWS,
    Window,
    project,
    render,
    window_of,
)

Floats = NDArray[np.float64]

BONE_COLOURS: Final = {MANDIBLE: "#c44e00", SKULL: "#4c78a8"}
MARKER_SYMBOLS: Final[Mapping[str, Mapping[str, Any]]] = {
    "simulated": {
        "marker": "o", "markersize": 2.6, "color": COLOURS[4],
        "markeredgecolor": "white", "markeredgewidth": 0.3,
    },
    "measured": {
        "marker": "D", "markersize": 2.4, "markerfacecolor": "none",
        "markeredgecolor": COLOURS[5], "markeredgewidth": 0.8,
    },
}  # fmt: skip
"""Symbols of the markers of the model and of the recording, in figures and in the page."""
NOTEBOOK_DPI: Final = 72  #: resolution of a picture in a notebook
#: margin of skin shown around the lips in pictures of the lips [m]
LIP_PICTURE_MARGIN: Final = 0.028


def recording_label(origin: str) -> str:
    """Name of the recording in a legend: "simulated recording" or "measured recording"."""
    return f"{origin.partition(',')[0]} recording"


def paint(
    axes: Axes,
    body: Body,
    position: NDArray[np.floating],
    view: tuple[float, float],
    window: Window,
    *,
    pixels: int = 420,
    opacity: float = 1.0,
    colour: Floats | None = None,
) -> None:
    """Draw a body in axes whose coordinates are millimetres in the plane of the picture.

    Other arguments as of `emgface.pictures.render.render`; `pixels` is the width of the picture.
    """
    picture = render(body, position, view, window, pixels, colour=colour)
    picture[..., 3] = np.round(opacity * picture[..., 3])
    extent = (TO_MM * window.left, TO_MM * window.right, TO_MM * window.bottom, TO_MM * window.top)
    axes.imshow(picture, extent=extent, interpolation="antialiased")
    axes.set_axis_off()


def marks(
    axes: Axes, points: NDArray[np.floating], view: tuple[float, float], **style: Any
) -> None:
    """Draw points [m] in axes of `paint`, except those on the far side of the head."""
    seen = project(points, view)
    if abs(view[0]) > 45.0:
        seen = seen[seen[:, 2] >= project(np.zeros((1, 3)), view)[0, 2] - 2e-3]
    axes.plot(TO_MM * seen[:, 0], TO_MM * seen[:, 1], linestyle="", zorder=3, **style)


@styled
def face_figure(face: xr.Dataset) -> Figure:
    """Draw a face at rest from the front, the left and obliquely.

    The upper row shows skin, lips, teeth and markers, the lower one muscle fibres and fixed nodes
    through the skin.
    """
    figure = blank(11.0, 8.2)
    kind = str(face.attrs["origin"]).rpartition(", ")[2]
    figure.suptitle(f"{face.attrs['name']} ({kind}: {face.attrs['source']})")
    skin = skin_of(face)
    body, rest = body_of(face, skin), face["position"].values
    shown = [rest[skin.node]]
    if "face_marker_position" in face:
        shown.append(face["face_marker_position"].values)
    panels = grid(figure, 2, len(PICTURE_VIEWS))
    for column, side in enumerate(PICTURE_VIEWS):
        view = VIEWS[side]
        window = window_of(np.concatenate(shown), view, 0.03)
        above, below = panels[0][column], panels[1][column]
        above.set_title(f"{side}: skin and markers")
        below.set_title(f"{side}: muscle fibres and fixed nodes")
        paint(above, body, rest[skin.node], view, window)
        paint(below, body, rest[skin.node], view, window, opacity=0.3)
        marks(above, rest[face["marker_node"].values], view, **_POINT, color="#111111",
              label="lip markers")  # fmt: skip
        if len(shown) > 1:
            marks(above, shown[1], view, **_POINT, color="#1b6ca8", label="face markers")
        _draw_fixed(below, face, view)
        _draw_fibres(below, face, view)
    handles = [line for panel in (panels[0][0], panels[1][0])
               for line in panel.get_legend_handles_labels()[0]]  # fmt: skip
    names = [m for m in MODELLED if f"{m}_L" in face["muscle"].values]
    handles += [
        Line2D([], [], color=_colour(m), linewidth=2.2, label=f"{m} {MUSCLE_NAMES[m]}")
        for m in names
    ]
    legend(figure, handles, most=4)
    return figure


_POINT: Final[Mapping[str, Any]] = {"marker": "o", "markersize": 3.4, "markeredgewidth": 0.0}


def _draw_fixed(axes: Axes, face: xr.Dataset, view: tuple[float, float]) -> None:
    fixed, position = face["fixed"].values, face["position"].values
    for kind, bone in ((MANDIBLE, "mandible"), (SKULL, "skull")):
        seen = TO_MM * project(position[fixed == kind], view)
        text = f"fixed to {bone} ({len(seen)} of {int((fixed != FREE).sum())} fixed nodes)"
        axes.plot(seen[:, 0], seen[:, 1], ".", markersize=2.0, color=BONE_COLOURS[kind], alpha=0.6,
                  label=text)  # fmt: skip


def _draw_fibres(axes: Axes, face: xr.Dataset, view: tuple[float, float]) -> None:
    known = {str(name) for name in face["muscle"].values}
    for muscle in MODELLED:
        for name in (f"{muscle}_{side}" for side in SIDES):
            lines = [project(f, view) for f in fibres_of(face, name)] if name in known else []
            # In a side view, the muscles of the other side are faint.
            far = bool(lines) and abs(view[0]) > 45.0 and np.concatenate(lines)[:, 2].mean() < 0.0
            flat = [TO_MM * line[:, :2] for line in lines]
            axes.add_collection(
                LineCollection(
                    flat, colors=[_colour(muscle)], linewidths=1.8, alpha=0.25 if far else 1.0
                )
            )


def _colour(muscle: str) -> Any:
    return cast(Any, mpl.colormaps["tab10"]).colors[MODELLED.index(muscle)]


@styled
def states_figure(
    face: xr.Dataset,
    shown: Mapping[str, NDArray[np.floating]],
    *,
    title: str,
    views: Sequence[str] = PICTURE_VIEWS,
    displacement: bool = False,
    lips: bool = False,
) -> Figure:
    """Draw a face in several states, one column each, one row for each view.

    `shown` contains node positions (nodes, 3) [m] by name, `views` some of
    `emgface.pictures.render.VIEWS`. `title` should state what is simulated. With `displacement` the
    colour is the distance from the geometry of the face model; with `lips` only the region of the
    lips is shown.
    """
    skin = skin_of(face)
    moved = {name: np.asarray(q)[skin.node] for name, q in shown.items()}
    around = face["position"].values[face["marker_node"].values] if lips else None
    return body_figure(
        body_of(face, skin),
        moved,
        title=title,
        views=views,
        rest=face["position"].values[skin.node] if displacement else None,
        around=around,
    )


@styled
def body_figure(
    body: Body,
    shown: Mapping[str, NDArray[np.floating]],
    *,
    title: str,
    views: Sequence[str] = PICTURE_VIEWS,
    rest: NDArray[np.floating] | None = None,
    around: NDArray[np.floating] | None = None,
) -> Figure:
    """Draw states of a body, as `states_figure`, by the nodes of its skin (n, 3) [m].

    `rest` are the positions to which a displacement shown by colour refers; `around` are points
    whose surroundings (`LIP_PICTURE_MARGIN`) are shown instead of the whole.
    """
    every = np.concatenate(list(shown.values()))
    windows = [
        window_of(every, VIEWS[view], 0.02) if around is None else lips_window(around, VIEWS[view])
        for view in views
    ]
    shapes = [(w.top - w.bottom) / (w.right - w.left) for w in windows]
    width = min(2.5, 13.0 / len(shown))
    figure = blank(
        width * len(shown) + (0.9 if rest is not None else 0.1), width * sum(shapes) + 0.8
    )
    panels = grid(figure, len(views), len(shown), height_ratios=shapes)
    norm, colours = Normalize(0.0, 1.0), LinearSegmentedColormap.from_list("", DISPLACEMENT)
    if rest is not None:
        most = max(float(np.linalg.norm(q - rest, axis=1).max()) for q in shown.values())
        norm = Normalize(0.0, max(TO_MM * most, 1e-3))
    for column, (name, position) in enumerate(shown.items()):
        panels[0][column].set_title(name)
        paint_as = None
        if rest is not None:
            far = TO_MM * np.linalg.norm(position - rest, axis=1)
            paint_as = np.asarray(colours(norm(far)))[:, :3]
        for row, view in enumerate(views):
            panel = panels[row][column]
            paint(panel, body, position, VIEWS[view], windows[row], colour=paint_as)
            if column == 0 and len(views) > 1:
                panel.text(-0.02, 0.5, view, rotation=90, transform=panel.transAxes, ha="right",
                           va="center", color="0.35")  # fmt: skip
    if rest is not None:
        bar = cast(Any, figure).colorbar(
            ScalarMappable(norm, colours), ax=np.array(panels), shrink=0.7, pad=0.01
        )
        bar.set_label("displacement [mm], simulated")
    wide = round(11 * figure.get_figwidth())  # characters in the width of the figure
    cast(Any, figure).suptitle(textwrap.fill(title, wide))
    return figure


def lips_window(markers: NDArray[np.floating], view: tuple[float, float]) -> Window:
    """Window around the markers of the lips, with a margin of skin."""
    window = window_of(markers, view, 0.0)
    return Window(
        window.left - LIP_PICTURE_MARGIN,
        window.bottom - LIP_PICTURE_MARGIN,
        window.right + LIP_PICTURE_MARGIN,
        window.top + LIP_PICTURE_MARGIN,
    )


def write_figure(figure: Figure, path: str | Path, *, dpi: int = 150) -> Path:
    """Write a figure in the format of the suffix of the path.

    Raises DataError if the format is unknown or the file cannot be written.
    """
    path = Path(path)
    form = path.suffix.lower().removeprefix(".")
    known = FigureCanvasAgg.get_supported_filetypes()
    if form not in known:
        raise DataError(
            f"{path.name} has no known picture format, expected one of {', '.join(sorted(known))}"
        )
    FigureCanvasAgg(figure)
    replace_file(path, lambda target: figure.savefig(target, format=form, dpi=dpi))
    return path
