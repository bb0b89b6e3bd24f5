"""The ten muscles of a side: fibres by their courses, the two rings by ring, layer and gaps.

Rings of orbicularis oris as closed loops: Stavness et al., Coupled biomechanical modeling of the face.
"""

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.bundles import fibre_directions
from emgface.face.parts import CENTRE, INNER, OUTER, Bundle, Fibre
from emgface.face.quality import element_centres
from emgface.face.shares import shares_within
from emgface.face.template.courses import Course, courses
from emgface.face.template.grid import Grid
from emgface.face.template.measures import Measures
from emgface.face.template.outline import PERIORAL, VERMILION
from emgface.face.template.surface import Surfaces
from emgface.muscles import MODELLED

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

#: distance from a fibre within which tissue is muscle [m] (Eskes et al. 2017)
MUSCLE_RADIUS: Final = 5e-3
LEAST_SHARE: Final = 0.01  #: fraction of an element below which it does not belong to a muscle [1]


@dataclass(frozen=True)
class Ring:
    """Part of orbicularis oris: all elements of some layers between two rings around the mouth."""

    inner: float  #: edge towards the margin of the lips, as a ring s of the outline
    outer: float  #: edge towards the cheeks
    layers: tuple[int, ...]  #: layers of elements that it fills
    depth: float  #: depth of its fibre, from 0 at the inner surface to 1 at the skin
    gaps: float = 0.0
    """Half-width of a gap at each corner of the mouth, as a fraction of the way from the corner to
    the midline; 0 is a closed ring."""

    @property
    def description(self) -> str:
        """Edges, layers and gaps in words."""
        layers = " and ".join(name for name, (k, _) in _DEPTHS.items() if k in self.layers)
        return f"{layers}, s {self.inner:.3g} to {self.outer:.3g}, gaps {self.gaps:g}"


_PERIPHERAL: Final = VERMILION + (PERIORAL - VERMILION) / 3.0
RING_MUSCLES: Final[Mapping[str, Ring]] = {
    "OOM": Ring(0.0, VERMILION, (CENTRE,), 0.65),
    "OOP": Ring(_PERIPHERAL, PERIORAL, (INNER, CENTRE), 0.4),
}
"""The parts of orbicularis oris.

The peripheral part begins at one third of the distance from the vermilion border to the edge of the
perioral region. Lip protrusion increases with its distance from the lips (Stavness et al., section Lip
morphology affects protrusion and rounding); with a part at the border, the lips retract. The
marginal part is superficial, beneath the vermilion (Standring, as commonly quoted). A
superficial ring closes the lips and a deep one opens and protrudes them (Stavness et al., the same
section): in both layers the marginal part would close the mouth by a tenth of a millimetre.
"""
_REGIONS: Final = {
    "marginal": (0.0, VERMILION),
    "intermediate": (VERMILION, _PERIPHERAL),
    "peripheral": (_PERIPHERAL, PERIORAL),
}
_DEPTHS: Final = {"deep": (INNER, 0.2), "middle": (CENTRE, 0.6), "superficial": (OUTER, 0.95)}


def parse_ring(words: str) -> Ring:
    """Ring from words, such as "peripheral deep middle gaps=0.2".

    Regions are "marginal", "intermediate" and "peripheral", layers "deep", "middle" and
    "superficial" (that of the skin, as in Stavness et al., Fig. 11.11); adjacent regions may be
    joined. Raises FaceError for other words, regions that are apart, or without a region or layer.
    """
    regions, layers, gaps = list[tuple[float, float]](), list[tuple[int, float]](), 0.0
    for word in words.split():
        name, _, value = word.partition("=")
        if word in _REGIONS:
            regions.append(_REGIONS[word])
        elif word in _DEPTHS:
            layers.append(_DEPTHS[word])
        elif name == "gaps" and re.fullmatch(r"0?\.\d+|0", value):
            gaps = float(value)
        else:
            raise FaceError(
                f"ring {words!r} contains {word!r}, expected words of "
                f"{', '.join([*_REGIONS, *_DEPTHS])} or gaps=0.2"
            )
    regions.sort()
    touching = all(a[1] == b[0] for a, b in itertools.pairwise(regions))
    if not regions or not layers or not touching:
        raise FaceError(
            f"ring {words!r}, expected adjacent regions and at least one layer: 'peripheral deep middle'"
        )
    depth = float(np.mean([depth for _, depth in layers]))
    return Ring(regions[0][0], regions[-1][1], tuple(k for k, _ in layers), depth, gaps)


_MIRROR: Final = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Muscles:
    """Fibres and elements of both sides of a symmetric face.

    `shifted` is the largest shift of the ends of each muscle along the skin [m].
    """

    fibres: list[Fibre]
    bundles: list[Bundle]
    shifted: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class CourseShift:
    """Deviations of one person's muscle courses from those of the template.

    `origin` and `insertion` are the shift (xi, tau) of the ends of each muscle in the chart [m],
    with linear interpolation between them. For orbicularis oris, the tau of the insertion shifts
    the inner edge of the peripheral part; the marginal part remains within the vermilion.
    """

    origin: Mapping[str, tuple[float, float]]
    insertion: Mapping[str, tuple[float, float]]


def draw_course_shift(rng: np.random.Generator, deviation: float) -> CourseShift:
    """Draw normal shifts for every muscle, truncated at two standard deviations [m]."""
    drawn = deviation * np.clip(rng.standard_normal((len(MODELLED), 2, 2)), -2.0, 2.0)
    ends = [
        {
            muscle: (float(one[k, 0]), float(one[k, 1]))
            for muscle, one in zip(MODELLED, drawn, strict=True)
        }
        for k in (0, 1)
    ]
    return CourseShift(ends[0], ends[1])


def place_muscles(
    surfaces: Surfaces,
    grid: Grid,
    position: Floats,
    *,
    radius: float = MUSCLE_RADIUS,
    shift: CourseShift | None = None,
    rings: Mapping[str, Ring] | None = None,
) -> Muscles:
    """Fibres and muscle elements of a symmetric face.

    A muscle fills a fraction of each element: that within `radius` [m] of its fibres, or all of it
    in the rings. The skin layer belongs to no muscle but a superficial ring. The direction of
    elements of the rings is along the ring; `rings` replace some of `RING_MUSCLES`. A `shift` of a
    course that would move a point out of the tissue is halved until it does not, or omitted. Raises
    FaceError, with muscle and point, if a point of a muscle is outside the tissue, or if a ring is
    unknown or contains no element.
    """
    centres = element_centres(position, grid.connectivity)
    ray, ring = grid.element_place
    half = ray < grid.rays // 2
    soft = np.flatnonzero((grid.layer != OUTER) & half)
    for muscle in rings or {}:
        if muscle not in RING_MUSCLES:
            raise FaceError(f"ring {muscle!r}, expected one of {', '.join(RING_MUSCLES)}")
    chosen = {**RING_MUSCLES, **(rings or {})}
    along = _ring_directions(grid, position)
    placed = _placed(surfaces, courses(surfaces.measures, surfaces.mouth_half_width), shift)
    fibres: list[Fibre] = []
    bundles: list[Bundle] = []
    shifted: dict[str, float] = {}
    for muscle in MODELLED:
        if muscle in chosen:
            part = chosen[muscle]
            if shift is not None and muscle == "OOP":
                inner = _inner_edge(surfaces.measures, part, shift.insertion[muscle][1])
                part = replace(part, inner=inner)
            element = np.flatnonzero(half & _within(grid, part))
            if not len(element):
                raise FaceError(
                    f"{muscle}: the ring from s = {part.inner:g} to {part.outer:g} contains no element, "
                    "expected a finer mesh or a wider ring"
                )
            direction = along[element]
            share = np.ones(len(element))
            left = _ring_fibres(surfaces, grid, part)
        else:
            left, shifted[muscle] = placed[muscle]
            share = shares_within(position, grid.connectivity[soft], left, radius)
            element, share = soft[share > LEAST_SHARE], share[share > LEAST_SHARE]
            direction = fibre_directions(centres[element], left)
        fibres += [Fibre(f"{muscle}_L", points) for points in left]
        image = grid.mirror_element[element]
        bundles.append(Bundle(f"{muscle}_L", element, direction, share))
        bundles.append(Bundle(f"{muscle}_R", image, direction * _MIRROR, share))
    fibres += [Fibre(f"{f.muscle[:-1]}R", f.position * _MIRROR) for f in fibres]
    return Muscles(fibres, bundles, shifted)


_HALVINGS: Final = 4


def _placed(
    surfaces: Surfaces, rays: dict[str, tuple[Course, ...]], shift: CourseShift | None
) -> dict[str, tuple[list[Floats], float]]:
    """Fibres of every muscle, and the largest shift of its ends.

    All points are computed together, which takes a tenth of the time, if all are in the tissue.
    """
    ends = {muscle: _ends(muscle, shift) for muscle in rays}
    moved = [_moved(row, ends[muscle]) for muscle, rows in rays.items() for row in rows]
    try:
        placed_rows = iter(_in_space(surfaces, moved))
    except FaceError:
        return {muscle: _in_tissue(surfaces, muscle, rays[muscle], ends[muscle]) for muscle in rays}
    return {
        muscle: (
            [next(placed_rows) for _ in rows],
            float(np.linalg.norm(ends[muscle], axis=1).max()),
        )
        for muscle, rows in rays.items()
    }


def _ends(muscle: str, shift: CourseShift | None) -> Floats:
    """Shift (2, 2) of origin and insertion of a muscle in the chart [m]."""
    if shift is None:
        return np.zeros((2, 2))
    return np.array([shift.origin[muscle], shift.insertion[muscle]])


def _in_tissue(
    surfaces: Surfaces, muscle: str, rows: tuple[Course, ...], ends: Floats
) -> tuple[list[Floats], float]:
    """Fibres of a muscle with its shift, reduced to remain in the tissue, and the largest shift."""
    for share in (*(0.5**halving for halving in range(_HALVINGS)), 0.0):
        try:
            left = [_in_space(surfaces, [_moved(row, share * ends)])[0] for row in rows]
        except FaceError as error:
            if share == 0.0:
                raise FaceError(f"{muscle}: {error}") from error
        else:
            return left, share * float(np.linalg.norm(ends, axis=1).max())
    raise AssertionError("unreachable: the last attempt returns or raises")


def _moved(course: Course, ends: Floats) -> Course:
    """Course with its ends shifted by (2, 2) in the chart."""
    points = np.array(course)
    share = np.linspace(0.0, 1.0, len(points))[:, None]
    points[:, :2] += (1.0 - share) * ends[0] + share * ends[1]
    return tuple((float(xi), float(tau), float(depth)) for xi, tau, depth in points)


def _within(grid: Grid, part: Ring) -> NDArray[np.bool_]:
    """Elements of a part of orbicularis oris, of both sides."""
    ray, ring = grid.element_place
    middle = 0.5 * (grid.s[1:] + grid.s[:-1])[ring]
    quarter = grid.rays // 4
    away = np.abs((ray + 0.5) % (2 * quarter) - quarter) / quarter  # from the nearest corner
    inside = (middle > part.inner) & (middle < part.outer) & (away > part.gaps)
    return inside & np.isin(grid.layer, part.layers)


def _inner_edge(m: Measures, part: Ring, shift: float) -> float:
    """Ring at which the peripheral part of orbicularis oris begins, shifted outwards by `shift` [m]."""
    length = m.upper_lip_height - m.upper_vermilion_height
    moved = part.inner + shift / length * (PERIORAL - VERMILION)
    # At least half of the part remains, and it does not extend into the vermilion.
    return float(np.clip(moved, VERMILION, part.inner + 0.5 * (part.outer - part.inner)))


def _in_space(surfaces: Surfaces, rows: Sequence[Course]) -> list[Floats]:
    """Points of courses [m]; FaceError if one is outside the tissue."""
    points = np.concatenate([np.array(row) for row in rows])
    placed = surfaces.points(points[:, :2], points[:, 2])
    return np.split(placed, np.cumsum([len(row) for row in rows])[:-1])


def _ring_fibres(surfaces: Surfaces, grid: Grid, part: Ring) -> list[Floats]:
    """Fibres of the left half of a ring: one, or one of each lip if it has gaps."""
    q, lip = grid.left_rays
    skin, inner = surfaces.sheets(q, lip, np.array([0.5 * (part.inner + part.outer)]))
    points = (inner + part.depth * (skin - inner))[:, 0] * _MIRROR
    points[[0, -1], 0] = 0.0
    if not part.gaps:
        return [points]
    kept = q <= 1.0 - part.gaps
    return [points[kept & upper] for upper in (lip > 0.0, lip < 0.0)]


def _ring_directions(grid: Grid, position: Floats) -> Floats:
    """Unit vectors along the rings at the centres of the elements."""
    corners = position[grid.connectivity]
    vector = corners[:, [1, 2, 5, 6]].mean(axis=1) - corners[:, [0, 3, 4, 7]].mean(axis=1)
    return vector / np.linalg.norm(vector, axis=1, keepdims=True)
