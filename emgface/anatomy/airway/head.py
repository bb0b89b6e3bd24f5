"""Area function of a head: the air between tongue, palate, teeth and lips, before a pharynx.

Sections lie in planes that stay with the skull, as the grids of tracings of radiographs do. In each,
the area is the integral over the width of the height between the wall (palate and teeth, or pharynx)
and the tongue or the lower teeth, and 0 where they touch or overlap.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

from emgface.anatomy.airway.area_function import area_function, equal_sections
from emgface.anatomy.head.model import Head, require_own_motion
from emgface.anatomy.jaw.skull import rotated
from emgface.errors import DataError
from emgface.face.mouth import Mouth
from emgface.face.parts import Floats, Integers
from emgface.face.surface import boundary_faces, triangles

Surface = tuple[Floats, Integers]
"""Points (n, 3) and triangles (m, 3)."""

PHARYNX_DEPTH: Final = 12e-3
"""Distance from the back of the tongue at rest to the wall of the pharynx [m]; about 1 to 1.5 cm in
adults, as commonly quoted. The head has no pharynx: this wall does not move."""
HALF_WIDTH: Final = 13e-3
"""Half the width of the pharynx behind the tongue [m]; the wall is half an ellipse of
`PHARYNX_DEPTH`. Along the velum the width increases to that of the palate."""
VELUM: Final = 30e-3
"""Length of the soft palate [m], over which the distance increases from that of the palate to
`PHARYNX_DEPTH`; the velum is closed."""
LARYNX_TUBE: Final = (0.02, 0.5e-4)
"""Length [m] and area [m^2] of the tube above the glottis, of the size of adults."""
GLOTTIS: Final = 12e-3
"""Distance of the middle of the glottis behind the point of the thyroid cartilage [m]."""
FLOOR_DEPTH: Final = 8e-3
"""Depth of the mouth below the tongue at rest where there is neither tongue nor teeth [m]."""
TEETH_GAP: Final = 0.1e-4
"""Area between closed teeth [m^2]; air passes between and around them."""
ARCH: Final = 25e-3  #: height within which the palate belongs to the plane through its midline [m]
TRACT_PLANES, POSITIONS_ACROSS = 28, 61
"""Planes between the larynx and the incisors, and positions across each."""
NEEDED: Final = ("face", "jaw", "tongue")


@dataclass(frozen=True, eq=False)
class TractGrid:
    """Planes of a head at rest: points (k, 2) of the wall and below it, y and z [m]."""

    outer: Floats
    inner: Floats
    width: Floats  #: (k,) half the width behind the hard palate, 0 below it [m]
    way: Floats  #: (k + 1,) lengths of the larynx and around the planes [m]
    front: float  #: y of the upper incisors, where the lips begin [m]

    @classmethod
    def from_head(cls, head: Head) -> "TractGrid":
        """Lay out the planes of a head; DataError if it lacks a part of `NEEDED` or a contour."""
        absent = [part for part in NEEDED if part not in head.named]
        if absent or "contour_node" not in head.parts.get("tongue", xr.Dataset()):
            raise DataError(
                f"the head has no {absent[0] if absent else 'contour of the tongue'}, expected face, "
                "jaw and a tongue with its midline contour"
            )
        tongue, palate = head.parts["tongue"], head.shell("palate")
        contour = tongue["position"].values[tongue["contour_node"].values][::-1, 1:]
        roof = _cut((palate.points, palate.triangles), np.zeros(3), np.array([1.0, 0.0, 0.0]))
        y = np.linspace(palate.points[:, 1].min() + 1e-6, palate.points[:, 1].max() - 1e-6, 40)
        vault = np.stack([y, _nearest(roof[..., 1], roof[..., 2], y)], axis=1)
        inner = _even(contour[: np.argmax(contour[:, 0]) + 1], 400)  # from the root to the tip
        past = (inner[:, 0] > vault[0, 0]) & (inner[:, 1] > 0.0)
        behind = inner[: int(np.argmax(past))]
        share = _length(vault)[-1] / (_length(vault)[-1] + _length(behind)[-1])
        ahead = round(TRACT_PLANES * share)
        behind, vault = _even(behind, TRACT_PLANES - ahead), _even(vault, ahead)
        along = np.gradient(behind, axis=0)
        normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        near = float(np.linalg.norm(vault[0] - behind[-1]))
        way_back = _length(behind)[-1] - _length(behind)
        off = near + (PHARYNX_DEPTH - near) * np.minimum(way_back / VELUM, 1.0)
        dorsum = inner[int(np.argmax(past)) :]
        under = np.minimum(vault[:, 0], dorsum[-1, 0])
        height = np.interp(under, dorsum[:, 0], dorsum[:, 1])
        outer = np.concatenate([behind + off[:, None] * normal, vault])
        below = np.concatenate([behind, np.stack([under, height], axis=1)])
        points = head.parts["jaw"]["point"].values.tolist()
        place = head.parts["jaw"]["point_position"].values[:, 1:]
        glottis = place[points.index("thyroid")] - [GLOTTIS, 0.0]
        incisor = place[points.index("upper_incisor")]
        middle = np.concatenate([glottis[None], 0.5 * (outer + below)])
        way = np.linalg.norm(np.diff(middle, axis=0), axis=1)
        front = max(float(incisor[0] - middle[-1, 0]), 1e-3)
        before = np.append(way[0] - LARYNX_TUBE[0], 0.5 * way[1:])
        around = before + np.append(0.5 * way[1:], front)
        arch = palate.points[palate.points[:, 1] < vault[0, 0] + 1e-3, 0].max() - HALF_WIDTH
        width = HALF_WIDTH + arch * np.maximum(1.0 - way_back / VELUM, 0.0)
        width = np.append(width, np.zeros(ahead))
        return cls(outer, below, width, np.append(LARYNX_TUBE[0], around), float(incisor[0]))

    def areas(self, palate: Surface, teeth: Surface, tongue: Surface) -> Floats:
        """Areas (k,) of the planes [m^2], between palate or pharynx and tongue or lower teeth."""
        area = np.empty(len(self.outer))
        for k, (o, i) in enumerate(zip(self.outer, self.inner, strict=True)):
            origin, down = np.array([0.0, *o]), np.array([0.0, *(i - o)])
            reach = float(np.linalg.norm(down))
            down /= reach
            normal = np.array([0.0, down[2], -down[1]])
            width = float(self.width[k])
            if width == 0.0:
                roof = _cut(palate, origin, normal) - origin
                roof = roof[(roof @ down < ARCH).all(axis=1)]  # not where the plane meets it again
                width = float(np.abs(roof[..., 0]).max())
                x = np.linspace(-width, width, POSITIONS_ACROSS) * (1.0 - 1e-9)
                top = -_nearest(roof[..., 0], -(roof @ down), x)
            else:
                x = np.linspace(-width, width, POSITIONS_ACROSS)
                top = min(reach, PHARYNX_DEPTH) * (1.0 - np.sqrt(1.0 - (x / width) ** 2))
            bottom = np.full(POSITIONS_ACROSS, np.inf)
            for surface in (tongue, teeth):
                cut = _cut(surface, origin, normal) - origin
                bottom = np.minimum(bottom, _nearest(cut[..., 0], cut @ down, x))
            bottom[np.isinf(bottom)] = reach + FLOOR_DEPTH
            gap = np.where(np.isfinite(top), np.maximum(bottom - top, 0.0), 0.0)
            area[k] = float(gap.sum() * 2.0 * width / (POSITIONS_ACROSS - 1))
        return area


def head_tract(head: Head, motion: xr.Dataset | None = None) -> xr.Dataset:
    """Area function of a head at rest, or at the instants of its motion.

    Parameters
    ----------
    head : Head
        With face, jaw and tongue (`emgface.anatomy.head`).
    motion : Dataset, optional
        Of schema head_motion, of the same head.

    Returns
    -------
    Dataset
        Of the kind "sound".

    Raises
    ------
    DataError
        As `TractGrid.from_head`, or the motion lacks the nodes of its tissues, or is of another head.
    """
    grid, mouth = TractGrid.from_head(head), Mouth.from_face(head.parts["face"])
    face, tongue = (head.parts[name]["position"].values for name in ("face", "tongue"))
    corners, _ = boundary_faces(head.parts["tongue"]["connectivity"].values)
    skin = triangles(corners, tongue)
    shells = {name: head.shell(name) for name in ("palate", "maxilla", "mandible")}
    palate = shells["palate"].points, shells["palate"].triangles
    if motion is not None and "node_position" not in motion:
        raise DataError(
            "the motion has no positions of nodes, expected the nodes of face and tongue"
        )
    if motion is not None:
        require_own_motion(head, motion)
    time = np.zeros(1) if motion is None else motion["time"].values
    areas, lengths = list[Floats](), list[Floats]()
    for k in range(len(time)):
        lips, dorsum, lower = face, tongue, shells["mandible"].points
        if motion is not None:
            q = motion["node_position"].isel(time=k).transpose("node", "axis").values
            lips, dorsum = q[: len(face)], q[len(face) : len(face) + len(tongue)]
            lower = _with_jaw(lower, head.parts["jaw"], motion, k)
        teeth = lower, shells["mandible"].triangles
        inside = grid.areas(palate, teeth, (dorsum, skin))
        bite = (shells["maxilla"].points, shells["maxilla"].triangles), teeth
        opening, forward = mouth.measure(lips)
        margin = float(mouth.rest[:, 1].mean()) - grid.front
        own = [LARYNX_TUBE[1], *inside, max(_bite(*bite, grid.front), TEETH_GAP), opening]
        areas.append(np.array(own))
        lengths.append(np.array([*grid.way, 2e-3, margin + forward]))
    description = (
        "generated head; the pharynx, the velum and the larynx do not move and have published sizes, "
        "the sides of the mouth beyond the teeth are closed"
    )
    S, L = np.array(areas), np.array(lengths)
    return area_function(*equal_sections(S, L), time, assumptions=description)


def _with_jaw(points: Floats, jaw: xr.Dataset, motion: xr.Dataset, k: int) -> Floats:
    """Points of the mandible at an instant of a motion, whose first instant need not be rest."""
    if "body" not in motion.coords or "jaw" not in motion["body"].values:
        return points
    moved = motion.sel(body="jaw").isel(time=k)
    rest = jaw["body_centre"].sel(body="jaw").values
    turn = moved["body_quaternion"].transpose("part").values
    return moved["body_position"].transpose("axis").values + rotated(turn, points - rest)


def _bite(upper: Surface, lower: Surface, front: float) -> float:
    """Area between the front teeth [m^2]: heights between their edges, in front view."""
    x = np.linspace(-10e-3, 10e-3, 41)
    edges: list[Floats] = []
    for (points, corners), sign in ((upper, 1.0), (lower, -1.0)):
        near = points[corners].reshape(-1, 3, 3)
        near = near[(near[..., 1] > front - 12e-3).all(axis=1)]
        sides = np.concatenate([near[:, [0, 1]], near[:, [1, 2]], near[:, [2, 0]]])
        edges.append(sign * _nearest(sides[..., 0], sign * sides[..., 2], x))
    gap = np.maximum(edges[0] - edges[1], 0.0)
    return float(np.nan_to_num(gap, posinf=0.0).sum() * 20e-3 / 40)


def _cut(surface: Surface, origin: Floats, normal: Floats) -> Floats:
    """Segments (m, 2, 3) in which a plane cuts a surface."""
    points, corners = surface
    d = (points - origin) @ normal
    above = d[corners] >= 0.0
    t = corners[above.any(axis=1) & ~above.all(axis=1)]
    a, b = t, np.roll(t, -1, axis=1)
    crosses = (d[a] >= 0.0) != (d[b] >= 0.0)  # two sides of every triangle
    share = d[a] / np.where(crosses, d[a] - d[b], 1.0)
    place = points[a] + share[..., None] * (points[b] - points[a])
    return place[crosses].reshape(-1, 2, 3)


def _nearest(along: Floats, value: Floats, x: Floats) -> Floats:
    """Smallest value of segments (m, 2) at every x; inf without one."""
    a, b = along[:, :1], along[:, 1:]
    across = b - a
    share = (x - a) / np.where(across == 0.0, 1.0, across)
    height = value[:, :1] + share * (value[:, 1:] - value[:, :1])
    on = (share >= 0.0) & (share <= 1.0) & (across != 0.0)
    return np.where(on, height, np.inf).min(axis=0, initial=np.inf)


def _length(line: Floats) -> Floats:
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))


def _even(line: Floats, count: int) -> Floats:
    """Points at equal distances along a line."""
    s = _length(line)
    return np.stack([np.interp(np.linspace(0.0, s[-1], count), s, c) for c in line.T], axis=1)
