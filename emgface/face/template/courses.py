"""Courses of the muscles of a side, by landmarks.

A course is a row of points in the chart with their depth, from 0 on the inner surface to 1 on the
skin. Sources: Standring (ed.), Gray's Anatomy, chapter Face and scalp (origins, insertions,
layers); Stavness et al., Coupled biomechanical modeling of the face (the set of muscles). Depths and
the division into fibres are chosen.
"""

from typing import Final

from emgface.face.template.measures import Measures

Course = tuple[tuple[float, float, float], ...]
MODIOLUS: Final = 9e-3  #: distance of the modiolus from the mouth corner along the skin [m]


def courses(m: Measures, corner: float) -> dict[str, tuple[Course, ...]]:
    """Fibres of the left side from origin to insertion, rows of (xi [m], tau [m], depth [1]).

    `corner` is the half width of the mouth along the skin [m].
    """
    return _upper(m, corner) | _lower(m, corner)


def _upper(m: Measures, corner: float) -> dict[str, tuple[Course, ...]]:
    """Muscles of cheek and upper lip."""
    top, nose, wide = m.upper_lip_height, m.nose_height, m.face_width
    modiolus = corner + MODIOLUS
    wing = 0.5 * m.nose_width
    return {
        # Zygomatic bone, lateral.
        "ZYG": (
            (
                (0.47 * wide, top + 0.40 * nose, 0.10),
                (0.38 * wide, 0.55 * (top + 0.40 * nose), 0.35),
                (modiolus, 0.002, 0.45),
                (corner + 0.002, 0.0, 0.50),
            ),
        ),
        # Fascia over parotid gland and masseter, superficial.
        "RIS": (
            (
                (0.62 * wide, 0.006, 0.55),
                (0.42 * wide, 0.001, 0.60),
                (modiolus, -0.001, 0.55),
                (corner + 0.002, -0.001, 0.55),
            ),
        ),
        # Frontal process of the maxilla next to the nose; to the upper lip and the wing of the nose.
        "LLSAN": (
            (
                (0.75 * wing, top + 0.80 * nose, 0.20),
                (wing + 0.004, top + 0.40 * nose, 0.40),
                (wing + 0.004, top + 0.10 * nose, 0.50),
                (0.62 * corner, 0.5 * (top + m.upper_vermilion_height), 0.55),
                (0.55 * corner, m.upper_vermilion_height, 0.55),
            ),
            (
                (0.75 * wing, top + 0.80 * nose, 0.20),
                (wing + 0.001, top + 0.40 * nose, 0.40),
                (wing + 0.002, top + 0.12 * nose, 0.60),
            ),
        ),
        # Canine fossa below the infraorbital foramen.
        "LAO": (
            (
                (0.20 * wide, top + 0.26 * nose, 0.05),
                (0.23 * wide, 0.70 * top, 0.25),
                (modiolus - 0.002, 0.003, 0.40),
            ),
            (
                (0.26 * wide, top + 0.26 * nose, 0.05),
                (0.27 * wide, 0.70 * top, 0.25),
                (modiolus, 0.003, 0.40),
            ),
        ),
        # Alveolar processes opposite the molars and the raphe behind them, deepest in the cheek.
        "BUC": (
            ((0.56 * wide, 0.012, 0.10), (0.42 * wide, 0.008, 0.20), (corner, 0.004, 0.30)),
            ((0.56 * wide, -0.012, 0.10), (0.42 * wide, -0.008, 0.20), (corner, -0.004, 0.30)),
        ),
    }


def _lower(m: Measures, corner: float) -> dict[str, tuple[Course, ...]]:
    """Muscles of lower lip and chin."""
    chin, wide, lower = m.chin_height, m.face_width, m.lower_lip_height
    modiolus = corner + MODIOLUS
    return {
        # Oblique line of the mandible between symphysis and mental foramen.
        "DLI": (
            (
                (0.17 * wide, -0.80 * chin, 0.10),
                (0.13 * wide, -0.55 * chin, 0.40),
                (0.30 * corner, -m.lower_vermilion_height, 0.55),
            ),
            (
                (0.22 * wide, -0.76 * chin, 0.10),
                (0.18 * wide, -0.52 * chin, 0.40),
                (0.60 * corner, -m.lower_vermilion_height, 0.55),
            ),
        ),
        # Oblique line of the mandible lateral of and over the former; to the modiolus.
        "DAO": (
            (
                (0.23 * wide, -0.92 * chin, 0.15),
                (0.25 * wide, -0.50 * chin, 0.55),
                (modiolus - 0.002, -0.002, 0.55),
            ),
            (
                (0.32 * wide, -0.82 * chin, 0.15),
                (0.31 * wide, -0.45 * chin, 0.55),
                (modiolus, -0.002, 0.55),
            ),
        ),
        # Incisive fossa; to the skin of the chin.
        "MEN": (
            (
                (0.035 * wide, -0.95 * lower, 0.05),
                (0.04 * wide, -0.5 * (lower + 0.72 * chin), 0.45),
                (0.05 * wide, -0.72 * chin, 0.85),
            ),
            (
                (0.06 * wide, -0.95 * lower, 0.05),
                (0.075 * wide, -0.5 * (lower + 0.70 * chin), 0.45),
                (0.085 * wide, -0.70 * chin, 0.85),
            ),
        ),
    }
