"""Parameters of the passive tissue of the face: laws, skin, damping."""

from typing import Literal

from pydantic import Field

from emgface.choices import ESKES, STAVNESS, THIS_PACKAGE, Parameters, choice, parameter, positive
from emgface.face.tissue import Tissue


class SkinParameters(Parameters):
    """Parameters of the outer layer of elements, epidermis and dermis."""

    stiffness: float = positive(
        1.0,
        "Factor on C10 and C20 of the outer layer.",
        note=f"the published skin is three to seven times as stiff as the tissue beneath ({STAVNESS})",
    )
    kappa: float | None = positive(
        None,
        "Bulk modulus of the outer layer; default: that of the other layers.",
        unit="Pa",
        note="250 kPa in the model of anisotropic skin",
    )


class Prestress(Parameters):
    """Tension of the skin at rest, by one of two methods."""

    method: Literal["none", "stretch", "displaced"] = choice(
        "none",
        "'stretch' prescribes the stress of the skin along its tension lines in the given geometry; "
        "'displaced' shrinks the inner surface and moves it back in a first step.",
        source=f"{STAVNESS}, In-vivo measurements (stretch), Facial expressions (displaced)",
        note="with both methods, the face then settles into an equilibrium near the given geometry",
    )
    along: float = parameter(
        15.9e3,
        "Stress of the skin along the tension lines before the face settles.",
        unit="Pa",
        source=f"{STAVNESS}: 15.9 to 89.4 kPa in vivo",
        note="with a bulk modulus of 25 kPa, little of this stress remains: increase skin.kappa",
        ge=0,
    )
    across: float = parameter(
        0.0, "Stress of the skin across the tension lines before the face settles.", unit="Pa", ge=0
    )
    scale: float = parameter(
        0.97,
        "Factor on the distance of the inner surface from the centre of the face, before it "
        "is moved back.",
        gt=0.5,
        le=1,
    )


class TissueParameters(Parameters):
    """Laws of the tissue, of its volume and of its damping."""

    incompressibility: Literal["pointwise", "element", "nodal", "hard"] = choice(
        "pointwise",
        "Region over which the pressure is constant: a Gauss point, an element, or the "
        "region of a node; 'hard' keeps the volume of every element.",
        source=f"{ESKES}, Incompressibility (nodal)",
        note="'nodal' reduces locking most and takes the most time; 'element' and 'nodal' "
        "require the quadratic potential, 'hard' has none",
    )
    bulk_potential: Literal["logarithmic", "quadratic"] = choice(
        "logarithmic",
        "Bulk potential: kappa/2 (ln J)^2 or kappa/2 (J - 1)^2.",
        source=f"{ESKES}, Eq. 1 (logarithmic); its text says quadratic",
    )
    C10: float = positive(
        2500.0, "First Mooney-Rivlin coefficient.", unit="Pa", source=f"{ESKES}, Eq. 1"
    )
    C20: float = parameter(
        1175.0, "Second Mooney-Rivlin coefficient.", unit="Pa", source=f"{ESKES}, Eq. 1", ge=0
    )
    kappa: float = positive(25e3, "Bulk modulus.", unit="Pa", source=f"{ESKES}, Eq. 1")
    density: float = positive(1040.0, "Tissue density.", unit="kg/m^3", source=f"{ESKES}, Methods")
    alpha: float = parameter(19.0, "Rayleigh damping by mass.", unit="1/s", source=STAVNESS, ge=0)
    beta: float = parameter(
        0.055, "Rayleigh damping by stiffness.", unit="s", source=STAVNESS, ge=0
    )
    damping_tangent: Literal["current", "passive", "rest"] = choice(
        "rest",
        "Stiffness multiplied by beta: at the current positions and activation, at the "
        "current positions without activation, or at rest.",
        source=f"the published simulator uses 'current'; default of {THIS_PACKAGE}",
        note="with active muscles, the damping of the current tangent can be negative, and the "
        "potential of a step then has no minimum",
    )
    skin: SkinParameters = Field(
        default=SkinParameters(), description="Properties of the outer layer."
    )
    tissues: tuple[Tissue, ...] = Field(
        default=(),
        description="Tissues of layers, muscles or single elements, which replace C10, C20, kappa, "
        "density and skin; where several apply, the last one is used.",
    )
    prestress: Prestress = Field(default=Prestress(), description="Tension of the skin at rest.")
