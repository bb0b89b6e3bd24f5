"""Figure of a fit: distance of the skin from the scan, thickness and its interval, from three sides."""

from typing import TYPE_CHECKING, Any, Final, Protocol, cast

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize

from analysis.figures.style import blank, grid, styled
from emgface.face.check import TO_MM
from emgface.fit.deform import Deformed
from emgface.fit.targets import Target
from emgface.fit.triangulated import Floats, Surface
from emgface.pictures.body import body_of, skin_of
from emgface.pictures.render import DISPLACEMENT, PICTURE_VIEWS, VIEWS, window_of
from emgface.pictures.stills import marks, paint

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MISSING: Final = (0.62, 0.62, 0.62)  #: colour of skin without a counterpart on the surface
COLOUR_QUANTILE: Final = 0.98  #: quantile at which the scale of colours ends


class FittedSurface(Protocol):
    """What the figure uses of a fitted face (`emgface.fit.person.Fitted`)."""

    @property
    def face(self) -> xr.Dataset: ...  # noqa: D102
    @property
    def targets(self) -> tuple[Target, ...]: ...  # noqa: D102
    @property
    def thickness(self) -> pd.DataFrame: ...  # noqa: D102
    @property
    def prior(self) -> object: ...  # noqa: D102
    @property
    def deformed(self) -> Deformed: ...  # noqa: D102


@styled
def fit_figure(fitted: FittedSurface) -> "Figure":
    """Draw the fitted skin from three sides: distance to the scan, thickness, width of its interval."""
    face = fitted.face
    skin = skin_of(face)
    body = body_of(face, skin)
    q = face["position"].values
    rows: list[tuple[str, Floats]] = []
    for target in fitted.targets:
        if target.name == "skin":
            own = np.full(len(q), np.nan)
            own[target.sheet.nodes] = distance_at(target.surface, q[target.sheet.nodes])
            rows.append(("distance to the scan [mm]", own))
    table, n = fitted.thickness, len(q)
    rows.append(("thickness [mm]", _at_nodes(table["node"], table["after"], n)))
    if fitted.prior is not None:
        width = (table["high"] - table["low"]).to_numpy()
        rows.append(
            ("width of the 90 % interval\nof thickness [mm]", _at_nodes(table["node"], width, n))
        )
    figure = blank(8.6, 2.9 * len(rows) + 0.4)
    kind = "simulated" if face.attrs["fit_of"] == "simulated" else "measured"
    cast(Any, figure).suptitle(f"{face.attrs['name']} (fitted to {kind} data)")
    panels = grid(figure, len(rows), len(PICTURE_VIEWS))
    colours = LinearSegmentedColormap.from_list("", DISPLACEMENT)
    for row, (what, value) in enumerate(rows):
        own = value[skin.node]
        top = float(np.nanquantile(own, COLOUR_QUANTILE)) if np.isfinite(own).any() else 1.0
        norm = Normalize(0.0, max(top, 0.05))
        painted = np.asarray(colours(norm(np.nan_to_num(own))))[:, :3]
        painted[~np.isfinite(own)] = MISSING
        for column, side in enumerate(PICTURE_VIEWS):
            panel = panels[row][column]
            window = window_of(q[skin.node], VIEWS[side], 0.02)
            paint(panel, body, q[skin.node], VIEWS[side], window, colour=painted)
            if row == 0:
                panel.set_title(side)
                points = fitted.deformed.landmarks.target
                marks(panel, points, VIEWS[side], marker="x", markersize=3.5, color="black")
                panel.set_xlim(TO_MM * window.left, TO_MM * window.right)
                panel.set_ylim(TO_MM * window.bottom, TO_MM * window.top)
        bar = cast(Any, figure).colorbar(
            ScalarMappable(norm, colours),
            ax=np.array(panels[row]),
            shrink=0.8,
            pad=0.01,
            extend="max",
        )
        bar.set_label(what)
    return figure


def distance_at(surface: Surface, q: Floats) -> Floats:
    """Distance (n,) of points [mm]; NaN where the surface has a hole or ends."""
    near = surface.nearest(q)
    border = surface.at_border(near) if len(surface.open_edges) else np.zeros(len(q), dtype=bool)
    return np.where(border, np.nan, TO_MM * near.distance)


def _at_nodes(node: Any, value: Any, n: int) -> Floats:
    values = np.full(n, np.nan)
    values[np.asarray(node)] = np.asarray(value)
    return values
