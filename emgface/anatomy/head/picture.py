"""Page with a moving head or its section: skin, bones, teeth, tongue and muscles by activation."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import KDTree

from analysis.figures.style import COLOURS, blank, grid, styled
from emgface.anatomy.jaw import picture as of_jaw
from emgface.anatomy.jaw.picture import RELAXED, drawn_times, jaw_geometry, moving_page
from emgface.anatomy.jaw.run import drawn
from emgface.anatomy.tongue import picture as of_tongue
from emgface.anatomy.tongue.picture import tongue_geometry, tube
from emgface.anatomy.tongue.run import fibre_points
from emgface.errors import HeadError
from emgface.face.parts import Floats
from emgface.face.surface import triangles
from emgface.muscles import MUSCLE_NAMES
from emgface.pictures.body import PART_COLOURS, skin_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Parts = Mapping[str, xr.Dataset]
Drawn = tuple[Floats, NDArray[np.int64], Floats, NDArray[np.int64]]
"""Points (time, n, 3), triangles, colours, and the number of the muscle of each point, from 1."""

HEAD_CAPTION = (
    "Simulated. Above: paths of lower incisor, tip and back of the tongue and lips, seen from the left. "
    "Below: opening of the mouth, and activation of the muscles that are active."
)
MIDLINE_TOLERANCE = 1e-4
"""Largest x of the centre of a triangle of the left half [m]."""
DRAWN_PATHS = ("lower_incisor", "tip", "back", "hyoid", "LL", "UL")
"""Points whose paths are drawn, if the head has them."""


def head_page(motion: xr.Dataset, parts: Parts) -> str:
    """Write the page of a head_motion as HTML without network requests.

    A section along the midline shows teeth, tongue and muscles of the left half from the right.

    Raises
    ------
    HeadError
        The head has neither tissue nor bones.
    """
    shown = motion.isel(time=drawn_times(motion["time"].values))
    q, rows, colour, fibre = _surfaces(shown, parts)
    left = _of_left(q, rows)
    return moving_page(
        shown,
        q,
        np.concatenate([rows[left], rows[~left]]),
        colour,
        fibre,
        names=of_jaw.JAW_MUSCLE_TITLES | of_tongue.TONGUE_MUSCLE_TITLES | MUSCLE_NAMES,
        section=int(left.sum()) if left.any() and not left.all() else None,
        what="head",
        title=f"{motion.attrs.get('task', 'motion')} of the {motion.attrs['head']}",
        about=f"{motion.attrs['head']}, steps of at most {1e3 * motion.attrs['step_s']:g} ms.",
        words="The motion of the head is simulated: skin, bones, teeth, tongue. Its section along the "
        "midline is seen from the right.",
        heading="Paths, opening and activations",
        figure=head_figure(motion),
        caption=HEAD_CAPTION,
    )


def head_geometry(motion: xr.Dataset, parts: Parts) -> Drawn:
    """Surfaces of the left half of all parts of a motion."""
    q, rows, colour, fibre = _surfaces(motion, parts)
    used, kept = np.unique(rows[_of_left(q, rows)], return_inverse=True)
    return q[:, used], kept.reshape(-1, 3).astype(np.int64), colour[used], fibre[used]


def _of_left(q: Floats, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Triangles whose centre is on the left at the start."""
    return q[0, rows, 0].mean(axis=1) < MIDLINE_TOLERANCE


def _surfaces(motion: xr.Dataset, parts: Parts) -> Drawn:
    """Surfaces of all parts of a motion."""
    ends = np.cumsum([0, *motion["tissue_nodes"].values.tolist()])
    nodes = {
        str(tissue): motion["node_position"]
        .isel(node=slice(ends[k], ends[k + 1]))
        .transpose("time", "node", "axis")
        .values
        for k, tissue in enumerate(motion["tissue"].values)
    }
    pieces, first = list[Drawn](), 0
    for part, own in parts.items():
        pieces += [
            (points, corners, colour, np.where(fibre > 0, fibre + first, 0))
            for points, corners, colour, fibre in _PAINTERS[part](motion, own, nodes.get(part))
        ]
        first += own.sizes["muscle"]
    if not pieces:
        raise HeadError("the motion has no parts to draw, expected a face, a jaw or a tongue")
    start = np.cumsum([0, *(own[0].shape[1] for own in pieces)])
    corners = [own[1] + k for own, k in zip(pieces, start, strict=False)]
    points, _, colours, fibres = zip(*pieces, strict=True)
    q, rows = np.concatenate(points, axis=1), np.concatenate(corners)
    return q, rows, np.concatenate(colours), np.concatenate(fibres)


def _face(motion: xr.Dataset, face: xr.Dataset, q: Floats | None) -> list[Drawn]:
    """Skin, and the fibres of the muscles."""
    assert q is not None  # a face has nodes
    skin = skin_of(face)
    X = face["position"].values[skin.node]
    corners = triangles(skin.facet, X)
    colour = np.tile(PART_COLOURS[0], (len(X), 1))
    for part in sorted(PART_COLOURS):
        colour[skin.facet[skin.part == part].ravel()] = PART_COLOURS[part]
    pieces: list[Drawn] = [(q[:, skin.node], corners, colour, np.zeros(len(X), dtype=np.int64))]
    points = face["fibre_position"].values  # ends on bone, outside the tissue, move with its nodes
    _, nearest = KDTree(face["position"].values).query(points)
    lines = points + q[:, nearest] - face["position"].values[nearest]
    for k, muscle in enumerate(face["fibre_muscle"].values):
        own = lines[:, face["fibre_of_point"].values == k]
        if own.shape[1] > 1:
            around, rows = tube(own)
            n = around.shape[1]
            pieces.append((around, rows, np.tile(RELAXED, (n, 1)), np.full(n, muscle + 1)))
    return pieces


def _jaw(motion: xr.Dataset, jaw: xr.Dataset, q: Floats | None) -> list[Drawn]:
    """Bones, with the line muscles."""
    if "surface_position" not in jaw or "body_position" not in motion:
        return []
    bodies = tuple(str(body) for body in motion["body"].values)
    own = motion[["body_position", "body_quaternion"]].assign(drawn(jaw, bodies))
    return [jaw_geometry(own)]


def _tongue(motion: xr.Dataset, tongue: xr.Dataset, q: Floats | None) -> list[Drawn]:
    """Both halves, with all fibres."""
    assert q is not None  # a tongue has nodes
    lines = fibre_points(tongue, q)
    names = ("fibre_of_point", "fibre_muscle", "connectivity")
    own = xr.Dataset(
        {
            "node_position": (("time", "node", "axis"), q),
            "line_position": (("time", "fibre_point", "axis"), lines),
            **{name: tongue[name].variable for name in names},
        }
    )
    return [tongue_geometry(own, both=True)]


_PAINTERS = {"face": _face, "jaw": _jaw, "tongue": _tongue}


@styled
def head_figure(motion: xr.Dataset, parts: Parts | None = None) -> "Figure":
    """Draw paths of points from the left, opening of the mouth and activations; parts are not drawn."""
    figure = blank(9.0, 6.4)
    (paths, opening), (drive, least) = grid(figure, 2, 2)
    t = motion["time"].values
    names = [name for name in DRAWN_PATHS if name in motion["marker"].values]
    for name, colour in zip(names, [*COLOURS, *COLOURS], strict=False):
        x = 1e3 * motion["position"].sel(marker=name).transpose("time", "axis").values
        paths.plot(x[:, 1] - x[0, 1], x[:, 2] - x[0, 2], color=colour, label=name)
    paths.set(xlabel="forward [mm]", ylabel="up [mm]", title="displacements", aspect="equal")
    paths.set_adjustable("datalim")
    if "mouth_area" in motion:
        opening.plot(t, 1e6 * motion["mouth_area"].values)
    opening.set(xlabel="time [s]", ylabel="area [mm$^2$]", title="opening of the mouth")
    a = motion["activation"].transpose("muscle", "time").values
    for k in np.argsort(-a.max(axis=1), kind="stable")[:8]:
        name = str(motion["muscle"].values[k])
        if a[k].max() > 0.0:
            drive.plot(t, a[k], "--" if name.endswith("_L") else "-", label=name)
    drive.set(xlabel="time [s]", ylabel="activation", title="muscles")
    if "smallest_J" in motion:
        least.plot(t, motion["smallest_J"].values)
    least.set(xlabel="time [s]", ylabel="smallest det F", title="compression")
    for panel in (paths, drive):
        if panel.get_legend_handles_labels()[0]:
            panel.legend(fontsize="x-small")
    figure.suptitle(
        f"{motion.attrs.get('task', 'motion')} of the {motion.attrs['head']} (simulated)"
    )
    return figure
