"""Penetration depths of surfaces, computed independently of the contact search."""

from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.face.closed import open_edges
from emgface.face.lips import exposed, lining, lip_surface
from emgface.face.parts import FREE, LIPS, MANDIBLE, arches_of
from emgface.face.surface import nearest_on_triangles, winding_number

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MOUTH_MIDDLE: Final = 6e-3  #: half width of the middle part of the mouth [m]
STRIP_HALF_WIDTH: Final = 2e-3
"""Half width of the strip of nodes that represents a position across the mouth [m]."""


def depths(points: Floats, corners: Floats) -> Floats:
    """Depth (n,) of points (n, 3) inside a closed surface of outward triangles, 0 outside.

    It is the distance to the nearest point of the surface if the winding number exceeds one half.
    """
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    depth = np.zeros(len(points))
    near = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    inside = near[winding_number(points[near], corners) > 0.5]
    for k in inside:
        depth[k] = np.linalg.norm(nearest_on_triangles(points[k], corners)[0] - points[k])
    return depth


class Penetration:
    """Depths of the lips in each other and of the lining in the teeth of one face.

    A depth in teeth requires closed arches: it is NaN in open ones, as of `bones = "patch"` of an
    import, which have no inside, and 0 without arches. Errors as of `emgface.face.lips.lip_surface`.
    """

    def __init__(self, face: xr.Dataset) -> None:
        self._lips = [lip_surface(face, lip) for lip in LIPS]
        self._shown = [exposed(face, lip) for lip in self._lips]
        nodes = [np.unique(lip) for lip in self._lips]
        self._own = [np.setdiff1d(nodes[0], nodes[1]), np.setdiff1d(nodes[1], nodes[0])]
        arches = arches_of(face)
        self._arches = [arch for arch in arches if not len(open_edges(arch.triangles))]
        self._open = len(self._arches) < len(arches)
        touching = np.unique(lining(face)) if self._arches else np.empty(0, dtype=np.int64)
        self._lining = touching[face["fixed"].values[touching] == FREE]
        self._rest = self._in_teeth(face["position"].values)

    def lips(self, q: Floats) -> float:
        """Largest depth of a node of one lip in the other, for positions q (nodes, 3) [m]."""
        return max(
            float(depths(q[self._own[k]], q[self._lips[1 - k]]).max(initial=0.0)) for k in (0, 1)
        )

    def teeth(self, q: Floats) -> float:
        """Largest depth of a node of lips and cheeks in the teeth, beyond that at rest [m]."""
        if self._open:
            return float("nan")
        increase = [now - rest for now, rest in zip(self._in_teeth(q), self._rest, strict=True)]
        return max((float(deeper.max(initial=0.0)) for deeper in increase), default=0.0)

    def gap(self, q: Floats) -> float:
        """Largest gap between the lips within `MOUTH_MIDDLE` of the midline, for positions q [m].

        For each position from left to right the gap is the smallest distance from a node of the
        upper lip to the surface of the lower lip, and 0 for nodes inside it.
        """
        corners = q[self._lips[1][self._shown[1]]]
        nodes = np.setdiff1d(self._lips[0][self._shown[0]], self._lips[1])
        nodes = nodes[np.abs(q[nodes, 0]) < MOUTH_MIDDLE + STRIP_HALF_WIDTH]
        away = np.array([np.linalg.norm(nearest_on_triangles(p, corners)[0] - p) for p in q[nodes]])
        away[depths(q[nodes], q[self._lips[1]]) > 0.0] = 0.0
        places = np.linspace(-MOUTH_MIDDLE, MOUTH_MIDDLE, 9)
        near = np.abs(q[nodes, 0] - places[:, None]) < STRIP_HALF_WIDTH
        return max(float(away[row].min(initial=np.inf)) for row in near if row.any())

    def at_rest(self) -> dict[str, tuple[int, float]]:
        """Number of nodes within each bone at rest, and their largest depth [m]."""
        names = ["mandible" if arch.bone == MANDIBLE else "maxilla" for arch in self._arches]
        return {
            name: (int((depth > 0.0).sum()), float(depth.max(initial=0.0)))
            for name, depth in zip(names, self._rest, strict=True)
        }

    def _in_teeth(self, q: Floats) -> list[Floats]:
        return [depths(q[self._lining], arch.points[arch.triangles]) for arch in self._arches]
