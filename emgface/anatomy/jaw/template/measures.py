"""Measures of jaw, hyoid and larynx of a person: norms with their sources, and their defaults.

The standing of each number is that of `emgface.face.template.norms`: "found" in the cited text, or
"assumption", for numbers quoted without access to the source, derived, or chosen.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Final

from emgface.errors import JawError
from emgface.face.template.measures import MM, Measures, parse_measures
from emgface.face.template.norms import NORM_SOURCES, NORMS, Norm, read_norms

_SOURCES: Final = NORM_SOURCES | {
    "BONWILL": "A three-dimensional morphometric study on the position of temporomandibular joints, "
    "PubMed 26734666 (120 cone-beam scans)",
    "BIBBY": "Bibby and Preston 1981, Am J Orthod 80:92-97 (54 lateral radiographs)",
    "SAGIV": "Sagiv et al. 2016, Otolaryngol Head Neck Surg 154:674-678 (126 scans)",
    "ECKEL": "Eckel et al. 1994, Surg Radiol Anat 16:31-36; Sprinzl et al. 1999, Head Neck 21:743-750",
    "HYOID": "Miller et al. 1998, J Forensic Sci 43:1138-1141",
}

BALKWILL: Final = 20.4
"""Angle of the plane through condyles and lower incisors to the occlusal plane [degrees]: mean of
the source of the distances of the condyles, found."""
OCCLUSAL_CANT: Final = 9.3
"""Angle of the occlusal plane to the Frankfort horizontal [degrees]: mean of Downs 1948, Am J
Orthod 34:812-840, as quoted."""
EMINENCE_SLOPE: Final = 40.0
"""Slope of the condylar path at its start to the Frankfort horizontal [degrees]: within the 30 to 60
degrees of normal eminences quoted by Suembuellue et al. 2012, Dentomaxillofac Radiol 41:234-240."""

JAW_NORMS: Final = read_norms(__file__, _SOURCES)
"""Measures of the jaw, of ``measures.csv``; those of face, teeth and chin are the ones of the face."""

_BY_NAME: Final = {norm.name: norm for norm in JAW_NORMS}
_SIZES: Final = ("face_width", "face_depth")
"""Measures of the face whose mean ratio to their norms scales the defaults."""


@dataclass(frozen=True)
class JawMeasures:
    """Measures of one person [m], described by `JAW_NORMS`.

    Raises JawError if one is not finite or outside its bounds.
    """

    condyle_width: float
    condyle_distance: float
    eminence_length: float
    crown_height: float
    hyoid_back: float
    hyoid_drop: float
    hyoid_width: float
    hyoid_length: float
    thyrohyoid_gap: float
    thyroid_height: float
    thyroid_depth: float
    thyroid_width: float
    cricothyroid_gap: float
    cricoid_diameter: float
    neck_length: float

    def __post_init__(self) -> None:
        """Refuse impossible measures."""
        for name, value in asdict(self).items():
            low, high = (MM * x for x in _BY_NAME[name].bounds)
            if not (math.isfinite(value) and low <= value <= high):
                raise JawError(
                    f"{name} is {value / MM:.4g} mm, expected {low / MM:g} to {high / MM:g} mm"
                )


def jaw_measures(
    face: Measures, preset: str = "adult", values: Mapping[str, float] | None = None
) -> JawMeasures:
    """Measures [m] of the jaw that belongs to a face, with `values` in place of defaults.

    The defaults are the means of the sex of the preset
    (`emgface.face.template.volunteers.PRESETS`), both sexes for others than women, girls, men and
    boys, times the mean ratio of width and depth of the face to their norms. Raises JawError if a
    measure does not exist or is out of bounds.
    """
    given = dict(values or {})
    unknown = sorted(set(given) - set(_BY_NAME))
    if unknown:
        raise JawError(f"unknown measure {unknown[0]!r}, expected one of {', '.join(_BY_NAME)}")
    sizes = [n for n in NORMS if n.name in _SIZES]
    scale = sum(getattr(face, n.name) / (MM * _mean(n, preset)) for n in sizes) / len(sizes)
    defaults = {n.name: scale * MM * _mean(n, preset) for n in JAW_NORMS}
    return JawMeasures(**defaults | given)


def parse_settings(settings: Sequence[str]) -> dict[str, float]:
    """Settings such as ``condyle_width=98mm`` of the jaw, or of the face, in SI units by name."""
    return parse_measures(settings, also=_BY_NAME)


def _mean(norm: Norm, preset: str) -> float:
    if preset.endswith(("woman", "girl")):
        return norm.women[0]
    return norm.men[0] if preset.endswith(("man", "boy")) else 0.5 * (norm.men[0] + norm.women[0])
