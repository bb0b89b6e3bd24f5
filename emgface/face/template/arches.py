"""Dental arches of the template: rigid bodies behind lips and cheeks, for contact.

Each arch is a closed wall on a catenary, the form most often found (Aljayousi et al. 2021, BMC Oral
Health 21:105: 47 % of maxillae and 41 % of mandibles), from the incisal edges to the fornix of the
vestibule. In the midline it stands where the thickness of the lips puts the incisors; wherever it
would still enter resting tissue it is moved back, so that at rest it touches nothing.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator
from scipy.optimize import brentq

from emgface.errors import FaceError
from emgface.face.parts import MANDIBLE, SKULL, Arch
from emgface.face.template.calibrate import calibrated_surfaces
from emgface.face.template.measures import Measures
from emgface.face.template.outline import MARGIN, MIDDLE
from emgface.face.template.surface import Surfaces

Floats = NDArray[np.float64]

CLEARANCE: Final = 0.5e-3
"""Distance of the teeth from the resting lips [m]."""


@dataclass(frozen=True)
class ArchForm:
    """Size of an arch: half width and depth at the first molars, over the half width of the jaw.

    Assumptions within the range of published casts; they scale with the jaw of the person.
    """

    half_width: float
    depth: float


FORMS: Final = {SKULL: ArchForm(0.55, 0.58), MANDIBLE: ArchForm(0.53, 0.52)}
"""About 55 and 53 mm between the outer faces of the first molars, 29 and 26 mm deep, for a mean jaw."""
EXPOSURE: Final = 4.3e-3
"""Upper incisors below the margin of the relaxed upper lip [m]: mean of 3.9 (men) and 4.7 mm (women)
as commonly quoted from Arnett et al. 1999."""
OVERBITE: Final = 3.2e-3
"""Upper incisors over the lower [m], as commonly quoted from Arnett et al. 1999."""
OVERJET: Final = 3.2e-3
"""Horizontal overlap of the incisors [m], likewise."""
_EDGE: Final = 3e-3
"""Thickness of the incisal edge [m]; chosen."""
_ROOT: Final = 5e-3
"""Thickness at the fornix [m]; chosen."""
_RECLINE: Final = {SKULL: 0.25, MANDIBLE: 0.10}
"""Inclination of the wall over its height; chosen."""
_COLUMNS, _ROWS = 41, 9


def dental_arches(measures: Measures, *, clearance: float = CLEARANCE) -> tuple[Arch, Arch]:
    """Generate the arches of the maxilla and of the mandible.

    Parameters
    ----------
    measures : Measures
    clearance : float
        Distance behind the inner surface of the resting tissue, along y [m].

    Returns
    -------
    maxilla, mandible : Arch
        Triangles run counter-clockwise seen from the lips. Mirrored in x = 0 bit by bit;
        asymmetry of the measures does not reach them.

    Raises
    ------
    FaceError
        The clearance is negative, or as `emgface.face.template.calibrate.calibrated_surfaces`.
    """
    return arches_behind(calibrated_surfaces(measures), measures, clearance=clearance)


def arches_behind(
    surfaces: Surfaces, measures: Measures, *, clearance: float = CLEARANCE
) -> tuple[Arch, Arch]:
    """Same as `dental_arches`, for calibrated surfaces."""
    if not clearance >= 0.0:
        raise FaceError(f"the clearance of the teeth is {clearance} m, expected a length >= 0")
    lining = _lining(surfaces)
    margin = 0.5 * measures.lip_gap
    edge = margin - EXPOSURE
    # Where the bone begins to hold the tissue, and a little beyond.
    upper = _wall(SKULL, measures, edge, 0.85 * measures.upper_lip_height)
    lower = _wall(MANDIBLE, measures, edge + OVERBITE, -0.9 * measures.lower_lip_height)
    front = np.linspace(edge, margin + 8e-3, 20)
    incisor = float(lining(np.zeros(20), front).min()) - clearance
    upper[..., 1] += incisor
    lower[..., 1] += incisor - OVERJET
    walls = []
    for wall in (upper, lower):
        front = wall[:, :, 0]
        before = lining(front[..., 0], front[..., 2]) - clearance
        back = np.where(before < front[..., 1], front[..., 1] - before, 0.0)
        wall[..., 1] -= back[..., None]
        walls.append(wall)
    return _arch(SKULL, walls[0]), _arch(MANDIBLE, walls[1])


def _lining(surfaces: Surfaces) -> LinearNDInterpolator:
    """Position y of the inner surface of lips and cheeks over x (to the left) and z, for x >= 0."""
    q = np.linspace(0.0, 1.0, 41)
    s = np.linspace(MARGIN, MIDDLE, 41)
    sheets = [surfaces.sheets(q, np.full(41, lip), s)[1].reshape(-1, 3) for lip in (1.0, -1.0)]
    points = np.concatenate(sheets)
    # A strip beyond the midline, so that the midline lies within the hull.
    points = np.concatenate([points, points[points[:, 0] < 5e-3] * [-1.0, 1.0, 1.0]])
    points = np.unique(points.round(9), axis=0)
    return LinearNDInterpolator(points[:, [0, 2]], points[:, 1])


def _wall(bone: int, measures: Measures, edge: float, root: float) -> Floats:
    """Left half (columns, rows, 2, 3) of a wall whose front is at y = 0; rows run from the edge.

    Front and back are the two sides of the wall; the back of the edge lies a little within it.
    """
    form = FORMS[bone]
    width, depth = (0.5 * measures.jaw_width * share for share in (form.half_width, form.depth))
    a = brentq(lambda a: a * (np.cosh(width / a) - 1.0) - depth, 0.2 * width, 50.0 * width)
    assert isinstance(a, float)
    arc = np.linspace(0.0, a * np.sinh(width / a), _COLUMNS)
    x = a * np.arcsinh(arc / a)
    y = a * (1.0 - np.cosh(x / a))
    height = np.linspace(edge, root, _ROWS)
    wall = np.empty((_COLUMNS, _ROWS, 2, 3))
    wall[..., 0] = x[:, None, None]
    wall[..., 1] = (y[:, None] - _RECLINE[bone] * np.abs(height - edge))[..., None]
    wall[..., 2] = height[:, None]
    wall[:, 0, 1, 2] += 0.3 * _EDGE * np.sign(root)
    # Towards the middle of the arch, less than to the centre of its curvature.
    slope = np.stack([-np.sinh(x / a), -np.ones_like(x)], axis=1)
    slope /= np.linalg.norm(slope, axis=1, keepdims=True)
    thickness = np.linspace(_EDGE, min(_ROOT, 0.5 * a), _ROWS)
    inward = thickness[:, None] * slope[:, None]
    inward[..., 0] = np.maximum(inward[..., 0], -0.9 * x[:, None])
    wall[:, :, 1, :2] += inward
    return wall


def _arch(bone: int, left: Floats) -> Arch:
    """Both halves of a wall, with x to the right, as triangles of a closed body."""
    left[0, ..., 0] = 0.0
    both = np.concatenate([left[:0:-1], left * [-1.0, 1.0, 1.0]])
    # Round the section: down the back from the root to the edge and up the front.
    section = np.concatenate([both[:, ::-1, 1], both[:, :, 0]], axis=1)
    index = np.arange(section[..., 0].size).reshape(section.shape[:2])
    after = np.roll(index, -1, axis=1)
    quads = [np.stack([index[:-1], index[1:], after[1:], after[:-1]], axis=-1).reshape(-1, 4)]
    for end, column in enumerate((index[0], index[-1])):
        back, front = column[:_ROWS][::-1], column[_ROWS:]
        cap = np.stack([back[:-1], front[:-1], front[1:], back[1:]], axis=1)
        quads.append(cap[:, ::-1] if end else cap)
    # Columns run from right to left and rows away from the edge: up on the maxilla.
    quad = np.concatenate(quads)
    if bone == MANDIBLE:
        quad = quad[:, ::-1]
    # Mirrored quads are cut along mirrored diagonals: a symmetric face then does not slide sideways.
    points = section.reshape(-1, 3)
    right = points[quad, 0].mean(axis=1) > 0.0
    quad[right] = np.roll(quad[right], 1, axis=1)
    triangles = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    return Arch(bone, points, triangles)
