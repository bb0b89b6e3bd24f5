"""Measurement of surfaces, and calibration of surfaces to given measures.

Relief, curvature and the directions of the tissue shift landmarks by up to a few millimetres from
the positions that are passed to the construction. The parameters of the construction are therefore
found by iteration: new parameter = old parameter + (wanted - measured).
"""

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.template.measures import MM, Measures, least_usual
from emgface.face.template.outline import MARGIN, MIDDLE, PERIORAL, RIM, VERMILION
from emgface.face.template.surface import Surfaces

Floats = NDArray[np.float64]

#: tolerance of the measures of the surface at which the search ends [m]
MEASURE_TOLERANCE: Final = 0.05e-3
LARGEST_MEASURE_MISS: Final = 0.5e-3
"""Largest accepted difference of the measures if the search does not converge [m]."""
_ROUNDS: Final = 60
_MIDLINE_S: Final = np.unique(
    np.concatenate([np.linspace(MARGIN, RIM, 201), [VERMILION, PERIORAL]])
)


@dataclass(frozen=True)
class ConstructionParameters(Measures):
    """Parameters of the construction, which are not measures and therefore not checked."""

    def __post_init__(self) -> None:
        """Skip the check of the measures."""


def surface_measures(surfaces: Surfaces) -> dict[str, float]:
    """Measures of a surface that are defined by landmarks of the skin, by name [m]."""
    s = _MIDLINE_S
    ends = np.zeros(2)
    skin, _ = surfaces.sheets(ends, np.array([1.0, -1.0]), s)
    upper, lower = skin
    at = {ring: int(np.flatnonzero(s == ring)[0]) for ring in (MARGIN, VERMILION, PERIORAL, RIM)}
    border, base = at[VERMILION], at[PERIORAL]
    subnasale = upper[base]
    pronasale = upper[base + int(np.argmax(upper[base:, 1]))]
    corner, _ = surfaces.sheets(np.ones(1), np.ones(1), np.array([MARGIN]))
    # The face is widest above the level of the mouth, near the rim.
    q = np.linspace(0.4, 1.0, 13)
    wide, _ = surfaces.sheets(q, np.ones(13), np.linspace(MIDDLE, RIM, 25))
    return {
        "mouth_width": 2.0 * float(corner[0, 0, 0]),
        "upper_lip_height": float(subnasale[2]),
        "upper_vermilion_height": float(upper[border, 2]),
        "lower_vermilion_height": -float(lower[border, 2]),
        "lower_lip_height": -float(lower[base, 2]),
        "chin_height": -float(lower[:, 2].min()),
        "nose_height": float(upper[-1, 2] - subnasale[2]),
        "nose_protrusion": float(np.linalg.norm(pronasale - subnasale)),
        "face_width": 2.0 * float(wide[..., 0].max()),
        "face_depth": float(subnasale[1]),
        "upper_lip_protrusion": float(upper[:base, 1].max() - subnasale[1]),
        "lower_lip_protrusion": float(lower[:base, 1].max() - subnasale[1]),
        "chin_protrusion": float(lower[base:, 1].max() - subnasale[1]),
        "lip_gap": float(upper[0, 2] - lower[0, 2]),
    }


def profiles_of_tips(surfaces: Surfaces) -> dict[str, NDArray[np.float64]]:
    """Midline of the skin (n, 3) [m] on which the tip of the nose, and that of the chin, lies."""
    skin, _ = surfaces.sheets(np.zeros(2), np.array([1.0, -1.0]), _MIDLINE_S)
    base = int(np.flatnonzero(_MIDLINE_S == PERIORAL)[0])
    return {"pronasale": skin[0, base:], "pogonion": skin[1, base:]}


def calibrated_surfaces(measures: Measures) -> Surfaces:
    """Compute surfaces whose landmarks agree with the measures.

    The `measures` of the result are the parameters of the construction. Raises FaceError, with the
    measure, if one cannot be reached together with the others.
    """
    values = {field.name: float(getattr(measures, field.name)) for field in fields(measures)}
    best: tuple[float, dict[str, float], Surfaces] | None = None
    for _ in range(_ROUNDS):
        surfaces = Surfaces(ConstructionParameters(**values))
        try:
            reached = surface_measures(surfaces)
        except ValueError:  # the parameters of the search do not define a surface
            break
        miss = {name: getattr(measures, name) - value for name, value in reached.items()}
        size = max(map(abs, miss.values()))
        if best is None or size < best[0]:
            best = size, miss, surfaces
        if size <= MEASURE_TOLERANCE:
            break
        for name, difference in miss.items():
            values[name] += 0.7 * difference
    if best is None:
        raise FaceError(
            f"{least_usual(measures)} does not yield a face with the other measures: choose "
            "a value closer to the mean"
        )
    size, miss, surfaces = best
    if size <= LARGEST_MEASURE_MISS:
        return surfaces
    worst = max(miss, key=lambda name: abs(miss[name]))
    raise FaceError(
        f"{worst} of {getattr(measures, worst) / MM:.1f} mm cannot be reached with the other "
        f"measures (closest {(getattr(measures, worst) - miss[worst]) / MM:.1f} mm): choose "
        "a value closer to the mean or change related measures"
    )
