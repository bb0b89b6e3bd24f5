"""Page with a moving jaw: bones, muscles coloured by activation, paths and forces."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from markupsafe import Markup
from numpy.typing import NDArray

from analysis.figures.style import COLOURS, blank, grid, styled
from emgface.anatomy.jaw.compared import JawComparison
from emgface.anatomy.jaw.model import Floats
from emgface.anatomy.jaw.outcomes import point_displacement
from emgface.anatomy.jaw.skull import rotated
from emgface.anatomy.jaw.template.muscles import JAW_MUSCLES
from emgface.errors import JawError
from emgface.pictures.body import Body
from emgface.pictures.encoding import (
    body_data,
    deltas,
    levels,
    middle_of,
    muscle_names,
    packed,
    whole,
)
from emgface.pictures.page import as_json, cells, environment, policy, style, svg_of, viewer_script
from emgface.pictures.render import VIEWS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BONE_COLOUR, CARTILAGE, FIXED_COLOUR = (0.90, 0.86, 0.76), (0.66, 0.77, 0.82), (0.80, 0.79, 0.78)
RELAXED, ACTIVE_COLOUR = (0.86, 0.62, 0.58), (0.60, 0.02, 0.10)
"""Colours of bones, cartilages, fixed bones, and of muscles at activation 0 and 1."""
JAW_MUSCLE_TITLES = {name: muscle.title for name, muscle in JAW_MUSCLES.items()}
"""Full names of the muscles of a jaw."""
JAW_FRAME_RATE = 60.0
"""Most frames per second."""
THINNED = 0.35
"""Radius of a drawn muscle over that of its physiological cross-section at 40 N/cm^2."""
FIBRE_SIDES, FIBRE_SECTIONS = 6, 5
_PROFILE = np.sqrt(np.sin(np.linspace(0.12, np.pi - 0.12, FIBRE_SECTIONS)))


def jaw_page(motion: xr.Dataset, comparison: JawComparison | None = None) -> str:
    """Write the page of a jaw_motion as HTML without network requests.

    `comparison` adds a recording: its path, and the scores of the motion and of baselines.

    Raises
    ------
    JawError
        The motion has no surfaces.
    """
    if "surface_position" not in motion:
        raise JawError(
            "the motion contains no surfaces: run a jaw of `emgface build jaw`, or one imported with "
            "its surfaces"
        )
    shown = motion.isel(time=drawn_times(motion["time"].values))
    task, name = motion.attrs.get("task", "motion"), motion.attrs["jaw"]
    return moving_page(
        shown,
        *jaw_geometry(shown),
        what="jaw",
        title=f"{task} of the {name}",
        about=f"{name}, muscle law {motion.attrs['law']}.",
        words="The motion of jaw, hyoid and larynx is simulated: rigid bones, moved by line muscles.",
        heading="Paths and forces",
        figure=jaw_figure(motion, comparison),
        caption=JAW_CAPTION + ("" if comparison is None else RECORDED_SENTENCE),
        comparison=comparison,
    )


def drawn_times(time: NDArray[np.floating]) -> slice:
    """Outputs that are drawn, at most `JAW_FRAME_RATE` per second."""
    every = (
        max(1, round(1.0 / (JAW_FRAME_RATE * float(np.diff(time).mean())))) if len(time) > 1 else 1
    )
    return slice(None, None, every)


def moving_page(
    shown: xr.Dataset,
    frames: Floats,
    triangle: NDArray[np.int64],
    colour: Floats,
    fibre: NDArray[np.int64],
    *,
    what: str,
    title: str,
    about: str,
    words: str,
    heading: str,
    figure: "Figure",
    caption: str,
    comparison: JawComparison | None = None,
    section: int | None = None,
    names: Mapping[str, str] = JAW_MUSCLE_TITLES,
) -> str:
    """Page with a moving surface, whose muscles are coloured by activation, and a figure below.

    Parameters
    ----------
    shown : xarray.Dataset
        Motion with ``position`` (marker), ``activation`` (muscle) and ``time``.
    frames : (time, n, 3) points [m].
    triangle, colour : corners (m, 3), and colours (n, 3) of points that are not of a muscle.
    fibre : (n,) number of the muscle of each point, from 1; 0 without.
    what : what moves, such as "jaw".
    title, about, words, heading, caption : texts.
    figure : of the second part of the page.
    comparison : recording that is shown with the motion, with its scores.
    names : full names of muscles without their side.
    section : number of the first triangles, which a section shows alone; None without one.
    """
    from emgface import __version__

    centre, at = middle_of(frames[0]), shown["time"].values
    body = Body(
        frames.shape[1],
        np.zeros((0, 4), dtype=np.int64),
        np.zeros((0, 3)),
        triangle,
        colour,
        frames.shape[1],
    )
    points = shown["position"].transpose("time", "marker", "axis").values
    data: dict[str, Any] = body_data(body, frames[0]) | {
        "what": what,
        "section": section,
        "fibre": packed(fibre.astype(np.uint8)),
        "relaxed": RELAXED,
        "active": ACTIVE_COLOUR,
        "instructions": {"": ""},
        "strategies": [""],
        "markers": [str(name) for name in shown["marker"].values],
        "muscles": muscle_names(shown["muscle"].values, names),
        "trials": [
            {
                "instruction": "",
                "strategy": "",
                "label": str(shown.attrs.get("task", "")),
                "about": about,
                "time": [round(float(t), 4) for t in at],
                "skin": deltas(whole(frames, centre)),
                "simulated": deltas(whole(points, centre)),
                "measured": None
                if comparison is None
                else deltas(whole(comparison.at(shown), centre)),
                "activation": levels(shown["activation"], at),
            }
        ],
    }
    script = viewer_script()
    page = environment("emgface.anatomy.jaw").get_template("jaw.html")
    return page.render(
        viewer=as_json(data),
        labels={"simulated": "points of the model", "measured": "recorded point"},
        views=VIEWS,
        tag="simulated motion",
        title=title,
        badge="simulated motion",
        words=words,
        heading=heading,
        figure=Markup(svg_of(figure, "paths", f"{heading} of a simulated motion")),
        caption=caption,
        scores=None if comparison is None else cells(comparison.scores),
        version=__version__,
        style=style(),
        script=Markup(script),
        policy=policy(script),
    )


JAW_CAPTION = (
    "Simulated. Above: paths of lower incisor and condyles, relative to the skull, from the side and "
    "from the front; a circle marks the start. Below: size of the reactions of the condyles and of the "
    "teeth, with the force of a morsel if there is one, and the muscles with the largest forces."
)

RECORDED_SENTENCE = (
    " Dotted: the recorded point, aligned in time as for the scores and shifted so that the means of "
    "both paths are equal."
)


def jaw_geometry(motion: xr.Dataset) -> tuple[Floats, NDArray[np.int64], Floats, NDArray[np.int64]]:
    """Points (time, n, 3), triangles, colours, and the number of the muscle of each point, from 1."""
    bones = moved_points(motion, motion["surface_position"].values, motion["surface_body"].values)
    names = [str(name) for name in motion["body"].values]
    shades = [CARTILAGE if name in ("thyroid", "cricoid") else BONE_COLOUR for name in names]
    colour = np.array([*shades, FIXED_COLOUR])[motion["surface_body"].values]
    ends, bodies = motion["muscle_position"].values, motion["muscle_body"].values
    a, b = (moved_points(motion, ends[:, k], bodies[:, k]) for k in (0, 1))
    radius = THINNED * np.sqrt(motion["muscle_force_max"].values / 40e4 / np.pi)
    muscles, own = _spindles(a, b, radius)
    n_muscle, per = len(radius), FIBRE_SIDES * FIBRE_SECTIONS
    triangles = np.concatenate(
        [
            motion["surface_triangle"].values,
            *(bones.shape[1] + k * per + own for k in range(n_muscle)),
        ]
    )
    fibre = np.concatenate([np.zeros(bones.shape[1]), np.repeat(np.arange(n_muscle) + 1, per)])
    colour = np.concatenate([colour, np.tile(RELAXED, (n_muscle * per, 1))])
    frames = np.concatenate([bones, muscles], axis=1)
    return frames, triangles.astype(np.int64), colour, fibre.astype(np.int64)


def moved_points(motion: xr.Dataset, X: Floats, body: NDArray[np.integer]) -> Floats:
    """Positions (time, n, 3) of points at X (n, 3) at rest on bodies (n,), -1 for fixed ones."""
    position = motion["body_position"].transpose("time", "body", "axis").values
    q = motion["body_quaternion"].transpose("time", "body", "part").values
    still = np.broadcast_to(X, (len(position), *X.shape)).copy()
    on = np.flatnonzero(body >= 0)
    k = body[on]
    still[:, on] = position[:, k] + rotated(q[:, k], X[on] - position[0, k])
    return still


def _spindles(a: Floats, b: Floats, radius: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Points (time, muscles * AROUND * ALONG, 3) of spindles from a to b, and triangles of one."""
    way = b - a
    t = way / np.linalg.norm(way, axis=-1, keepdims=True)
    side = np.cross(t, np.array([0.0, 1.0, 0.3]))
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    other = np.cross(t, side)
    angle = np.linspace(0.0, 2.0 * np.pi, FIBRE_SIDES, endpoint=False)
    ring = (
        np.cos(angle)[:, None] * side[..., None, :] + np.sin(angle)[:, None] * other[..., None, :]
    )
    along = np.linspace(0.0, 1.0, FIBRE_SECTIONS)
    centre = a[..., None, :] + along[:, None] * way[..., None, :]
    size = radius[:, None] * _PROFILE
    points = centre[..., :, None, :] + size[..., None, None] * ring[..., None, :, :]
    index = np.arange(FIBRE_SIDES * FIBRE_SECTIONS).reshape(FIBRE_SECTIONS, FIBRE_SIDES)
    after = np.roll(index, -1, axis=1)
    quads = np.stack([index[:-1], after[:-1], after[1:], index[1:]], axis=-1).reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return points.reshape(len(a), -1, 3), triangles


@styled
def jaw_figure(motion: xr.Dataset, comparison: JawComparison | None = None) -> "Figure":
    """Draw the paths of lower incisor and condyles with recorded ones, and forces over time."""
    figure = blank(9.0, 6.4)
    panels = grid(figure, 2, 2)
    names = (("lower incisor", "lower_incisor"), ("right condyle", "condyle_R"))
    names = (*names, ("left condyle", "condyle_L"))
    for panel, axis, label, title in (
        (panels[0][0], 1, "forward [mm]", "from the side"),
        (panels[0][1], 0, "to the right [mm]", "from the front"),
    ):
        for (name, marker), colour in zip(names, COLOURS[3:], strict=False):
            d = point_displacement(motion, marker)
            line = "--" if name.startswith("left") else "-"
            panel.plot(d[:, axis], d[:, 2], line, color=colour, label=name)
            panel.plot(*d[0, [axis, 2]], "o", color=colour, markersize=4)
            if comparison is not None and marker in comparison.path["marker"].values:
                d = comparison.displacement(motion, marker)
                panel.plot(d[:, axis], d[:, 2], ":", color="0.2", label=f"{name}, recorded")
        panel.set(xlabel=label, ylabel="up [mm]", title=title, aspect="equal")
        panel.set_adjustable("datalim")
    panels[0][1].invert_xaxis()
    time = motion["time"].values
    reactions, pulls = panels[1]
    for name, title in _JOINTS.items():
        if "joint" in motion.coords and name in motion["joint"].values:
            force = motion["joint_force"].sel(joint=name).transpose("time", "axis").values
            line = "--" if title.startswith("left") else "-"
            reactions.plot(time, np.linalg.norm(force, axis=1), line, label=title)
    if "morsel_force" in motion:
        reactions.plot(time, motion["morsel_force"], "k--", label="morsel")
    reactions.set(xlabel="time [s]", ylabel="force [N]", title="reactions")
    most = motion["muscle_force"].max("time").sortby(motion["muscle_force"].max("time")).muscle
    for name in most.values[-6:][::-1]:
        line = "--" if str(name).endswith("_L") else "-"
        pulls.plot(time, motion["muscle_force"].sel(muscle=name), line, label=str(name))
    pulls.set(xlabel="time [s]", ylabel="tension [N]", title="muscles")
    for panel in (panels[0][0], reactions, pulls):
        panel.legend(fontsize="x-small")
    title = f"{motion.attrs.get('task', 'motion')} of the {motion.attrs['jaw']} (simulated)"
    figure.suptitle(title)
    return figure


_JOINTS = {
    "tmj_R": "right condyle",
    "tmj_L": "left condyle",
    "bite_R": "right teeth",
    "bite_L": "left teeth",
}
