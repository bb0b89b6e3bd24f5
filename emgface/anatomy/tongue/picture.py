"""Page with a moving tongue, cut in the midsagittal plane, and figure of its shapes."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.figures.style import COLOURS, blank, grid, styled
from emgface.anatomy.jaw.picture import RELAXED, drawn_times, moving_page
from emgface.anatomy.tongue.template.muscles import TONGUE_MUSCLES
from emgface.face.parts import Floats
from emgface.face.quality import element_centres
from emgface.face.surface import boundary_faces, triangles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TISSUE = (0.87, 0.60, 0.58)
"""Colour of the tongue."""
TONGUE_MUSCLE_TITLES = {name: muscle.title for name, muscle in TONGUE_MUSCLES.items()}
"""Full names of the muscles of a tongue."""
DRAWN_FIBRE_RADIUS, DRAWN_FIBRE_SIDES = 0.35e-3, 5
"""Radius of a drawn fibre [m], and its number of sides."""
TONGUE_CAPTION = (
    "Simulated. Above: contour in the midsagittal plane (or the outline from the left) at the start, at "
    "the largest activation and at the end, and activation of the muscles that are active. Below: "
    "displacement of tip and back forwards and upwards, and change of the volume."
)


def tongue_page(motion: xr.Dataset) -> str:
    """Write the page of a tongue_motion as HTML without network requests."""
    shown = motion.isel(time=drawn_times(motion["time"].values))
    title = f"{motion.attrs.get('task', 'motion')} of the {motion.attrs['tongue']}"
    return moving_page(
        shown,
        *tongue_geometry(shown),
        what="tongue",
        title=title,
        about=f"{motion.attrs['tongue']}, muscles as {motion.attrs['muscles']}.",
        words="The motion of the tongue is simulated: its left half, and the fibres of both halves.",
        heading="Shapes and activations",
        figure=tongue_figure(motion),
        caption=TONGUE_CAPTION,
        names=TONGUE_MUSCLE_TITLES,
    )


def tongue_geometry(
    motion: xr.Dataset, *, both: bool = False
) -> tuple[Floats, NDArray[np.int64], Floats, NDArray[np.int64]]:
    """Points (time, n, 3), triangles, colours, and the number of the muscle of each point, from 1.

    The left half, closed in the midline, or both of them.
    """
    q = motion["node_position"].transpose("time", "node", "axis").values
    connectivity = motion["connectivity"].values
    left = element_centres(q[0], connectivity)[:, 0] < 0.0
    faces, _ = boundary_faces(connectivity[left])
    halves = [faces]
    if both:  # the faces in the midline are those of the left half
        other, _ = boundary_faces(connectivity[~left])
        shared = {tuple(face) for face in np.sort(faces, axis=1).tolist()}
        halves.append(
            other[[tuple(face) not in shared for face in np.sort(other, axis=1).tolist()]]
        )
    points, own, numbers, first = list[Floats](), list[NDArray[np.int64]](), list[Floats](), 0
    for half in halves:  # with points of their own, so that normals end in the midline
        node, corner = np.unique(triangles(half, q[0]), return_inverse=True)
        points.append(q[:, node])
        own.append(corner.reshape(-1, 3) + first)
        numbers.append(np.zeros(len(node)))
        first += len(node)
    lines = motion["line_position"].transpose("time", "fibre_point", "axis").values
    owner, muscle = motion["fibre_of_point"].values, motion["fibre_muscle"].values
    for f, m in enumerate(muscle):
        around_it, around = tube(lines[:, owner == f])
        points.append(around_it)
        own.append(around + first)
        numbers.append(np.full(around_it.shape[1], m + 1))
        first += around_it.shape[1]
    fibre = np.concatenate(numbers)
    colour = np.where(fibre[:, None] > 0, RELAXED, TISSUE)
    own_triangles = np.concatenate(own).astype(np.int64)
    return np.concatenate(points, axis=1), own_triangles, colour, fibre.astype(np.int64)


def tube(line: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Points (time, k AROUND, 3) around a polyline (time, k, 3), and their triangles."""
    along = np.gradient(line, axis=1)
    along /= np.linalg.norm(along, axis=2, keepdims=True) + 1e-12
    side = np.cross(along, np.array([1.0, 0.2, 0.1]))
    side /= np.linalg.norm(side, axis=2, keepdims=True) + 1e-12
    other = np.cross(along, side)
    angle = np.linspace(0.0, 2.0 * np.pi, DRAWN_FIBRE_SIDES, endpoint=False)[:, None]
    ring = np.cos(angle) * side[:, :, None] + np.sin(angle) * other[:, :, None]
    points = line[:, :, None] + DRAWN_FIBRE_RADIUS * ring
    index = np.arange(line.shape[1] * DRAWN_FIBRE_SIDES).reshape(-1, DRAWN_FIBRE_SIDES)
    after = np.roll(index, -1, axis=1)
    quads = np.stack([index[:-1], after[:-1], after[1:], index[1:]], axis=-1).reshape(-1, 4)
    return points.reshape(len(line), -1, 3), np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])


@styled
def tongue_figure(motion: xr.Dataset) -> "Figure":
    """Draw the midsagittal contour, activations, and displacements of tip and back."""
    figure = blank(9.0, 6.6)
    (shape, drive), (moved, swollen) = grid(figure, 2, 2)
    t = motion["time"].values
    a = motion["activation"].transpose("time", "muscle").values
    most = int(a.sum(axis=1).argmax())
    q = 1e3 * motion["node_position"].transpose("time", "node", "axis").values
    if "contour_node" in motion:
        contour = motion["contour_node"].values
        for k, line, label in (
            (0, "--", "start"),
            (most, "-", f"{t[most]:.2f} s"),
            (-1, ":", "end"),
        ):
            shape.plot(*q[k, contour][:, 1:].T, line, label=label)
    else:
        for k, line, label in ((0, ".", "start"), (most, ".", f"{t[most]:.2f} s")):
            shape.plot(*q[k][:, 1:].T, line, markersize=2, label=label)
    shape.set(xlabel="forward [mm]", ylabel="up [mm]", title="midsagittal contour", aspect="equal")
    shape.set_adjustable("datalim")
    names = motion["muscle"].values
    for k in np.flatnonzero(a.max(axis=0) > 0.0)[:8]:
        line = "--" if str(names[k]).endswith("_L") else "-"
        drive.plot(t, a[:, k], line, label=str(names[k]))
    drive.set(xlabel="time [s]", ylabel="activation", title="muscles")
    d = motion["position"].transpose("time", "marker", "axis")
    d = 1e3 * (d - d.isel(time=0))
    for name, colour in zip(("tip", "back"), COLOURS, strict=False):
        for axis, line, word in ((1, "-", "forward"), (2, "--", "up")):
            moved.plot(
                t, d.sel(marker=name).values[:, axis], line, color=colour, label=f"{name} {word}"
            )
    moved.set(xlabel="time [s]", ylabel="displacement [mm]", title="tip and back")
    volume = motion["volume"].values
    swollen.plot(t, 100.0 * (volume / volume[0] - 1.0))
    swollen.set(xlabel="time [s]", ylabel="change of volume [%]", title="volume")
    for panel in (shape, drive, moved):
        if panel.get_legend_handles_labels()[0]:
            panel.legend(fontsize="x-small")
    task = motion.attrs.get("task", "motion")
    figure.suptitle(f"{task} of the {motion.attrs['tongue']} (simulated)")
    return figure
