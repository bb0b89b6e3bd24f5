"""The ten muscles of a side: fibres by their courses, the two rings by ring and layer.

Rings of orbicularis oris as closed loops: Stavness et al., Coupled biomechanical modeling of the face.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
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

RADIUS: Final = 5e-3  #: distance from a fibre within which tissue is muscle [m] (Eskes et al. 2017)
LEAST_SHARE: Final = 0.01  #: fraction of an element below which it does not belong to a muscle [1]
RINGS: Final[Mapping[str, tuple[float, float]]] = {
    "OOM": (0.0, VERMILION),
    "OOP": (VERMILION + (PERIORAL - VERMILION) / 3.0, PERIORAL),
}
"""Rings s of the parts of orbicularis oris, in the layers of `RING_LAYERS`.

The peripheral part begins at one third of the distance from the vermilion border to the edge of the
perioral region. Lip protrusion increases with its distance from the lips (Stavness et al., section Lip
morphology affects protrusion and rounding); with a part at the border, the lips retract.
"""
RING_LAYERS: Final[Mapping[str, tuple[int, ...]]] = {"OOM": (CENTRE,), "OOP": (INNER, CENTRE)}
"""Layers filled by the parts of orbicularis oris.

The marginal part is superficial, beneath the vermilion (Standring, as commonly quoted). A
superficial ring closes the lips and a deep one opens and protrudes them (Stavness et al., the same
section): in both layers the marginal part would close the mouth by a tenth of a millimetre.
"""
_RING_DEPTH: Final = {"OOM": 0.65, "OOP": 0.4}
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
    radius: float = RADIUS,
    shift: CourseShift | None = None,
) -> Muscles:
    """Fibres and muscle elements of a symmetric face.

    A muscle fills a fraction of each element: that within `radius` [m] of its fibres, or all of it
    in the rings. The skin layer belongs to no muscle. The direction of elements of the rings is
    along the ring. A `shift` of a course that would move a point out of the tissue is halved until
    it does not, or omitted. Raises FaceError, with muscle and point, if a point of a muscle is
    outside the tissue.
    """
    centres = element_centres(position, grid.connectivity)
    ray, ring = grid.element_place
    soft = np.flatnonzero((grid.layer != OUTER) & (ray < grid.rays // 2))
    along = _ring_directions(grid, position)
    placed = _placed(surfaces, courses(surfaces.measures, surfaces.mouth_half_width), shift)
    fibres: list[Fibre] = []
    bundles: list[Bundle] = []
    shifted: dict[str, float] = {}
    for muscle in MODELLED:
        if muscle in RINGS:
            low, high = RINGS[muscle]
            if shift is not None and muscle == "OOP":
                low = _inner_edge(surfaces.measures, shift.insertion[muscle][1])
            middle = 0.5 * (grid.s[1:] + grid.s[:-1])[ring[soft]]
            layer = np.isin(grid.layer[soft], RING_LAYERS[muscle])
            element = soft[(middle > low) & (middle < high) & layer]
            direction = along[element]
            share = np.ones(len(element))
            left = [_ring_fibre(surfaces, grid, 0.5 * (low + high), _RING_DEPTH[muscle])]
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
        found = iter(_in_space(surfaces, moved))
    except FaceError:
        return {muscle: _in_tissue(surfaces, muscle, rays[muscle], ends[muscle]) for muscle in rays}
    return {
        muscle: ([next(found) for _ in rows], float(np.linalg.norm(ends[muscle], axis=1).max()))
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


def _inner_edge(m: Measures, shift: float) -> float:
    """Ring at which the peripheral part of orbicularis oris begins, shifted outwards by `shift` [m]."""
    low, high = RINGS["OOP"]
    length = m.upper_lip_height - m.upper_vermilion_height
    moved = low + shift / length * (PERIORAL - VERMILION)
    # At least half of the part remains, and it does not extend into the vermilion.
    return float(np.clip(moved, VERMILION, low + 0.5 * (high - low)))


def _in_space(surfaces: Surfaces, rows: Sequence[Course]) -> list[Floats]:
    """Points of courses [m]; FaceError if one is outside the tissue."""
    points = np.concatenate([np.array(row) for row in rows])
    found = surfaces.points(points[:, :2], points[:, 2])
    return np.split(found, np.cumsum([len(row) for row in rows])[:-1])


def _ring_fibre(surfaces: Surfaces, grid: Grid, s: float, depth: float) -> Floats:
    q, lip = grid.left_rays
    skin, inner = surfaces.sheets(q, lip, np.array([s]))
    points = (inner + depth * (skin - inner))[:, 0] * _MIRROR
    points[[0, -1], 0] = 0.0
    return points


def _ring_directions(grid: Grid, position: Floats) -> Floats:
    """Unit vectors along the rings at the centres of the elements."""
    corners = position[grid.connectivity]
    vector = corners[:, [1, 2, 5, 6]].mean(axis=1) - corners[:, [0, 3, 4, 7]].mean(axis=1)
    return vector / np.linalg.norm(vector, axis=1, keepdims=True)
