"""Parameters of the muscles of the face."""

from typing import Final, Literal

from pydantic import Field

from emgface.choices import BLEMKER, ESKES, STAVNESS, Parameters, choice, parameter, positive

SIGMA_MAX: Final = 100e3
"""Largest active stress of the published lip and expression simulations [Pa] (Stavness et al.)."""


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


class MuscleParameters(Parameters):
    """Parameters of the muscle force."""

    sigma_max: float = positive(
        300e3,
        "Initial value of the largest active muscle stress.",
        unit="Pa",
        source=f"{ESKES}, Finite element face model",
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
