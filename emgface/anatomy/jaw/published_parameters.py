"""Parameters of the published jaw, hyoid and larynx model that its data files do not hold.

Source: the program of the published model (Stavness, Hannam, Lloyd and Fels 2006; Hannam et al. 2008),
in its frame and units: mm, kg and s, x left, y posterior, z superior.
"""

from typing import NamedTuple


class MuscleValues(NamedTuple):
    """Largest force [N], largest over optimal length [1], share of the optimal length that is tendon."""

    force_max: float
    stretch_max: float
    tendon_ratio: float


_STRAP = 1.2849002849
"""Largest over optimal length of the muscles below the mandible."""

PUBLISHED_MUSCLES = {
    "at": MuscleValues(158.0, 1.269790839290414, 0.50),
    "mt": MuscleValues(95.6, 1.418629387630693, 0.48),
    "pt": MuscleValues(75.6, 1.310854623265226, 0.51),
    "sm": MuscleValues(190.4, 1.299650213758813, 0.46),
    "dm": MuscleValues(81.6, 1.542827657380250, 0.29),
    "mp": MuscleValues(174.8, 1.249814860529103, 0.64),
    "sp": MuscleValues(66.9 * 0.3 / 0.7, 1.361010830325115, 0.0),
    "ip": MuscleValues(66.9, 1.317460317457228, 0.0),
    "ad": MuscleValues(40.0, _STRAP, 0.0),
    "pd": MuscleValues(40.0, _STRAP, 0.0),
    "am": MuscleValues(35.4, _STRAP, 0.0),
    "pm": MuscleValues(35.4, _STRAP, 0.0),
    "gh": MuscleValues(32.0, _STRAP, 0.0),
    "sh": MuscleValues(15.6, _STRAP, 0.0),
    "th": MuscleValues(20.0, _STRAP, 0.5),
    "pct": MuscleValues(20.0, _STRAP, 0.5),
    "act": MuscleValues(20.0, _STRAP, 0.5),
    "stet": MuscleValues(20.0, _STRAP, 0.5),
    "steh": MuscleValues(50.0, _STRAP, 0.5),
    "oh": MuscleValues(50.0, _STRAP, 0.5),
}

PASSIVE_FRACTION = 0.015


class BodyValues(NamedTuple):
    """Mass [kg], centre [mm] and inertia xx yy zz xy xz yz about it [kg mm^2], surface."""

    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]
    surface: str


_LARYNGEAL = (2.1537, 1.6109, 7.432, 0.0, 0.0, 1.9663)

BODIES = {
    "jaw": BodyValues(
        0.2, (0.0, -9.53, 36.08), (182.2, 92.19, 125.2, 1.122, 1.345, 10.7), "jaw_smooth.obj"
    ),
    "hyoid": BodyValues(0.01, (0.0, 6.03, 4.48), _LARYNGEAL, "hyoid_t.obj"),
    "thyroid": BodyValues(0.047, (0.0, 14.92, -14.24), _LARYNGEAL, "thyroid_t.obj"),
    "cricoid": BodyValues(0.047, (0.0, 20.92, -23.24), _LARYNGEAL, "cricoid_t.obj"),
}
"""Moving bodies; the publication states 24 g and 23 g for thyroid and cricoid."""

LARYNX_MASS = {"thyroid": 0.024, "cricoid": 0.023}
"""Masses stated in Stavness et al. 2006, section 2.2 [kg]."""

BITE_POINT = (24.8, -20.4, 47.0)
CONDYLE_DROP = 4.0
INCISOR_FORWARD = 1.0
CONDYLE_SLOPE, BITE_SLOPE, WALL_TURN = 40.0, 10.0, 1.0
"""Inclination of the joint and of the bite plane, turn of the lateral walls [degrees]."""

CURVE_LENGTH, CURVE_DEPTH, CURVE_END_SLOPE = 12.0, 5.0, 10.0
"""Condylar path: horizontal length and depth [mm], slope of its end [degrees]."""
CURVE_STRIPS = 20
"""Number of plane strips of the path, which is straight beyond the middle of the last one."""

HINGE = (0.0, 23.0, -24.0)
MEMBRANES = {"thMem": ("hyoid", "thyroid", 0.0), "ctrMem": ("cricoid", "sternum", 10.0)}
"""Landmarks, bodies, and how far the lower points are raised [mm]."""
MEMBRANE_STIFFNESS, SPRING_DAMPING = 385.6, 1e-3
PHARYNX = ((16.88, 8.16, 5.29), (17.92, 32.71, 18.46), 200.0, 26.0)
"""Points on hyoid and pharynx, stiffness [N/m] and rest length [mm] of the constrictor springs."""
