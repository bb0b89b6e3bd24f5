"""A generated face: a block of lip tissue with a mouth, ten muscle pairs and the study's markers.

It needs nothing imported and stands for no person. Three layers of cells form a slab bent round a
dental arch; a slit in the middle separates the lips, which meet at the mouth corners. Everything on
the right is the mirror image of the left.

Places are written in block coordinates: u from -1 (left rim) to 1 (right rim), d from 0 (teeth) to
1 (skin), w from -1 (lower rim) to 1 (upper rim); the slit lies at w = 0, and the side of a point on
it tells the lips apart.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import KDTree

from emgface.errors import FaceError
from emgface.face.bundles import elements_within, fibre_directions
from emgface.face.model import FREE, MANDIBLE, SKULL, Bundle, Fibre, build_face
from emgface.face.quality import element_centres
from emgface.muscles import MODELLED

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

LAYERS: Final = 3
MOUTH: Final = 0.6
"""Half width of the mouth over half width of the block, before rounding to a column of nodes."""
FREE_SHARE: Final = (0.85, 0.65)
"""Half axes (u, w) of the ellipse in which the inner sheet is free of the bone."""
RADIUS_PER_CELL: Final = 0.875
"""Default muscle radius over the longest cell edge."""

_MIRROR: Final = np.array([-1.0, 1.0, 1.0])
_RING_POINTS: Final = 7

_RINGS: Final[Mapping[str, tuple[float, float, float]]] = {
    # Half axis beyond the mouth corner in u, half axis in w, depth d.
    "OOM": (0.08, 0.16, 0.60),
    "OOP": (0.20, 0.40, 0.35),
}
_RAYS: Final[Mapping[str, tuple[tuple[tuple[float, float, float], ...], ...]]] = {
    # Fibres of the left side from origin to insertion in (u, d, w). The mouth corner is at -0.6.
    "ZYG": (((-0.95, 0.50, 0.85), (-0.80, 0.55, 0.45), (-0.64, 0.50, 0.06)),),
    "RIS": (((-0.98, 0.65, 0.10), (-0.64, 0.60, 0.00)),),
    "LLSAN": (
        ((-0.30, 0.70, 0.95), (-0.30, 0.75, 0.60), (-0.32, 0.75, 0.30)),
        ((-0.24, 0.70, 0.95), (-0.16, 0.75, 0.50)),
    ),
    "LAO": (((-0.50, 0.20, 0.95), (-0.55, 0.25, 0.50), (-0.62, 0.35, 0.10)),),
    "BUC": (
        ((-0.98, 0.15, 0.28), (-0.64, 0.25, 0.08)),
        ((-0.98, 0.15, -0.28), (-0.64, 0.25, -0.08)),
    ),
    "DLI": (((-0.40, 0.35, -0.95), (-0.30, 0.45, -0.60), (-0.20, 0.50, -0.28)),),
    "DAO": (((-0.80, 0.60, -0.95), (-0.74, 0.65, -0.50), (-0.64, 0.60, -0.06)),),
    "MEN": (((-0.10, 0.10, -0.50), (-0.10, 0.50, -0.70), (-0.10, 0.90, -0.82)),),
}

_LEFT_MARKERS: Final = {
    # (u, w) on the skin.
    "corner": (-0.70, 0.0),
    "upper_lateral": (-0.40, 0.25),
    "upper_paramedian": (-0.13, 0.25),
    "lower_lateral": (-0.40, -0.25),
    "lower_paramedian": (-0.13, -0.25),
}
_FACE_MARKERS: Final = np.array(
    # Forehead and temple left and right on the upper rim; the block has no nose, so nasion and
    # rhinion are the deep and the skin end of the rim in the midline.
    [(-0.5, 1, 1), (0.5, 1, 1), (-1, 1, 0.5), (1, 1, 0.5), (0, 0, 1), (0, 1, 1)],
    dtype=np.float64,
)


@dataclass(frozen=True)
class _Shape:
    """Maps block coordinates to metres."""

    size: tuple[float, float, float]
    opening: float
    arch: float
    mouth: float
    scale: tuple[float, float, float]

    def __call__(self, place: Floats, lip: Floats | None = None) -> Floats:
        """Positions (n, 3) [m] of places (u, d, w); `lip` is +1 or -1 where w = 0 is a lip."""
        u, d, w = np.asarray(place, dtype=np.float64).T
        side = np.sign(w) if lip is None else np.where(w == 0.0, lip, np.sign(w))
        part = np.clip(1.0 - (u / self.mouth) ** 2, 0.0, None)
        width, depth, height = self.size
        x = u * width / 2.0
        y = d * depth - self.arch * u**2
        z = w * height / 2.0 + side * self.opening / 2.0 * part * (1.0 - np.abs(w))
        return np.column_stack([x, y, z]) * np.asarray(self.scale)

    def ring_directions(self, place: Floats, ring: tuple[float, float, float]) -> Floats:
        """Unit tangents (n, 3) of the ellipses of a ring's proportions through places (u, d, w).

        At the tight turn of the mouth corner, interpolating between upper and lower segments
        would flip one of them; the tangent is known, so it is used.
        """
        u, w = place[:, 0], place[:, 2]
        du, dw = w / ring[1] ** 2, -u / (self.mouth + ring[0]) ** 2
        width, _, height = self.size
        # The bow of the lips is left out: it tilts these by a few degrees at most.
        tangent = np.column_stack([du * width / 2.0, -2.0 * self.arch * u * du, dw * height / 2.0])
        tangent *= self.scale
        return tangent / np.linalg.norm(tangent, axis=1, keepdims=True)


@dataclass(frozen=True)
class _Grid:
    """Nodes and elements in block coordinates."""

    place: Floats
    lip: Floats
    connectivity: Integers
    layer: Integers


def block_face(
    *,
    size: tuple[float, float, float] = (60e-3, 12e-3, 50e-3),
    cells: tuple[int, int] = (20, 16),
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0),
    opening: float = 3e-3,
    arch: float = 8e-3,
    radius: float | None = None,
    name: str = "block of lip tissue",
) -> xr.Dataset:
    """Generate a face_model of a block of lip tissue.

    Parameters
    ----------
    size : tuple of float
        Width (x), depth (y) and height (z) of the block [m].
    cells : tuple of int
        Cells across the width and along the height, both even; there are always three through
        the depth.
    scale : tuple of float
        Factors on x, y and z, for faces of other volunteers. They keep which elements a muscle
        owns.
    opening : float
        Distance of the lips in the midline at rest, before scaling [m].
    arch : float
        How far the side rims lie behind the middle, before scaling [m].
    radius : float, optional
        Elements whose centre lies nearer than this to a muscle's fibres belong to it, before
        scaling [m]. By default 0.875 of the longest cell edge.
    name : str
        Name of the face.

    Returns
    -------
    xarray.Dataset
        Of schema face_model, origin "generated".

    Raises
    ------
    FaceError
        A length or factor is not positive, a number of cells is odd or too small, or the face
        fails `emgface.face.model.check_face` (a muscle without elements, an inverted element).

    Notes
    -----
    The cells at the four outer corners are split into wedges. The inner sheet is fixed outside
    an ellipse round the mouth, and so is the whole rim: to the skull above the mouth, to the
    mandible below. Muscle courses follow anatomy in direction only; the two rings have the
    directions of ellipses round the mouth, the other muscles those of their fibres by
    `emgface.face.bundles.fibre_directions`.

    Examples
    --------
    >>> face = block_face()
    >>> face.attrs["origin"], face.sizes["element"]
    ('generated', 972)
    """
    _check(size=size, scale=scale)
    if min(cells) < 6 or any(count % 2 for count in cells):
        raise FaceError(f"the block has {cells} cells, expected even numbers of at least 6")
    if opening < 0 or arch < 0:
        raise FaceError(
            f"opening is {opening} m and arch {arch} m, expected lengths that are not negative"
        )
    if radius is None:
        edges = (size[0] / cells[0], size[1] / LAYERS, size[2] / cells[1])
        radius = RADIUS_PER_CELL * max(edges)

    half = cells[0] // 2
    mouth = round(MOUTH * half) / half
    grid = _grid(cells, mouth)
    rest = _Shape(size, opening, arch, mouth, (1.0, 1.0, 1.0))
    shape = _Shape(size, opening, arch, mouth, scale)
    position = shape(grid.place, grid.lip)

    courses = _left_courses(mouth)
    unscaled = element_centres(rest(grid.place, grid.lip), grid.connectivity)
    centres = element_centres(position, grid.connectivity)
    mirror = np.asarray(KDTree(unscaled).query(unscaled * _MIRROR)[1], dtype=np.int64)
    fibres: list[Fibre] = []
    bundles: list[Bundle] = []
    for muscle in MODELLED:
        left = [shape(course) for course in courses[muscle]]
        fibres += [Fibre(f"{muscle}_L", points) for points in left]
        element = elements_within(unscaled, [rest(course) for course in courses[muscle]], radius)
        element = element[unscaled[element, 0] < 0]
        if muscle in _RINGS:
            middle = element_centres(grid.place, grid.connectivity[element])
            direction = shape.ring_directions(middle, _RINGS[muscle])
        else:
            direction = fibre_directions(centres[element], left)
        bundles.append(Bundle(f"{muscle}_L", element, direction))
        bundles.append(Bundle(f"{muscle}_R", mirror[element], direction * _MIRROR))
    fibres += [Fibre(f"{f.muscle[:-1]}R", f.position * _MIRROR) for f in fibres]

    return build_face(
        position=position,
        connectivity=grid.connectivity,
        layer=grid.layer,
        fixed=_fixed(grid),
        fibres=fibres,
        bundles=bundles,
        marker_node=_markers(grid),
        face_marker_position=shape(_FACE_MARKERS),
        lip_opening_node=_margin_middle(grid),
        name=name,
        origin="generated",
        source="emgface.face.block",
        attrs={
            "muscle_radius": radius,
            "block_width": size[0],
            "block_depth": size[1],
            "block_height": size[2],
            "block_cells": f"{cells[0]} x {LAYERS} x {cells[1]}",
            "block_opening": opening,
            "block_arch": arch,
            "scale_width": scale[0],
            "scale_depth": scale[1],
            "scale_height": scale[2],
        },
    )


def _check(**lengths: tuple[float, float, float]) -> None:
    for what, values in lengths.items():
        if len(values) != 3 or not all(np.isfinite(v) and v > 0 for v in values):
            raise FaceError(f"{what} of the block is {values}, expected three positive numbers")


def _grid(cells: tuple[int, int], mouth: float) -> _Grid:
    nx, nz = cells
    # Integers over their half are exactly antisymmetric, so the mesh mirrors bit by bit.
    u = (np.arange(nx + 1) - nx // 2) / (nx // 2)
    d = np.arange(LAYERS + 1) / LAYERS
    w = (np.arange(nz + 1) - nz // 2) / (nz // 2)
    place = np.stack(np.meshgrid(u, d, w, indexing="ij"), axis=-1)
    index = np.arange(place[..., 0].size).reshape(place.shape[:3])
    below = index.copy()
    inside = np.flatnonzero(np.abs(u) < mouth - 1e-9)
    doubled = index[inside][:, :, nz // 2]
    below[inside, :, nz // 2] = index.size + np.arange(doubled.size).reshape(doubled.shape)
    flat = place.reshape(-1, 3)
    places = np.concatenate([flat, flat[doubled.ravel()]])
    lip = np.zeros(len(places))
    lip[doubled.ravel()], lip[index.size :] = 1.0, -1.0

    rows, layers = [], []
    for i in range(nx):
        for j in range(LAYERS):
            for k in range(nz):
                table = below if k < nz // 2 else index
                # Counter-clockwise about +y: z before x.
                ends = [(i, k), (i, k + 1), (i + 1, k + 1), (i + 1, k)]
                quads = [[int(table[a, j + step, b]) for a, b in ends] for step in (0, 1)]
                for row in _split(quads[0], quads[1], i in (0, nx - 1), k in (0, nz - 1), i, k):
                    rows.append(row)
                    layers.append(j)
    return _Grid(places, lip, np.array(rows), np.array(layers))


def _split(
    base: list[int], top: list[int], side: bool, end: bool, i: int, k: int
) -> list[list[int]]:
    """One hexahedron, or at an outer corner two wedges that share the diagonal through it."""
    if not (side and end):
        return [base + top]
    corner = ((0, 1), (3, 2))[i > 0][k > 0]
    order = [(corner + step) % 4 for step in range(4)]
    triples = ((order[0], order[1], order[2]), (order[0], order[2], order[3]))
    return [[*(base[n] for n in t), *(top[n] for n in t), -1, -1] for t in triples]


def _left_courses(mouth: float) -> dict[str, list[Floats]]:
    """Fibres of the left side in block coordinates; a ring is an upper and a lower quarter."""
    courses = {muscle: [np.array(fibre) for fibre in rays] for muscle, rays in _RAYS.items()}
    angle = np.linspace(0.5 * np.pi, np.pi, _RING_POINTS)
    for muscle, (beyond, height, depth) in _RINGS.items():
        upper = np.column_stack(
            [
                (mouth + beyond) * np.cos(angle),
                np.full(_RING_POINTS, depth),
                height * np.sin(angle),
            ]
        )
        # Exact zeros put the ends on the midline and at the height of the slit.
        upper[0, 0], upper[-1, 2] = 0.0, 0.0
        courses[muscle] = [upper, upper[::-1] * [1.0, 1.0, -1.0]]
    return courses


def _fixed(grid: _Grid) -> NDArray[np.int8]:
    u, d, w = grid.place.T
    rim = (np.abs(u) == 1.0) | (np.abs(w) == 1.0)
    on_bone = (d == 0.0) & ((u / FREE_SHARE[0]) ** 2 + (w / FREE_SHARE[1]) ** 2 >= 1.0)
    bone = np.where(w >= 0.0, SKULL, MANDIBLE)
    return np.where(rim | on_bone, bone, FREE).astype(np.int8)


def _nearest_skin(grid: _Grid, u: float, w: float) -> int:
    away = np.hypot(grid.place[:, 0] - u, grid.place[:, 2] - w)
    away[grid.place[:, 1] != 1.0] = np.inf
    return int(np.argmin(away))


def _markers(grid: _Grid) -> Integers:
    """Nodes in the order of `LIP_MARKERS`; right ones mirror left ones."""
    left = {name: _nearest_skin(grid, *place) for name, place in _LEFT_MARKERS.items()}
    right = {
        name: _nearest_skin(grid, -grid.place[node, 0], grid.place[node, 2])
        for name, node in left.items()
    }
    return np.array(
        [
            left["corner"],
            left["upper_lateral"],
            left["upper_paramedian"],
            right["upper_paramedian"],
            right["upper_lateral"],
            right["corner"],
            left["lower_lateral"],
            left["lower_paramedian"],
            right["lower_paramedian"],
            right["lower_lateral"],
        ]
    )


def _margin_middle(grid: _Grid) -> Integers:
    u, d, w = grid.place.T
    middle = (u == 0.0) & (d == 1.0) & (w == 0.0)
    return np.array([int(np.flatnonzero(middle & (grid.lip == lip))[0]) for lip in (1.0, -1.0)])
