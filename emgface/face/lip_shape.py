"""Shape of the mouth opening: width, height, area, overlap, rounding and protrusion of the lips."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.check import sheet_nodes
from emgface.face.parts import OUTER
from emgface.face.surface import boundary_edges, faces_among
from emgface.muscles import LIP_MARKERS

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

#: number of positions across the mouth at which the gap between the lips is measured
GAP_POSITIONS = 201


@dataclass(frozen=True, eq=False)
class LipRim:
    """Margins of the lips, at which the skin ends at the mouth opening.

    `upper` and `lower` are nodes from the left to the right corner; the corners belong to both.
    """

    upper: Integers
    lower: Integers


def lip_rim(face: xr.Dataset) -> LipRim:
    """Find the boundary loop of the skin at the mouth and divide it at the mouth corners.

    The corners are the nodes `mouth_corner_node` of a treated or fitted face, which are those of the
    face before it; otherwise the leftmost and the rightmost node of the loop.

    Raises FaceError if the face has no `lip_opening_node`, or they are not on a closed boundary of
    the skin.
    """
    if "lip_opening_node" not in face:
        raise FaceError("the face has no lip_opening_node, expected one node of each lip")
    top, bottom = (int(node) for node in face["lip_opening_node"].values)
    faces, _ = faces_among(face["connectivity"].values, sheet_nodes(face, OUTER))
    neighbours: dict[int, list[int]] = {}
    for a, b in boundary_edges(faces):
        neighbours.setdefault(int(a), []).append(int(b))
        neighbours.setdefault(int(b), []).append(int(a))
    loop = _walk(top, neighbours)
    if bottom not in loop:
        raise FaceError(
            "the lip_opening_nodes lie on no common closed boundary of the skin, expected the mouth"
        )
    left, right = _corners(face, loop)
    rolled = np.roll(loop, -left)
    turn = (right - left) % len(loop)
    one, other = rolled[: turn + 1], np.concatenate([rolled[turn:], rolled[:1]])[::-1]
    upper, lower = (one, other) if top in one else (other, one)
    return LipRim(upper.astype(np.int64), lower.astype(np.int64))


def _corners(face: xr.Dataset, loop: Integers) -> tuple[int, int]:
    """Positions of the left and the right corner in the loop of the margin."""
    x = face["position"].values[loop, 0]
    if "mouth_corner_node" in face:
        at = [np.flatnonzero(loop == node) for node in face["mouth_corner_node"].values]
        if any(len(one) == 0 for one in at):
            raise FaceError(
                "a mouth_corner_node does not lie on the boundary of the skin at the mouth, which "
                "contains the lip_opening_nodes: expected the corners between upper and lower margin"
            )
        left, right = int(at[0][0]), int(at[1][0])
        if x[left] >= x[right]:
            raise FaceError(
                "the left mouth_corner_node does not lie to the left of the right one (+x is right): "
                "exchange them"
            )
        return left, right
    return int(np.argmin(x)), int(np.argmax(x))


def has_mouth(face: xr.Dataset) -> bool:
    """Return True if the skin of a face has a mouth opening (`lip_rim`)."""
    try:
        lip_rim(face)
    except FaceError:
        return False
    return True


def _walk(start: int, neighbours: dict[int, list[int]]) -> Integers:
    """Nodes of the closed boundary through a node, in order; empty if there is none."""
    loop, before, here = [start], -1, start
    while True:
        if len(neighbours.get(here, [])) != 2:
            return np.empty(0, dtype=np.int64)
        ahead = [node for node in neighbours[here] if node != before]
        before, here = here, ahead[0]
        if here == start:
            return np.array(loop, dtype=np.int64)
        loop.append(here)


UP_DIRECTION: Final = (0.0, 0.0, 1.0)
"""Direction from the lower to the upper lip: the z axis of every face model is superior."""


def lip_opening(face: xr.Dataset, position: Floats) -> float:
    """Height of the margin of the upper lip above that of the lower in the midline [m].

    It is measured along `UP_DIRECTION` and negative if the margins have passed each other;
    ``lip_opening`` of a trajectory is the same quantity.
    """
    top, bottom = (int(node) for node in face["lip_opening_node"].values)
    return float((position[top] - position[bottom]) @ np.array(UP_DIRECTION))


def lip_shape(face: xr.Dataset, rim: LipRim, position: Floats) -> dict[str, float]:
    """Measure the mouth opening of a face with deformed positions (nodes, 3) [m].

    The result contains `width` between the corners of the opening along x [m]; `height` of the
    opening in the midline (`lip_opening`) [m]; `area` of the opening and `overlap` of the lips in
    front view [m^2]; `roundness`, height over width [1]; `protrusion`, the mean anterior
    displacement from the geometry of `face` of the four paramedian markers; and
    `margin_protrusion`, that of the two margins in the midline [m].
    """
    top, bottom = (int(node) for node in face["lip_opening_node"].values)
    upper, lower = position[rim.upper], position[rim.lower]
    ends = np.array([upper[0, 0], upper[-1, 0]])
    low, high = float(ends.min()), float(ends.max())
    x = np.linspace(low, high, GAP_POSITIONS)
    gap = _height(upper, x) - _height(lower, x)
    step = (high - low) / (GAP_POSITIONS - 1)
    node = face["marker_node"].values
    paramedian = [node[k] for k, name in enumerate(LIP_MARKERS) if "paramedian" in name]
    forward = (position - face["position"].values)[:, 1]
    height = lip_opening(face, position)
    return {
        "width": high - low,
        "height": height,
        "area": float(np.maximum(gap, 0.0).sum() * step),
        "overlap": float(np.maximum(-gap, 0.0).sum() * step),
        "roundness": height / (high - low),
        "protrusion": float(forward[paramedian].mean()),
        "margin_protrusion": float(forward[[top, bottom]].mean()),
    }


def _height(margin: Floats, x: Floats) -> Floats:
    order = np.argsort(margin[:, 0], kind="stable")
    return np.interp(x, margin[order, 0], margin[order, 2])
