"""Hexahedral mesh of the tongue of a person, within jaw, palate and hyoid.

The mesh is a block with the coordinates u from the front (0) to the hyoid (1), v from the floor of the
mouth (0) to the dorsum (1), and w from the left (-1) to the right side (1). Its outline is drawn for a
mean man; for another person it is warped so that it fits landmarks of the jaw and the dental arches.
The frame is that of the generated face, in metres.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from emgface.errors import TongueError
from emgface.face.parts import Arch
from emgface.face.template.arches import inner_wall

Floats = NDArray[np.float64]
Index = NDArray[np.int64]
Curve = tuple[tuple[float, float, float], ...]

TONGUE_RESOLUTIONS: Final = {"coarse": (10, 5, 8), "medium": (14, 7, 10), "fine": (20, 10, 14)}
"""Numbers of elements from front to back, from floor to dorsum, and from side to side."""
LEAST_ELEMENTS, MOST_ELEMENTS = 120, 60_000
"""Bounds of an approximate number of elements."""

# fmt: off
DORSUM: Final = ((0, 83.6, -4.4), (0, 78, 4.6), (0, 70, 11.4), (0, 61, 15.6), (0, 51, 16.4),
                 (0, 41, 12.0), (0, 31, 2.0), (0, 24.8, -10), (0, 22.8, -21), (0, 28.2, -29.6))
FLOOR_OUTLINE: Final = ((0, 75.2, -31.6), (0, 67, -35.2), (0, 58, -37.2), (0, 48, -37.8),
                        (0, 39.8, -35.6))
FRONT: Final = ((0, 75.2, -31.6), (0, 74.6, -25), (0, 72.8, -19.5), (0, 72.2, -15), (0, 74.2, -11),
                (0, 79.4, -7.6), (0, 83.6, -4.4))
BACK_OUTLINE: Final = ((0, 39.8, -35.6), (0, 36.6, -31.0), (0, 28.2, -29.6))
EDGE_OUTLINE: Final = ((8, 82.0, -5.2), (15, 74.5, -1.5), (20.5, 65, 1.5), (23, 56, 3.5),
                       (26.5, 47, 3.5), (26.5, 38, -2.5), (24, 29.5, -12), (19.5, 26, -19),
                       (14, 27.0, -27.3))
LINE_OUTLINE: Final = ((7.4, 73.2, -27), (14, 65.5, -25.5), (19.4, 58, -24), (22.5, 50, -23.5),
                       (22.5, 43.5, -25.5), (18.5, 38.5, -29.5), (11.5, 36.6, -33.2))
FRONT_EDGE: Final = ((7.4, 73.2, -27), (7.5, 72.0, -19.5), (7.6, 71.7, -14.5), (8, 74.0, -10.5),
                     (8, 82.0, -5.2))
BACK_EDGE: Final = ((11.5, 36.6, -33.2), (13, 31.8, -30.4), (14, 27.0, -27.3))
# fmt: on
"""Curves of the outline of a mean man [mm]: in the midline, and on the right side that of the edge of
the tongue, the one along which mylohyoid and greater horn hold the floor, and their ends. They are
drawn in the generated jaw of `emgface.anatomy.jaw.template` after midsagittal and coronal sections of
anatomy atlases (Standring, Gray's Anatomy, chapter Oral cavity)."""
_BOTTOM, _TOP = 1.8, 3.0
"""Exponents of the heights across the tongue, at floor and dorsum."""


@dataclass(frozen=True, eq=False)
class TongueMesh:
    """Mesh of a tongue: ``position`` (n, 3) [m] and ``connectivity`` (m, 8) in VTK order.

    ``shape`` (3,) holds the numbers of elements along u, v, w.
    """

    position: Floats
    connectivity: Index
    shape: tuple[int, int, int]

    @property
    def node(self) -> Index:
        """Node numbers (nu + 1, nv + 1, nw + 1)."""
        nu, nv, nw = self.shape
        return np.arange((nu + 1) * (nv + 1) * (nw + 1)).reshape(nu + 1, nv + 1, nw + 1)

    @property
    def places(self) -> Floats:
        """Coordinates u, v, w (m, 3) of the centres of the elements."""
        nu, nv, nw = self.shape
        grids = [(np.arange(n) + 0.5) / n for n in self.shape]
        u, v, w = np.meshgrid(*grids, indexing="ij")
        return np.stack([u, v, 2.0 * w - 1.0], axis=-1).reshape(-1, 3)

    @property
    def directions(self) -> Floats:
        """Unit vectors (m, 3, 3) along u, v and w at the centres of the elements."""
        corners = self.position[self.connectivity]
        along = [
            corners[:, head].mean(axis=1) - corners[:, tail].mean(axis=1)
            for tail, head in (
                ((0, 3, 4, 7), (1, 2, 5, 6)),
                ((0, 1, 4, 5), (3, 2, 7, 6)),
                ((4, 5, 6, 7), (0, 1, 2, 3)),
            )
        ]
        axes = np.stack(along, axis=1)
        return axes / np.linalg.norm(axes, axis=2, keepdims=True)


def divisions(resolution: str | int) -> tuple[int, int, int]:
    """Numbers of elements along u, v and w of a name or an approximate number of elements.

    Raises
    ------
    TongueError
        The name is unknown or the number out of range.
    """
    if isinstance(resolution, str):
        if resolution not in TONGUE_RESOLUTIONS:
            raise TongueError(
                f"resolution is {resolution!r}, expected {', '.join(TONGUE_RESOLUTIONS)} or a number"
            )
        return TONGUE_RESOLUTIONS[resolution]
    if not LEAST_ELEMENTS <= resolution <= MOST_ELEMENTS:
        raise TongueError(f"{resolution} elements, expected {LEAST_ELEMENTS} to {MOST_ELEMENTS}")
    step = (resolution / 980.0) ** (1.0 / 3.0)
    return round(14 * step), max(round(7 * step), 4), 2 * max(round(5 * step), 2)


def tongue_mesh(
    places: Mapping[str, Floats], arches: tuple[Arch, Arch], resolution: str | int = "medium"
) -> TongueMesh:
    """Mesh of the tongue of a person, exactly symmetric.

    `places` are those of `emgface.anatomy.jaw.template.landmarks.landmarks`, `arches` those of
    `emgface.face.template.dental_arches`; `resolution` is a name of `TONGUE_RESOLUTIONS` or an
    approximate number of elements.
    """
    nu, nv, nw = shape = divisions(resolution)
    u, v, w = np.linspace(0, 1, nu + 1), np.linspace(0, 1, nv + 1), np.linspace(-1, 1, nw + 1)
    middle = _patch(FLOOR_OUTLINE, DORSUM, FRONT, BACK_OUTLINE, u, v)
    side = _patch(LINE_OUTLINE, EDGE_OUTLINE, FRONT_EDGE, BACK_EDGE, u, v)
    power = np.stack(
        [np.ones(nv + 1), 2.0 * np.ones(nv + 1), _BOTTOM + (_TOP - _BOTTOM) * v], axis=1
    )
    lateral = np.abs(w)[:, None] ** power[:, None]
    drawn = middle[:, :, None] + lateral * (side - middle)[:, :, None]
    drawn[..., 0] = side[:, :, None, 0] * w
    position = fitted_shape(drawn.reshape(-1, 3), places, arches)
    node = np.arange(len(position)).reshape(nu + 1, nv + 1, nw + 1)
    a, b = node[:-1, :, :], node[1:, :, :]  # along u
    corners = [
        x[:, y][:, :, z]
        for z in (slice(1, None), slice(None, -1))
        for x, y in (
            (a, slice(None, -1)),
            (b, slice(None, -1)),
            (b, slice(1, None)),
            (a, slice(1, None)),
        )
    ]
    return TongueMesh(position, np.stack(corners, axis=-1).reshape(-1, 8), shape)


@dataclass(frozen=True)
class Frame:
    """Lengths that fit an outline to a person [m].

    ``y`` (3,) of the hyoid, the back of the chin and the lower incisors behind their edge; ``low``
    (2,) heights z of the hyoid and of the back of the chin; ``width`` half the distance between the
    last teeth, or between the bodies of the mandible.
    """

    y: tuple[float, float, float]
    low: tuple[float, float]
    width: float

    @staticmethod
    def from_places(places: Mapping[str, Floats], arches: tuple[Arch, Arch]) -> "Frame":
        """Lengths of a person."""
        walls = [inner_wall(arch) for arch in arches]
        hyoid, chin = places["hyoid"], places["chin_back"]
        front = min(float(wall[len(wall) // 2, -2:, 1].min()) for wall in walls)
        width = min(float(np.abs(wall[-1, :, 0]).min()) for wall in walls)
        width = min(width, float(places["molar"][0]) - 0.9e-3)  # next to the mandible
        return Frame((hyoid[1], chin[1], front), (hyoid[2], chin[2]), width)


DRAWN_FRAME: Final = Frame((35.4e-3, 77.0e-3, 86.5e-3), (-38.4e-3, -35.5e-3), 23.6e-3)
"""Lengths of the man for whom the outline is drawn."""
HYOID_HEIGHT: Final = 10e-3
"""Height above the centre of the hyoid in which the outline follows its surface [m]."""


def fitted_shape(points: Floats, places: Mapping[str, Floats], arches: tuple[Arch, Arch]) -> Floats:
    """Points of the outline (n, 3) for a person [m].

    x is scaled by the width between the teeth and y is mapped piecewise linearly through `Frame.y`.
    Heights between the lips and `HYOID_HEIGHT` above the line of hyoid and chin are stretched; the
    thickness of the bones is that of all persons. Greater heights are scaled as x.
    """
    own = Frame.from_places(places, arches)
    x, y, z = points.T
    scale = own.width / DRAWN_FRAME.width
    near, far = 6e-3, 1e-1
    new = np.interp(
        y,
        [
            DRAWN_FRAME.y[0] - far,
            DRAWN_FRAME.y[0],
            DRAWN_FRAME.y[0] + near,
            *DRAWN_FRAME.y[1:],
            DRAWN_FRAME.y[2] + far,
        ],
        [own.y[0] - scale * far, own.y[0], own.y[0] + near, *own.y[1:], own.y[2] + scale * far],
    )
    low, drawn = (
        np.interp(new, own.y[:2], own.low),
        np.interp(y, DRAWN_FRAME.y[:2], DRAWN_FRAME.low),
    )
    up = z - drawn  # above the floor
    rise = np.where(
        up < HYOID_HEIGHT,
        up,
        HYOID_HEIGHT + (up - HYOID_HEIGHT) * (-low - HYOID_HEIGHT) / (-drawn - HYOID_HEIGHT),
    )
    return np.column_stack([scale * x, new, np.where(z < 0.0, low + rise, scale * z)])


def _patch(low: Curve, high: Curve, front: Curve, back: Curve, u: Floats, v: Floats) -> Floats:
    """Coons patch (u, v, 3) of four curves [m]."""
    bottom, top, start, end = _along(low, u), _along(high, u), _along(front, v), _along(back, v)
    s, t = u[:, None, None], v[None, :, None]
    ruled = (1 - t) * bottom[:, None] + t * top[:, None] + (1 - s) * start + s * end
    corners = (1 - s) * ((1 - t) * bottom[0] + t * top[0]) + s * (
        (1 - t) * bottom[-1] + t * top[-1]
    )
    return ruled - corners


def _along(curve: Curve, at: Floats) -> Floats:
    """Points at equal fractions of the length of a smooth curve [m]."""
    points = 1e-3 * np.array(curve, dtype=np.float64)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return PchipInterpolator(way / way[-1], points)(at)
