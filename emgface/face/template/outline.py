"""Chart of the lower face, with the closed curves of the grid.

The chart is a flat map of the skin: xi is measured laterally along the skin from the midline (left
is positive; the right side is its mirror image), tau along the midline profile, with tau = 0 at the
mouth and up positive; both [m]. Rays start at the mouth slit, rings surround it. The coordinates of
a point are its ray, q from 0 (midline) to 1 (mouth corner) of the upper (lip = 1) or lower lip (lip
= -1), and its ring, s from 0 (margin of the lip) to 1 (rim of the face).

The rings are interpolated between five curves, each a function of the ray: margin of the lips,
vermilion border, border of the perioral region (subnasale, nasolabial fold, mentolabial sulcus),
middle of the face (side of the nose, cheek, chin) and rim (nasion, below the orbit, ear, angle of
the jaw, submental skin).
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from emgface.face.template.measures import Measures

Floats = NDArray[np.float64]

MARGIN, VERMILION, PERIORAL, MIDDLE, RIM = 0.0, 0.18, 0.47, 0.76, 1.0  #: rings s of the five curves
RING_CURVES: Final = (MARGIN, VERMILION, PERIORAL, MIDDLE, RIM)

_EVEN_SHARE: Final = 0.2
"""Weight of an even spacing of rays, which avoids very small cells at the corners."""
_CORNER_RIM: Final = 3.5e-3  #: distance of the vermilion border from the mouth corner [m]
_OPEN: Final = 2.4e-3  #: opening of the lips below which the ends of the slit become blunter [m]
_PERIORAL_WIDTH: Final = 0.55
"""Half width of the perioral region beyond the corner, over the half width of the mouth."""
_BOW_WIDTH: Final = 3.2e-3  #: width of the peaks of the Cupid's bow [m]


def lateral_share(q: Floats) -> Floats:
    """Lateral position of a ray on the margin of the lips, relative to the half width of the mouth."""
    return (1.0 - _EVEN_SHARE) * np.sin(0.5 * np.pi * q) + _EVEN_SHARE * q


def chart(measures: Measures, half_width: float, q: Floats, lip: Floats, s: Floats) -> Floats:
    """Position (rays, rings, 2) of every ray and ring in the chart: xi and tau [m].

    `half_width` is that of the mouth along the skin [m]; `lip` is 1 for upper and -1 for lower.
    """
    knots = np.stack(_curves(measures, half_width, q, lip))
    return np.moveaxis(PchipInterpolator(RING_CURVES, knots, axis=0)(s), 0, 1)


def _curves(m: Measures, half_width: float, q: Floats, lip: Floats) -> list[Floats]:
    share = lateral_share(q)
    height = np.sqrt(np.clip(1.0 - share**2, 0.0, None))
    angle = 0.5 * np.pi * q
    upper = lip > 0

    # Blunt ends keep the angle between the lips at the corner above zero, which is required
    # particularly for closed lips.
    blunt = 4.0 * np.clip(_OPEN / m.lip_gap, 1.0, 3.0)
    slit = 0.5 * m.lip_gap * np.sqrt(np.clip(1.0 - share**blunt, 0.0, None))
    margin = _curve(half_width * share, lip * slit)

    vermilion = np.where(upper, m.upper_vermilion_height, m.lower_vermilion_height)
    rise = (vermilion - 0.5 * m.lip_gap) * height**1.2
    peak = (share * half_width - 0.5 * m.philtrum_width) / _BOW_WIDTH
    dip = np.exp(-((0.5 * m.philtrum_width / _BOW_WIDTH) ** 2))
    bow = m.cupid_bow * (np.exp(-(peak**2)) - dip) * height
    border = _curve(
        (half_width + _CORNER_RIM) * share, lip * (slit + rise + np.where(upper, bow, 0.0))
    )

    perioral = _oval(
        half_width * (1.0 + _PERIORAL_WIDTH),
        np.where(upper, m.upper_lip_height, m.lower_lip_height),
        np.where(upper, angle - 0.25 * np.sin(2.0 * angle), angle),
        lip,
        power=2.0,
    )
    middle = _oval(
        half_width + 0.29 * m.face_width,
        np.where(upper, m.upper_lip_height + 0.38 * m.nose_height, 0.92 * m.chin_height),
        np.where(upper, 0.5 * np.pi * (0.45 * q + 0.55 * q**3), angle),
        lip,
        power=2.2,
    )
    rim = _oval(
        0.84 * m.face_width,
        np.where(upper, m.upper_lip_height + m.nose_height, m.chin_height + 0.2 * m.face_depth),
        np.where(upper, angle - 0.27 * np.sin(2.0 * angle), angle),
        lip,
        power=2.5,
    )
    # Below the eye the rim is lowered to the orbit.
    across = (rim[:, 0] / m.face_width - 0.29) / 0.17
    orbit = np.exp(-(across**2)) - np.exp(-((0.29 / 0.17) ** 2))
    rim[:, 1] -= np.where(upper, 0.27 * m.nose_height * orbit, 0.0)
    return [margin, border, perioral, middle, rim]


def _curve(xi: Floats, tau: Floats) -> Floats:
    return np.stack([xi, tau], axis=-1)


def _oval(width: float, height: Floats, angle: Floats, lip: Floats, *, power: float) -> Floats:
    """Superellipse whose points lie in the directions of those of an ellipse."""
    x, z = np.sin(angle), np.cos(angle)
    scale = (x**power + np.abs(z) ** power) ** (-1.0 / power)
    return _curve(width * x * scale, lip * height * z * scale)
