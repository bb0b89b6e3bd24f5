"""Parameters of the mechanics of a tongue, and its published variants."""

from typing import Final, Literal

from emgface.choices import BLEMKER, STAVNESS, THIS_PACKAGE, Parameters, choice, parameter, positive
from emgface.errors import TongueError

PROGRAM = "published program of the tongue (ArtiSynth Models)"


class TongueParameters(Parameters):
    """Tissue, muscles, damping and gravity of a tongue."""

    muscles: Literal["lines", "elements"] = choice(
        "elements",
        "Axial forces along fibres, spread by the volume of elements, or active stress in elements.",
        source=PROGRAM,
    )
    law: Literal["mooney_rivlin", "linear"] = choice(
        "mooney_rivlin",
        "Hyperelastic law with one pressure per element, or co-rotational linear elasticity.",
        source=PROGRAM,
        note="the published program uses 'linear' on five tetrahedra per hexahedron",
    )
    C10: float = positive(1037.0, "First coefficient of Mooney-Rivlin.", unit="Pa", source=STAVNESS)
    C20: float = parameter(
        486.0, "Second coefficient of Mooney-Rivlin.", unit="Pa", source=STAVNESS, ge=0
    )
    kappa: float = positive(
        10370.0, "Bulk modulus of the element-wise pressure.", unit="Pa", source=STAVNESS
    )
    young: float = positive(6912.0, "Young's modulus of 'linear'.", unit="Pa", source=PROGRAM)
    poisson: float = parameter(0.49, "Poisson's ratio of 'linear'.", source=PROGRAM, ge=0, lt=0.5)
    density: float = positive(1040.0, "Density.", unit="kg/m^3", source=STAVNESS)
    incompressibility: Literal["hard", "element"] = choice(
        "element",
        "Constant volume of every element by multipliers, or the pressure of the bulk modulus alone.",
        source=PROGRAM,
    )
    stiffening: float = parameter(
        10.0,
        "Factor on the passive moduli of the elements of fully active muscles.",
        source=PROGRAM,
        ge=1,
    )
    sigma_max: float = positive(
        300e3, "Largest active stress in elements.", unit="Pa", source=PROGRAM
    )
    stretch_opt: float = positive(1.0, "Stretch of the largest active stress.", source=BLEMKER)
    lambda_star: float = positive(
        1.4, "Stretch beyond which the passive stress is linear.", source=BLEMKER
    )
    outside_force: float = parameter(
        0.5,
        "Force of every segment of a muscle that has points outside the mesh, with 'elements'.",
        unit="N",
        source=PROGRAM,
        ge=0,
    )
    alpha: float = parameter(40.0, "Damping by mass.", unit="1/s", source=STAVNESS, ge=0)
    beta: float = parameter(0.03, "Damping by stiffness.", unit="s", source=STAVNESS, ge=0)
    damping_tangent: Literal["current", "passive", "rest"] = choice(
        "current",
        "Stiffness of the damping: with active muscles, without them, or at rest.",
        source=THIS_PACKAGE,
        note="the default is also that of faces; the published program uses 'current'",
    )
    gravity: bool = choice(True, "Gravity of 9.8 m/s^2 along -z.", source=STAVNESS)


TONGUE_VARIANTS: Final = {
    "elements": TongueParameters(),
    "lines": TongueParameters(muscles="lines", incompressibility="hard"),
    "linear": TongueParameters(muscles="lines", law="linear"),
    "stable": TongueParameters(
        sigma_max=100e3,
        stretch_opt=1.1,
        lambda_star=1.5,
        kappa=103700.0,
        alpha=67.0158,
        beta=1.3154e-4,
    ),
}
"""Variants of the published program: element muscles, line muscles with constant volumes, linear
elasticity, and element muscles with a stronger pressure and less damping by stiffness."""


def variant(name: str, **changes: object) -> TongueParameters:
    """Parameters of a variant with changes; TongueError if the variant is unknown."""
    if name not in TONGUE_VARIANTS:
        raise TongueError(f"no variant {name!r}, expected one of {', '.join(TONGUE_VARIANTS)}")
    return TongueParameters.model_validate(TONGUE_VARIANTS[name].model_dump() | changes)
