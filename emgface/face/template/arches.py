"""Dental arches of the template: rigid bodies behind lips and cheeks, for contact.

Each arch is a closed wall from the incisal edges to the fornix of the vestibule. The lips and the
corners of the mouth are supported by it: thicknesses of the lips are measured to the incisors and
to the bone (Arnett et al. 1999; Stephan and Simpson 2008), and teeth are in equilibrium between the
pressures of tongue, lips and cheeks (Proffit 1978, Angle Orthod 48:175-186). Posterior to the
corner of the mouth the arch separates from the cheek, whose fat pad the template lacks, and has the
width and depth of published casts.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator

from emgface.errors import FaceError
from emgface.face.parts import MANDIBLE, SKULL, Arch
from emgface.face.template.calibrate import calibrated_surfaces
from emgface.face.template.measures import Measures
from emgface.face.template.outline import MARGIN, MIDDLE
from emgface.face.template.surface import Surfaces

Floats = NDArray[np.float64]

CLEARANCE: Final = 0.5e-3  #: distance of the teeth from the resting lips [m]


@dataclass(frozen=True)
class ArchForm:
    """Half width and depth of an arch at the first molars, relative to the half width of the jaw.

    The values are assumptions within the range of published casts and scale with the jaw of the
    person.
    """

    half_width: float
    depth: float


FORMS: Final = {SKULL: ArchForm(0.57, 0.58), MANDIBLE: ArchForm(0.55, 0.52)}
"""For a mean jaw, about 57 and 55 mm between the outer faces of the first molars, depth 29 and 26 mm."""
_BEYOND: Final = {SKULL: (2e-3, 5e-3), MANDIBLE: (1e-3, 3.5e-3)}
"""Distance over which an arch follows the cheek beyond the corner, and its least half width [m]."""
EXPOSURE: Final = 4.3e-3
"""Visible length of the upper incisors below the relaxed upper lip [m]: mean of 3.9 (men) and 4.7 mm
(women), as commonly quoted from Arnett et al. 1999."""
OVERBITE: Final = 3.2e-3
"""Vertical overlap of the incisors [m], as commonly quoted from Arnett et al. 1999."""
OVERJET: Final = 3.2e-3  #: horizontal overlap of the incisors [m], from the same source
_EDGE: Final = 3e-3  #: thickness of the incisal edge [m]; chosen
_ROOT: Final = 5e-3  #: thickness at the fornix [m]; chosen
_BEHIND: Final = 4e-3
"""Height over which the lower incisors recede to the overjet behind the upper ones [m]; chosen."""
_NEAR: Final = 1e-3
"""Lateral and vertical distance within which the lining nearest to the teeth is used [m]; chosen."""
_COLUMNS, _ROWS = 17, 6
"""Numbers for one half: chords of 3 mm deviate from the curve by 0.04 mm, and the cost of contact grows
with the number of vertices."""


def dental_arches(measures: Measures, *, clearance: float = CLEARANCE) -> tuple[Arch, Arch]:
    """Generate the arches of the maxilla and of the mandible.

    `clearance` is their distance behind the inner surface of the resting tissue, along y [m].
    Triangles are counter-clockwise seen from the lips. The arches are exactly symmetric in x = 0,
    also for asymmetric measures. Raises FaceError if the clearance is negative, or as
    `emgface.face.template.calibrate.calibrated_surfaces`.
    """
    return arches_behind(calibrated_surfaces(measures), measures, clearance=clearance)


def inner_wall(arch: Arch) -> Floats:
    """Points (columns, rows, 3) of the side of an arch towards the tongue [m].

    Columns run from the left to the right end, rows from the fornix to the incisal edge.
    """
    return arch.points.reshape(-1, 2 * _ROWS, 3)[:, :_ROWS]


def arches_behind(
    surfaces: Surfaces, measures: Measures, *, clearance: float = CLEARANCE
) -> tuple[Arch, Arch]:
    """Same as `dental_arches`, for calibrated surfaces."""
    if not clearance >= 0.0:
        raise FaceError(f"the clearance of the teeth is {clearance} m, expected a length >= 0")
    lining = _lining(surfaces)
    margin = 0.5 * measures.lip_gap
    edge = margin - EXPOSURE
    walls: list[Floats] = []
    # A little beyond the edge of the attachment of the tissue to the bone.
    for bone, tip, root in (
        (SKULL, edge, 0.85 * measures.upper_lip_height),
        (MANDIBLE, edge + OVERBITE, -0.9 * measures.lower_lip_height),
    ):
        x, drop = _plan(bone, measures, lining)
        height = np.linspace(tip, root, _ROWS)
        # Next to the slit the margins of the lips curve backwards within one or two millimetres.
        around = [
            lining(*np.meshgrid(np.abs(x + aside), height + above, indexing="ij"))
            for aside in (-_NEAR, 0.0, _NEAR)
            for above in (-_NEAR, 0.0, _NEAR)
        ]
        front = np.fmin.reduce(around) - clearance
        for row in range(2, _ROWS):  # at the chin the root is below the free part of the lining
            onward = 2.0 * front[:, row - 1] - front[:, row - 2]
            front[:, row] = np.where(np.isnan(front[:, row]), onward, front[:, row])
        if bone == MANDIBLE:
            # Above the upper incisal edge the lower incisors are behind the upper ones.
            before = walls[0][:, 0, 0]
            upper = np.interp(x, before[:, 0], before[:, 1])[:, None]
            share = np.clip(1.0 + (height - edge) / _BEHIND, 0.0, 1.0)
            front = np.where(share > 0.0, np.minimum(front, upper - share * OVERJET), front)
        walls.append(_wall(x, front - drop[:, None], height))
    return _arch(SKULL, walls[0]), _arch(MANDIBLE, walls[1])


def _lining(surfaces: Surfaces) -> LinearNDInterpolator:
    """Position y of the inner surface of lips and cheeks over x (to the left) and z, for x >= 0."""
    q = np.linspace(0.0, 1.0, 41)
    s = np.linspace(MARGIN, MIDDLE, 41)
    sheets = [surfaces.sheets(q, np.full(41, lip), s)[1].reshape(-1, 3) for lip in (1.0, -1.0)]
    points = np.concatenate(sheets)
    # A strip beyond the midline includes the midline in the hull.
    points = np.concatenate([points, points[points[:, 0] < 5e-3] * [-1.0, 1.0, 1.0]])
    points = np.unique(points.round(9), axis=0)
    return LinearNDInterpolator(points[:, [0, 2]], points[:, 1])


def _plan(bone: int, measures: Measures, lining: LinearNDInterpolator) -> tuple[Floats, Floats]:
    """Positions x of the columns and their distance behind the lining [m].

    A quarter of an ellipse connects the lining next to the corner and the last molars.
    """
    form, corner, half_jaw = FORMS[bone], 0.5 * measures.mouth_width, 0.5 * measures.jaw_width
    follows, least = (corner + beyond for beyond in _BEYOND[bone])
    width = max(form.half_width * half_jaw, least)
    angle = np.linspace(0.0, 0.5 * np.pi, 200)
    x = np.concatenate(
        [np.linspace(0.0, follows, 200), follows + (width - follows) * np.sin(angle)]
    )
    y = lining(x, np.zeros_like(x))
    leaving = np.concatenate([np.zeros(200), 1.0 - np.cos(angle)])
    drop = leaving * max(float(y[-1] - y[0]) + form.depth * half_jaw, 0.0)
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y - drop)))])
    column = np.linspace(0.0, arc[-1], _COLUMNS)
    return np.interp(column, arc, x), np.interp(column, arc, drop)


def _wall(x: Floats, front: Floats, height: Floats) -> Floats:
    """Left half (columns, rows, 2, 3) of a wall from the y of its front; rows start at the edge.

    Front and back are the two sides of the wall; the back of the edge is slightly inside it.
    """
    wall = np.empty((_COLUMNS, _ROWS, 2, 3))
    wall[..., 0] = x[:, None, None]
    wall[..., 1] = front[..., None]
    wall[..., 2] = height[:, None]
    wall[:, 0, 1, 2] += 0.3 * _EDGE * np.sign(height[-1])
    # The direction of the back changes uniformly from incisors to molars, which avoids folds.
    angle = np.linspace(0.0, 0.5 * np.pi, _COLUMNS)
    slope = np.stack([-np.sin(angle), -np.cos(angle)], axis=1)
    inward = np.linspace(_EDGE, _ROOT, _ROWS)[:, None] * slope[:, None]
    inward[..., 0] = np.maximum(inward[..., 0], -0.9 * x[:, None])
    wall[:, :, 1, :2] += inward
    return wall


def _arch(bone: int, left: Floats) -> Arch:
    """Both halves of a wall, with x to the right, as triangles of a closed body."""
    left[0, ..., 0] = 0.0
    both = np.concatenate([left[:0:-1], left * [-1.0, 1.0, 1.0]])
    # Around the section: along the back from the root to the edge, then along the front.
    section = np.concatenate([both[:, ::-1, 1], both[:, :, 0]], axis=1)
    index = np.arange(section[..., 0].size).reshape(section.shape[:2])
    after = np.roll(index, -1, axis=1)
    quads = [np.stack([index[:-1], index[1:], after[1:], after[:-1]], axis=-1).reshape(-1, 4)]
    for end, column in enumerate((index[0], index[-1])):
        back, front = column[:_ROWS][::-1], column[_ROWS:]
        cap = np.stack([back[:-1], front[:-1], front[1:], back[1:]], axis=1)
        quads.append(cap[:, ::-1] if end else cap)
    # Columns are ordered from right to left, rows from the edge: upwards on the maxilla.
    quad = np.concatenate(quads)
    if bone == MANDIBLE:
        quad = quad[:, ::-1]
    # Mirrored diagonals prevent lateral sliding of a symmetric face.
    points = section.reshape(-1, 3)
    right = points[quad, 0].mean(axis=1) > 0.0
    quad[right] = np.roll(quad[right], 1, axis=1)
    triangles = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    return Arch(bone, points, triangles)
