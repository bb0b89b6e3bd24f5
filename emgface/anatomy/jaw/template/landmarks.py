"""Landmarks of the generated jaw, from the measures of a face and of its jaw.

The frame is that of the generated face: x right, y anterior from the plane of the tragia, z superior
from between the lips, the Frankfort plane horizontal, in metres. Landmarks are those of the right side
and of the midline.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from emgface.anatomy.jaw.template.measures import BALKWILL, OCCLUSAL_CANT, JawMeasures
from emgface.errors import JawError
from emgface.face.parts import MANDIBLE, SKULL, Arch
from emgface.face.template.arches import FORMS
from emgface.face.template.measures import Measures

Floats = NDArray[np.float64]

CONDYLE = np.array([9e-3, 4e-3, 5e-3])
"""Half sizes of a condyle [m]; a condyle is about 20 mm wide and 8 to 10 mm deep (Standring, Gray's
Anatomy)."""
SIDE_GAP = 4e-3
"""Least distance of the lateral pole of a condyle from the skin [m]."""


def landmarks(face: Measures, jaw: JawMeasures, arches: tuple[Arch, Arch]) -> Mapping[str, Floats]:
    """Landmarks (3,) by name [m].

    ``condyle`` centre, ``incisor`` and ``upper_incisor`` edges, ``molar`` occlusal surface of the
    first molars, ``pogonion``, ``menton``, ``chin_back``, ``gonion`` of the bone, ``coronoid`` tip,
    ``arch`` and ``zygoma`` of the cheek, ``hyoid`` body, ``horn`` end of the greater horn,
    ``notch`` and ``thyroid_low`` of the thyroid cartilage in the midline, ``cricoid`` centre,
    ``joint`` of cricoid and thyroid, ``sternum``. Raises JawError if the condyles reach the skin,
    or lie behind the ears.
    """
    upper, lower = (edge(arch) for arch in arches)
    half = 0.5 * jaw.condyle_width
    if half + CONDYLE[0] + SIDE_GAP > 0.5 * face.face_width:
        raise JawError(
            f"condyle_width is {1e3 * jaw.condyle_width:.4g} mm, expected at most "
            f"{1e3 * (face.face_width - 2 * (CONDYLE[0] + SIDE_GAP)):.4g} mm in a face of "
            f"{1e3 * face.face_width:.4g} mm"
        )
    sagittal = np.sqrt(jaw.condyle_distance**2 - half**2)
    rise = np.radians(BALKWILL + OCCLUSAL_CANT)
    condyle = lower + sagittal * np.array([0.0, -np.cos(rise), np.sin(rise)]) + [half, 0.0, 0.0]
    if not 0.0 < condyle[1] < 0.35 * face.face_depth:
        raise JawError(
            f"the condyles lie {1e3 * condyle[1]:.3g} mm before the tragia, expected 0 to "
            f"{350 * face.face_depth:.3g} mm: change condyle_distance"
        )
    form, half_jaw = FORMS[MANDIBLE], 0.5 * face.jaw_width
    occlusal = 0.5 * (upper + lower)
    back = form.depth * half_jaw
    molar = np.array(
        [
            form.half_width * half_jaw - 4e-3,  # middle of the crown
            lower[1] - back,
            occlusal[2] + back * np.tan(np.radians(OCCLUSAL_CANT)),
        ]
    )
    menton_z = -face.chin_height + face.jaw_thickness
    pogonion = np.array([0.0, face.face_depth + face.chin_protrusion - face.chin_thickness, 0.0])
    pogonion[2] = 0.72 * menton_z
    menton = np.array([0.0, pogonion[1] - 4e-3, menton_z])
    gonion = np.array([half_jaw - face.jaw_thickness, condyle[1] + 6e-3, menton_z + face.jaw_rise])
    chin_back = menton + [0.0, -9e-3, 3e-3]
    slope = (gonion[2] - menton[2]) / (gonion[1] - menton[1])
    down = jaw.hyoid_drop * np.array([0.0, slope, -1.0]) / np.hypot(1.0, slope)
    along = np.array([0.0, -1.0, -slope]) / np.hypot(1.0, slope)
    hyoid = menton + [0.0, -9e-3, 0.0] + jaw.hyoid_back * along + down
    horn = hyoid + [0.5 * jaw.hyoid_width, -0.95 * jaw.hyoid_length, 4e-3]
    notch = hyoid + [0.0, 3e-3, -jaw.thyrohyoid_gap]
    low = notch + [0.0, -4e-3, -jaw.thyroid_height]
    cricoid = low + [0.0, -0.62 * jaw.cricoid_diameter, -jaw.cricothyroid_gap]
    joint = cricoid + [0.46 * jaw.cricoid_diameter, -0.25 * jaw.cricoid_diameter, 3e-3]
    outer = 0.5 * face.face_width - face.cheekbone_thickness
    return {
        "condyle": condyle,
        "incisor": lower,
        "upper_incisor": upper,
        "molar": molar,
        "pogonion": pogonion,
        "menton": menton,
        "chin_back": chin_back,
        "gonion": gonion,
        "coronoid": np.array([condyle[0] - 3e-3, condyle[1] + 33e-3, condyle[2] - 3e-3]),
        "arch": np.array([outer, condyle[1] + 26e-3, condyle[2] - 2e-3]),
        "zygoma": np.array([0.87 * outer, condyle[1] + 45e-3, condyle[2] - 12e-3]),
        "hyoid": hyoid,
        "horn": horn,
        "notch": notch,
        "thyroid_low": low,
        "cricoid": cricoid,
        "joint": joint,
        "sternum": hyoid + [0.0, -12e-3, -jaw.neck_length],
    }


def edge(arch: Arch) -> Floats:
    """Foremost point of the incisal edge in the midline."""
    middle = arch.points[arch.points[:, 0] == 0.0]
    tip = middle[:, 2].min() if arch.bone == SKULL else middle[:, 2].max()
    near = middle[np.abs(middle[:, 2] - tip) < 1e-3]
    foremost: Floats = near[np.argmax(near[:, 1])] * [0.0, 1.0, 1.0]
    return foremost + 0.0  # no negative zero
