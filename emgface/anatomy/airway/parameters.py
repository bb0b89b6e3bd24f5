"""Parameters of the vocal tract behind the lips of a face."""

from pathlib import Path
from typing import Final, Literal

from emgface.choices import Parameters, choice, positive

LIP_SECTION_LENGTH: Final = 0.01
"""Length of the lips' section at rest, behind the plane of the lips [m]."""


class TractParameters(Parameters):
    """Tract that does not move, and the section of the lips before it."""

    vowel: Literal["a", "i", "u"] = choice("u", "Idealised vowel whose shape the tract has.")
    areas: Path | None = choice(
        None, "Area function (CSV or netCDF) used instead of the vowel; relative to this file."
    )
    lips: float = positive(
        LIP_SECTION_LENGTH, "Length of the lips' section at rest.", unit="m", le=0.03
    )
