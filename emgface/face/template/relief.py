"""Relief of lips, nose, cheeks and chin on the smooth head, and thickness of the tissue.

Positions are (..., 2) in the chart (xi, tau), lengths in metres; `corner` is the half width of the
mouth along the skin.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from emgface.face.template.measures import Measures
from emgface.face.template.outline import MARGIN, PERIORAL, VERMILION, lateral_share

Floats = NDArray[np.float64]

LIP_PROFILE: Final = PchipInterpolator(
    [
        MARGIN,
        0.75 * VERMILION,
        VERMILION,
        VERMILION + 0.4 * (PERIORAL - VERMILION),
        PERIORAL,
        1.0,
    ],
    [1.0, 1.0, 0.88, 0.45, 0.0, 0.0],
)
"""Relief of the lips relative to their protrusion, by ring, without the roll at the margin."""
LIP_ROLL: Final = PchipInterpolator(
    [MARGIN, 0.35 * VERMILION, 0.75 * VERMILION, 1.0], [1.0, 0.29, 0.0, 0.0]
)
"""Roll of the vermilion relative to that at the margin, by ring."""
LIP_DEPTH: Final = PchipInterpolator([MARGIN, VERMILION, PERIORAL, 1.0], [1.0, 0.95, 0.0, 0.0])
"""Fraction of the protrusion due to the teeth, by ring; the rest of the relief is tissue."""

NOSE_DEPTH: Final = 0.75  #: fraction of the relief of the nose due to bone and cartilage
_RIDGE: Final = PchipInterpolator(
    [-0.2, 0.0, 0.12, 0.22, 0.30, 0.45, 0.70, 0.95, 1.2, 1.5],
    [0.0, 0.05, 0.60, 0.95, 1.0, 0.82, 0.45, 0.15, 0.08, 0.08],
)
"""Forward relief of columella, tip and dorsum over the protrusion, by height from subnasale."""
_RIDGE_WIDTH: Final = PchipInterpolator(
    [-0.2, 0.0, 0.14, 0.28, 0.45, 0.7, 1.0, 1.5], [0.42, 0.40, 0.46, 0.60, 0.52, 0.46, 0.5, 0.62]
)
"""Half width of the same over that of the nose."""

MOUTH_BACK: Final = 2.0e-3  #: distance of the head without relief behind subnasale at the mouth [m]
FOLD: Final = 1.8e-3  #: depth of the nasolabial fold [m]
PHILTRUM: Final = 0.7e-3  #: height of the crests of the philtrum [m]
CHIN_PAD: Final = 3.5e-3  #: relief of the chin [m]


def sulcus_back(m: Measures) -> float:
    """Depth of the mentolabial sulcus behind subnasale, larger over a receding chin [m]."""
    return 4.8e-3 - 0.4 * m.chin_protrusion


def lip_protrusion(m: Measures, q: Floats, lip: Floats) -> Floats:
    """Protrusion of the lip along a ray [m]."""
    share = lateral_share(q)
    protrusion = np.where(
        lip > 0,
        m.upper_lip_protrusion + MOUTH_BACK,
        m.lower_lip_protrusion + 0.5 * (MOUTH_BACK + sulcus_back(m)),
    )
    return protrusion * (1.0 - share**2) ** 0.8


def lip_roll(m: Measures, q: Floats, lip: Floats) -> Floats:
    """Distance of the margin behind the crest of the lip [m], at most its height."""
    height = np.where(lip > 0, m.upper_vermilion_height, m.lower_vermilion_height)
    height = (height - 0.5 * m.lip_gap) * (1.0 - lateral_share(q) ** 2)
    return np.minimum(0.7 * lip_protrusion(m, q, lip), 0.6 * height)


def relief(m: Measures, place: Floats, corner: float) -> Floats:
    """Cheek, cheekbone, chin and fold next to the mouth along the normal [m]."""
    xi, tau = place[..., 0], place[..., 1]
    cheekbone = (
        m.cheekbone_prominence
        * _bump((xi - 0.40 * m.face_width) / 0.030)
        * _bump((tau - m.upper_lip_height - 0.30 * m.nose_height) / 0.020)
    )
    cheek = (
        m.cheek_fullness * _bump((xi - 0.36 * m.face_width) / 0.024) * _bump((tau - 0.010) / 0.026)
    )
    chin = CHIN_PAD * _bump(xi / 0.017) * _bump((tau + 0.74 * m.chin_height) / 0.011)
    return cheekbone + cheek + chin + _fold(m, xi, tau, corner)


def _fold(m: Measures, xi: Floats, tau: Floats, corner: float) -> Floats:
    """Nasolabial fold, from the wing of the nose to the side of the mouth corner [m]."""
    up = np.clip(tau / (m.upper_lip_height + 0.12 * m.nose_height), -0.5, 1.4)
    line = corner + 0.011 - (corner + 0.011 - 0.62 * m.nose_width) * np.clip(up, 0.0, 1.0) ** 1.5
    off = (xi - line) / np.where(xi > line, 0.009, 0.006)
    return -FOLD * _bump(off) * _bump((up - 0.35) / 0.62)


def philtrum(m: Measures, place: Floats) -> Floats:
    """Crests of the philtrum and the groove between them, on the skin only [m]."""
    aside = np.abs(place[..., 0]) / (0.5 * m.philtrum_width)
    along = place[..., 1] / m.upper_lip_height
    between = _bump((along - 0.66) / 0.24) * (place[..., 1] > 0.0)
    return PHILTRUM * (_bump((aside - 1.0) / 0.5) - 0.9 * _bump(aside / 0.6)) * between


def nose(m: Measures, place: Floats) -> Floats:
    """Displacement (..., 3) of the nose [m]: columella, tip, dorsum, wings and nostrils."""
    height = np.clip((place[..., 1] - m.upper_lip_height) / m.nose_height, -0.2, 1.5)
    aside = np.abs(place[..., 0]) / (0.5 * m.nose_width)
    across = np.exp(-((aside / _RIDGE_WIDTH(height)) ** 2.6))
    # The wing is steep towards the cheek, at its crease.
    span = np.where(aside > 0.76, 0.26, 0.42)
    wing = _bump((aside - 0.76) / span) * _bump(
        (height - 0.17) / np.where(height > 0.17, 0.15, 0.11)
    )
    nostril = _bump((aside - 0.44) / 0.20) * _bump((height - 0.085) / 0.055)
    forward = _RIDGE(height) * across + 0.50 * wing - 0.14 * nostril
    down = 0.20 * across * _bump((height - 0.26) / 0.15) + 0.08 * wing
    zero = np.zeros_like(aside)
    return m.nose_protrusion * np.stack([zero, forward, -down], axis=-1)


def nose_lift(m: Measures, place: Floats) -> Floats:
    """Height of the inner surface above the underside of the nose [m]."""
    height = (place[..., 1] - m.upper_lip_height) / m.nose_height
    aside = np.abs(place[..., 0]) / (0.5 * m.nose_width)
    return 0.4 * m.nose_thickness * _bump((height - 0.13) / 0.10) * np.exp(-((aside / 0.95) ** 4))


def thickness(m: Measures, place: Floats, corner: float, low: float) -> Floats:
    """Thickness of the tissue [m], interpolated between the measured landmarks."""
    top, wide = m.upper_lip_height, m.face_width
    sites = (
        # xi, tau, thickness
        (0.0, 0.3 * top, m.upper_lip_thickness),
        (0.0, -0.4 * m.lower_lip_height, m.lower_lip_thickness),
        (corner, 0.0, m.cheek_thickness),
        (0.0, top, m.philtrum_thickness),
        (0.0, -m.lower_lip_height, m.chin_thickness),
        (0.0, -0.75 * m.chin_height, m.chin_thickness),
        (0.0, low, m.jaw_thickness),
        (0.40 * wide, low, m.jaw_thickness),
        (0.75 * wide, 0.6 * low, m.jaw_thickness),
        (0.38 * wide, 0.005, m.cheek_thickness),
        (0.60 * wide, 0.0, m.cheek_thickness),
        (0.25 * wide, top + 0.5 * m.nose_height, m.cheekbone_thickness),
        (0.50 * wide, top + 0.5 * m.nose_height, m.cheekbone_thickness),
        (0.75 * wide, top + 0.5 * m.nose_height, m.cheekbone_thickness),
        (0.0, top + 0.45 * m.nose_height, m.nose_thickness),
        (0.0, top + m.nose_height, m.nose_thickness),
    )
    weight = np.stack(
        [
            (0.3 + ((place[..., 0] - x) / 0.022) ** 2 + ((place[..., 1] - t) / 0.014) ** 2) ** -2.0
            for x, t, _ in sites
        ]
    )
    value = np.array([site[2] for site in sites])
    return np.tensordot(value, weight, axes=1) / weight.sum(axis=0)


def _bump(distance: Floats) -> Floats:
    return np.exp(-(distance**2))
