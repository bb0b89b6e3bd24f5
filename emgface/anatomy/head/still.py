"""Figures of models at rest: jaw, tongue or whole head from three sides."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from analysis.figures.style import blank, grid, styled
from emgface.anatomy.head.picture import Drawn, Parts, head_geometry
from emgface.anatomy.jaw.picture import jaw_geometry
from emgface.anatomy.jaw.run import drawn
from emgface.pictures.body import Body
from emgface.pictures.render import PICTURE_VIEWS, VIEWS, window_of
from emgface.pictures.stills import paint

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HALF_VIEWS = {"front": "front", "left": "left", "right": "right: the inside"}
"""Views of the left half of a model, with their titles."""


def jaw_model_figure(jaw: xr.Dataset) -> "Figure":
    """Draw bones and line muscles of a jaw_model; without surfaces of the bones, its muscles."""
    bodies = tuple(str(name) for name in jaw["body"].values)
    rest = head_at_rest({"jaw": jaw}).assign(drawn(jaw, bodies))
    if "surface_position" not in jaw:
        rest = rest.assign(
            surface_position=(("vertex", "axis"), np.zeros((0, 3))),
            surface_triangle=(("triangle", "corner"), np.zeros((0, 3), dtype=np.int64)),
            surface_body=("vertex", np.zeros(0, dtype=np.int32)),
        )
    return _figure(
        jaw_geometry(rest),
        jaw.attrs["name"],
        "bones and muscles",
        dict(zip(PICTURE_VIEWS, PICTURE_VIEWS, strict=True)),
    )


def tongue_model_figure(tongue: xr.Dataset) -> "Figure":
    """Draw the left half of a tongue_model with the fibres of both halves."""
    parts = {"tongue": tongue}
    return _figure(
        head_geometry(head_at_rest(parts), parts),
        tongue.attrs["name"],
        "left half, fibres",
        HALF_VIEWS,
    )


def head_model_figure(lists: xr.Dataset, parts: Parts) -> "Figure":
    """Draw the left half of a head_model: skin, bones, teeth, tongue and muscles."""
    return _figure(
        head_geometry(head_at_rest(parts), parts), lists.attrs["name"], "left half", HALF_VIEWS
    )


def head_at_rest(parts: Parts) -> xr.Dataset:
    """Positions of tissues and bodies of models at rest, as a motion with one output."""
    tissues = [name for name in parts if name != "jaw"]
    nodes = [parts[name]["position"].values for name in tissues]
    bodies = [] if "jaw" not in parts else [str(name) for name in parts["jaw"]["body"].values]
    return xr.Dataset(
        {
            "node_position": (
                ("time", "node", "axis"),
                np.concatenate([np.zeros((0, 3)), *nodes])[None],
            ),
            "tissue_nodes": ("tissue", np.array([len(X) for X in nodes], dtype=np.int64)),
            "body_position": (("time", "body", "axis"), np.zeros((1, len(bodies), 3))),
            "body_quaternion": (
                ("time", "body", "part"),
                np.tile([1.0, 0.0, 0.0, 0.0], (1, len(bodies), 1)),
            ),
        },
        coords={"tissue": tissues, "body": bodies, "time": [0.0]},
    )


@styled
def _figure(geometry: Drawn, name: str, what: str, views: Mapping[str, str]) -> "Figure":
    points, triangle, colour, _ = geometry
    X = points[0]
    body = Body(
        len(X), np.zeros((0, 4), dtype=np.int64), np.zeros((0, 3)), triangle, colour, len(X)
    )
    figure = blank(11.0, 4.6)
    for panel, (side, title) in zip(grid(figure, 1, len(views))[0], views.items(), strict=True):
        paint(panel, body, X, VIEWS[side], window_of(X, VIEWS[side], 0.01))
        panel.set_title(title)
    figure.suptitle(f"{name} at rest: {what}")
    return figure
