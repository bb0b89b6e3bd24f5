"""Dental arches of the template: rigid surfaces behind lips and cheeks, for contact.

Each arch is the inner surface of the resting lip, from the midline to behind the mouth corner,
moved back by a clearance. At rest it touches nothing, and it has the curve that the lips show.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.template.calibrate import calibrated_surfaces
from emgface.face.template.measures import Measures
from emgface.face.template.outline import MARGIN, PERIORAL

Floats = NDArray[np.float64]

CLEARANCE: Final = 0.5e-3
"""Distance of the teeth from the resting lips [m]."""
_RAYS, _RINGS = 25, 13


@dataclass(frozen=True)
class Arch:
    """An open triangulated surface.

    Attributes
    ----------
    bone : str
        "maxilla" or "mandible".
    points : ndarray, shape (n, 3)
        x counts to the right [m].
    triangles : ndarray of int, shape (m, 3)
        Counter-clockwise seen from the lips.
    """

    bone: str
    points: Floats
    triangles: NDArray[np.int64]


def dental_arches(measures: Measures, *, clearance: float = CLEARANCE) -> tuple[Arch, Arch]:
    """Make the arches of the maxilla and of the mandible.

    Parameters
    ----------
    measures : Measures
    clearance : float
        Distance behind the inner surface of the resting tissue [m].

    Returns
    -------
    maxilla, mandible : Arch
        Mirrored in x = 0 bit by bit; asymmetry of the measures does not reach them.

    Raises
    ------
    FaceError
        The clearance is negative, or as `emgface.face.template.calibrate.calibrated_surfaces`.
    """
    if not clearance >= 0.0:
        raise FaceError(f"the clearance of the teeth is {clearance} m, expected a length >= 0")
    surfaces = calibrated_surfaces(measures)
    q, s = np.linspace(0.0, 1.0, _RAYS), np.linspace(MARGIN, PERIORAL, _RINGS)
    arches: list[Arch] = []
    for bone, lip in (("maxilla", 1.0), ("mandible", -1.0)):
        side = np.full(_RAYS, lip)
        _, inner = surfaces.sheets(q, side, s)
        left = inner - clearance * surfaces.normals(surfaces.places(q, side, s))
        left[0, :, 0] = 0.0
        right = left[:0:-1]
        points = np.concatenate([right, left * [-1.0, 1.0, 1.0]])
        index = np.arange(points[..., 0].size).reshape(points.shape[:2])
        a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
        # Rays run from right to left and rings away from the mouth: up on the maxilla.
        quads = (a, b, c, d) if lip > 0 else (a, d, c, b)
        first, second, third, fourth = (part.ravel() for part in quads)
        triangles = np.concatenate(
            [np.stack([first, second, third], 1), np.stack([first, third, fourth], 1)]
        )
        arches.append(Arch(bone, points.reshape(-1, 3), triangles))
    return arches[0], arches[1]
