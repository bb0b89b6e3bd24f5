"""Parameters of the muscles of the face."""

from typing import Any, Final, Literal

from pydantic import Field, field_validator

from emgface.choices import BLEMKER, ESKES, STAVNESS, Parameters, choice, parameter, positive

SIGMA_MAX: Final = 100e3
"""Largest active stress of the published lip and expression simulations [Pa] (Stavness et al.)."""


PUBLISHED_START: Final = 300e3
"""Value from which the published study lowers sigma_max [Pa] (Eskes et al. 2017); "published"."""


class SigmaMaxPolicy(Parameters):
    """Policy of sigma_max for trials that cannot be simulated with it.

    The published rule: start high and lower by 10 % each time an element inverts.
    """

    factor: float = parameter(
        0.9,
        "Factor applied to sigma_max after an inverted element or a step that did not converge.",
        source=f"{ESKES}, Finite element face model",
        gt=0,
        lt=1,
    )
    scope: Literal["volunteer", "trial"] = choice(
        "volunteer",
        "Scope of a lowered value: all trials of the volunteer, or the trial.",
        source=f"{ESKES}, Finite element face model (one value per volunteer)",
        note="with 'volunteer', trials that were simulated with a higher value are simulated again",
    )
    minimum: float = positive(
        30e3,
        "Smallest sigma_max; a trial that requires a lower value has failed.",
        unit="Pa",
        note="a tenth of the published initial value",
    )
    calibration: Literal["none", "repetitions"] = choice(
        "none",
        "Initial value: that of the parameter sigma_max, or for each volunteer, repetition and strategy "
        "the one at which face and volunteer move equally far in the volunteer's other repetitions.",
        note="between 50 and 300 kPa; the markers of a repetition do not affect its own value",
    )


class MuscleParameters(Parameters):
    """Parameters of the muscle force."""

    sigma_max: float = positive(
        PUBLISHED_START,
        "Initial value of the largest active muscle stress.",
        unit="Pa",
        source=f"{ESKES}, Finite element face model",
        note="'published' is this start; simulated volunteers have 80e3 to 150e3, and what persons "
        "have is not published",
    )
    sigma_max_policy: SigmaMaxPolicy = Field(
        default=SigmaMaxPolicy(),
        description="Policy for trials that cannot be simulated with sigma_max.",
    )
    fibre_law: Literal["blemker", "generic"] = choice(
        "blemker",
        "Law of the muscle fibre stress.",
        source=f"{ESKES} (Blemker); the published model's source (generic)",
        note="with 'generic', the active stress does not depend on the fibre length",
    )
    muscle_form: Literal["elements", "lines"] = choice(
        "elements",
        "Representation of the muscles: stresses in elements, or tensions along fibre lines.",
        source=f"{ESKES} (elements); {STAVNESS}, reference face (cables)",
        note="lines pull with line_force; sigma_max does not apply to them",
    )
    line_force: float = positive(
        1.0,
        "Tension of each fibre line at full activation.",
        unit="N",
        source="the published model's source",
    )
    stiffening: float = parameter(
        1.0,
        "Factor on the passive moduli of the elements of a muscle at full activation; 1 is "
        "no stiffening.",
        source=f"{STAVNESS}, Lip stiffness enables protrusion and rounding",
        note="10 in the tongue model of the same collection",
        ge=1,
    )
    lambda_star: float = parameter(
        1.4,
        "Fibre stretch above which the passive stress is linear.",
        source=f"{ESKES}, Finite element face model",
        gt=1,
    )
    P1: float = parameter(
        0.05,
        "Exponential stress coefficient of the passive fibre.",
        source=f"{ESKES}; {BLEMKER}",
        note="in pascal for the generic law",
        ge=0,
    )
    P2: float = parameter(
        6.6, "Uncrimping factor of the passive fibre stress.", source=f"{ESKES}; {BLEMKER}", ge=0
    )

    @field_validator("sigma_max", mode="before")
    @classmethod
    def _named(cls, value: Any) -> Any:
        """Replace the name "published" by its value."""
        return PUBLISHED_START if value == "published" else value
