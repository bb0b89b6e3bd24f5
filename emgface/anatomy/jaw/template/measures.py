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
from emgface.face.template.norms import NORMS, Norm

BONWILL: Final = (
    "A three-dimensional morphometric study on the position of temporomandibular joints, PubMed "
    "26734666 (120 cone-beam scans)"
)
DOWNS: Final = "Downs 1948, Am J Orthod 34:812-840"
BIBBY: Final = "Bibby and Preston 1981, Am J Orthod 80:92-97 (54 lateral radiographs)"
SAGIV: Final = "Sagiv et al. 2016, Otolaryngol Head Neck Surg 154:674-678 (126 scans)"
ECKEL: Final = (
    "Eckel et al. 1994, Surg Radiol Anat 16:31-36; Sprinzl et al. 1999, Head Neck 21:743-750"
)
HYOID: Final = "Miller et al. 1998, J Forensic Sci 43:1138-1141"
OWN: Final = "choice of this template"
_QUOTED: Final = "rounded, as commonly quoted; the source was not available"
_POOLED: Final = "mean of both sexes found; the sexes differ as the widths of their faces"

BALKWILL: Final = 20.4
"""Angle of the plane through condyles and lower incisors to the occlusal plane [degrees]: mean of
`BONWILL`, found."""
OCCLUSAL_CANT: Final = 9.3
"""Angle of the occlusal plane to the Frankfort horizontal [degrees]: mean of `DOWNS`, as quoted."""
EMINENCE_SLOPE: Final = 40.0
"""Slope of the condylar path at its start to the Frankfort horizontal [degrees]: within the 30 to 60
degrees of normal eminences quoted by Suembuellue et al. 2012, Dentomaxillofac Radiol 41:234-240."""

# fmt: off
JAW_NORMS: Final = (
    Norm("condyle_width", "between the centres of the condyles", (102.2, 5), (97.0, 5), (70, 125),
         BONWILL, "assumption", f"99.6, range 85.2 to 112.6: {_POOLED}"),
    Norm("condyle_distance", "condyle to the lower incisors", (106.0, 5), (100.6, 5), (70, 130),
         BONWILL, "assumption", f"103.3, range 90.2 to 117.9: {_POOLED}"),
    Norm("eminence_length", "fossa to crest of the eminence, horizontal", (17, 2), (16, 2), (8, 24),
         OWN, "assumption", "with the slope of the start, a height of 7 mm"),
    Norm("crown_height", "incisal edge to the bone of the lower incisors", (9.5, 1), (9.0, 1), (6, 13),
         OWN, "assumption", "crown of a lower incisor"),
    Norm("hyoid_back", "body of the hyoid behind the back of the chin", (38, 5), (34, 5), (15, 60),
         BIBBY, "assumption", _QUOTED),
    Norm("hyoid_drop", "body of the hyoid below the border of the mandible", (17, 5), (13, 4), (2, 40),
         BIBBY, "assumption", _QUOTED),
    Norm("hyoid_width", "between the ends of the greater horns", (42, 5), (38, 5), (25, 60),
         HYOID, "assumption", _QUOTED),
    Norm("hyoid_length", "body to the ends of the greater horns", (36, 4), (32, 3), (20, 50),
         HYOID, "assumption", _QUOTED),
    Norm("thyrohyoid_gap", "hyoid to the thyroid cartilage", (17, 4), (15, 4), (5, 35),
         OWN, "assumption", "midline"),
    Norm("thyroid_height", "thyroid cartilage in the midline", (20, 2.5), (15.5, 2), (8, 30),
         ECKEL, "assumption", _QUOTED),
    Norm("thyroid_depth", "laryngeal prominence to the posterior borders", (36, 3), (28, 2.5), (18, 48),
         ECKEL, "assumption", _QUOTED),
    Norm("thyroid_width", "between the posterior borders", (45, 5), (40, 4), (26, 60),
         SAGIV, "assumption", "from the depth and the angles found, 63.5 and 93.3 degrees, less flare"),
    Norm("cricothyroid_gap", "height of the cricothyroid membrane", (11.1, 2.3), (10.3, 1.7), (4, 18),
         SAGIV, "found", ""),
    Norm("cricoid_diameter", "outer diameter of the cricoid", (30, 2.5), (25, 2), (16, 40),
         ECKEL, "assumption", _QUOTED),
    Norm("neck_length", "hyoid to the sternal notch", (100, 12), (92, 12), (60, 140),
         OWN, "assumption", "upright head"),
)
# fmt: on
"""Measures of the jaw; those of face, teeth and chin are the ones of the face."""

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
