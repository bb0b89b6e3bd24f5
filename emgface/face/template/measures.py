"""Measures of the lower face of a person: checks and text format."""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Final

from emgface.errors import FaceError
from emgface.face.template.norms import NORMS
from emgface.schema.units import DIVISORS, spelling

MM: Final = 1e-3

_BY_NAME: Final = {norm.name: norm for norm in NORMS}
_WITHOUT_NORM: Final = {"width_asymmetry": (-0.2, 0.2), "droop": (-8 * MM, 8 * MM)}
_WITHOUT_UNIT: Final = ("width_asymmetry",)


def _middle(name: str) -> float:
    """Midway between the means of men and women [m]."""
    norm = _BY_NAME[name]
    return 0.5 * (norm.men[0] + norm.women[0]) * MM


@dataclass(frozen=True)
class Measures:
    """Measures of one person [m]; the defaults are midway between the means of men and women.

    `emgface.face.template.norms.NORMS` describes the fields. In addition, `width_asymmetry` is the
    difference of the widths of the right and the left side over their mean [1], and `droop` the
    height of the right mouth corner above the left [m]. Raises FaceError, with the measure, if one
    is not finite, is outside its bounds or contradicts another.
    """

    mouth_width: float = _middle("mouth_width")
    philtrum_width: float = _middle("philtrum_width")
    upper_lip_height: float = _middle("upper_lip_height")
    upper_vermilion_height: float = _middle("upper_vermilion_height")
    lower_vermilion_height: float = _middle("lower_vermilion_height")
    lower_lip_height: float = _middle("lower_lip_height")
    chin_height: float = _middle("chin_height")
    nose_height: float = _middle("nose_height")
    nose_width: float = _middle("nose_width")
    nose_protrusion: float = _middle("nose_protrusion")
    face_width: float = _middle("face_width")
    jaw_width: float = _middle("jaw_width")
    face_depth: float = _middle("face_depth")
    upper_lip_protrusion: float = _middle("upper_lip_protrusion")
    lower_lip_protrusion: float = _middle("lower_lip_protrusion")
    chin_protrusion: float = _middle("chin_protrusion")
    cheek_fullness: float = _middle("cheek_fullness")
    cheekbone_prominence: float = _middle("cheekbone_prominence")
    jaw_rise: float = _middle("jaw_rise")
    cupid_bow: float = _middle("cupid_bow")
    lip_gap: float = _middle("lip_gap")
    skin_thickness: float = _middle("skin_thickness")
    upper_lip_thickness: float = _middle("upper_lip_thickness")
    lower_lip_thickness: float = _middle("lower_lip_thickness")
    philtrum_thickness: float = _middle("philtrum_thickness")
    chin_thickness: float = _middle("chin_thickness")
    jaw_thickness: float = _middle("jaw_thickness")
    cheekbone_thickness: float = _middle("cheekbone_thickness")
    cheek_thickness: float = _middle("cheek_thickness")
    nose_thickness: float = _middle("nose_thickness")
    width_asymmetry: float = 0.0
    droop: float = 0.0

    def __post_init__(self) -> None:
        """Refuse impossible measures."""
        for name, value in asdict(self).items():
            low, high = bounds(name)
            if not (math.isfinite(value) and low <= value <= high):
                raise FaceError(
                    f"{name} is {_shown(name, value)}, expected {_shown(name, low)} to "
                    f"{_shown(name, high)}"
                )
        vermilion = self.upper_vermilion_height + self.lower_vermilion_height
        self._demand("upper_vermilion_height", "upper_lip_height", 0.8)
        self._demand("lower_vermilion_height", "lower_lip_height", 0.8)
        self._demand("lower_lip_height", "chin_height", 0.62)
        self._demand("philtrum_width", "mouth_width", 0.35)
        self._demand("mouth_width", "jaw_width", 0.75)
        self._demand("nose_width", "mouth_width", 1.05)
        self._demand("jaw_width", "face_width", 0.95)
        self._demand("nose_protrusion", "nose_height", 0.6)
        self._demand("jaw_rise", "chin_height", 1.0)
        if vermilion > 0.6 * self.mouth_width:
            raise FaceError(
                f"upper_vermilion_height and lower_vermilion_height add up to {_mm(vermilion)}, "
                f"expected at most 0.6 of mouth_width ({_mm(self.mouth_width)})"
            )
        if self.lip_gap > self.upper_vermilion_height:
            raise FaceError(
                f"lip_gap is {_mm(self.lip_gap)}, expected at most upper_vermilion_height "
                f"({_mm(self.upper_vermilion_height)})"
            )

    def _demand(self, small: str, large: str, share: float) -> None:
        one, other = getattr(self, small), getattr(self, large)
        if one > share * other:
            raise FaceError(
                f"{small} is {_mm(one)}, expected at most {share:g} of {large} ({_mm(other)})"
            )

    def with_values(self, values: Mapping[str, float]) -> "Measures":
        """Return these measures with some replaced; FaceError if a name is unknown, or as the class."""
        for name in values:
            bounds(name)
        return replace(self, **values)


def least_usual(measures: Measures) -> str:
    """Describe the measure with the largest deviation from its norm, for a message."""

    def distance(name: str) -> float:
        norm = _BY_NAME[name]
        spread = 0.5 * (norm.men[1] + norm.women[1]) * MM
        return abs(getattr(measures, name) - _middle(name)) / spread

    name = max(_BY_NAME, key=distance)
    return (
        f"{name} of {_mm(getattr(measures, name))}, {distance(name):.1f} standard deviations from the "
        "mean of men and women,"
    )


def bounds(name: str) -> tuple[float, float]:
    """Smallest and largest accepted value of a measure; FaceError if it does not exist."""
    if name in _WITHOUT_NORM:
        return _WITHOUT_NORM[name]
    if name not in _BY_NAME:
        known = ", ".join(field.name for field in fields(Measures))
        raise FaceError(f"unknown measure {name!r}, expected one of {known}")
    low, high = _BY_NAME[name].bounds
    return low * MM, high * MM


def parse_measures(settings: Sequence[str], also: Collection[str] = ()) -> dict[str, float]:
    """Read settings such as ``mouth_width=52mm`` as values in SI units, by name.

    Each setting is ``name=value`` with a unit of length (m, cm, mm, um); `width_asymmetry` has none.
    Names in `also` are lengths, too. Raises FaceError if a setting is not ``name=value``, its name is
    unknown or repeated, its value is not a number, or its unit is missing or not a length.

    Examples
    --------
    >>> parse_measures(["mouth_width=52mm", "width_asymmetry=0.05"])
    {'mouth_width': 0.052, 'width_asymmetry': 0.05}
    """
    values: dict[str, float] = {}
    for setting in settings:
        name, equals, text = (part.strip() for part in setting.partition("="))
        if not equals:
            raise FaceError(
                f"{setting!r} is not a setting, expected name=value, for example mouth_width=52mm"
            )
        if name not in also:
            bounds(name)
        if name in values:
            raise FaceError(f"{name} is specified twice, expected once")
        match = re.fullmatch(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)", text)
        if match is None:
            raise FaceError(
                f"{name} is {text!r}, expected a number with its unit, for example 52mm"
            )
        number, unit = float(match[1]), spelling(match[2])
        divisors = {"": 1.0} if name in _WITHOUT_UNIT else DIVISORS["m"]
        if unit not in divisors:
            expected = "no unit" if name in _WITHOUT_UNIT else f"one of {', '.join(divisors)}"
            raise FaceError(f"the unit of {name} is {match[2]!r}, expected {expected}")
        values[name] = number / divisors[unit]
    return values


def _mm(value: float) -> str:
    return f"{value / MM:.4g} mm"


def _shown(name: str, value: float) -> str:
    return f"{value:g}" if name in _WITHOUT_UNIT else _mm(value)
