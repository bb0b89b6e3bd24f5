"""Every choice of the mechanics of one simulation, with default, unit and source."""

from typing import Any, Literal

from pydantic import Field, model_validator

from emgface.choices import ESKES, OWN, Parameters, configure, parameter
from emgface.face.accuracy import accuracy_settings
from emgface.face.tissue import Tissue

STAVNESS = "Stavness et al., Coupled biomechanical modeling of the face"
BLEMKER = "Blemker et al. 2005, J Biomech 38:657-665"


class SigmaMaxPolicy(Parameters):
    """What happens to sigma_max when a trial cannot be simulated with it.

    The published rule: start high and lower by 10 % each time an element inverts.
    """

    factor: float = parameter(
        0.9,
        "Factor on sigma_max after an inverted element or a step that did not converge.",
        unit="1",
        source=f"{ESKES}, Finite element face model",
        gt=0,
        lt=1,
    )
    scope: Literal["volunteer", "trial"] = parameter(
        "volunteer",
        "Whether a value lowered for one trial holds for all trials of the volunteer, or for it alone.",
        unit="-",
        source=f"{ESKES}, Finite element face model (one value per volunteer)",
        note="with 'volunteer' the trials that ran with a higher value are simulated again",
    )
    minimum: float = parameter(
        30e3,
        "Smallest sigma_max that is tried; below it the trial has failed.",
        unit="Pa",
        source=OWN,
        note="a tenth of the published start",
        gt=0,
    )


class SkinParameters(Parameters):
    """The outer layer of elements, epidermis and dermis, where it differs from the rest."""

    stiffness: float = parameter(
        1.0,
        "Factor on C10 and C20 of the outer layer.",
        unit="1",
        source=OWN,
        note=f"the published skin is three to seven times as stiff as the tissue beneath ({STAVNESS})",
        gt=0,
    )
    kappa: float | None = parameter(
        None,
        "Bulk modulus of the outer layer; absent: that of the rest.",
        unit="Pa",
        source=OWN,
        note="250 kPa in the model of anisotropic skin",
        gt=0,
    )


class Prestress(Parameters):
    """Tension of the skin at rest, by one of two methods."""

    method: Literal["none", "stretch", "displaced"] = parameter(
        "none",
        "'stretch' prescribes the stress of the skin along its tension lines in the given geometry; "
        "'displaced' shrinks the inner sheet of nodes and moves it back in a first step.",
        unit="-",
        source=f"{STAVNESS}, In-vivo measurements (stretch), Facial expressions (displaced)",
        note="either way the face then settles into an equilibrium near the given geometry",
    )
    along: float = parameter(
        15.9e3,
        "Stress of the skin along the tension lines before the face settles.",
        unit="Pa",
        source=f"{STAVNESS}: 15.9 to 89.4 kPa in vivo",
        note="a bulk modulus of 25 kPa bears little of it: raise skin.kappa",
        ge=0,
    )
    across: float = parameter(
        0.0, "The same across the tension lines, in the skin.", unit="Pa", source=OWN, ge=0
    )
    scale: float = parameter(
        0.97,
        "Factor on the distance of the inner sheet from the middle of the face, before it is moved "
        "back.",
        unit="1",
        source=OWN,
        gt=0.5,
        le=1,
    )


class SimulationParameters(Parameters):
    """Tissue, muscles, loads and solver of the face."""

    accuracy: str | None = parameter(
        None,
        "'draft', 'study', 'reference', or the error wanted such as '0.1 mm'; sets solver, step and "
        "error_tolerance where they are not given.",
        unit="-",
        source=f"{OWN}: points measured by `emgface bench work-precision`",
    )
    solver: Literal[
        "converged",
        "trapezoidal",
        "sdirk2",
        "linearly_implicit",
        "linearly_implicit_trapezoidal",
    ] = parameter(
        "converged",
        "Integrator: implicit Euler iterated to its tolerance ('converged'), the trapezoidal rule, the "
        "L-stable second-order SDIRK2, or Euler and trapezoidal rule with one linear solution a step.",
        unit="-",
        source=OWN,
        note="'linearly_implicit' is what the published simulator does",
    )
    step: float = parameter(
        0.01, "Time step, and the time between outputs.", unit="s", source=OWN, gt=0, le=0.1
    )
    error_tolerance: float | None = parameter(
        None,
        "Error of the lip markers that the steps are chosen by, each dividing `step`; absent: steps "
        "of one size, halved where they fail.",
        unit="m",
        source=OWN,
        gt=0,
    )
    timing: Literal["recorded", "normalised"] = parameter(
        "recorded",
        "Simulated time: that of the recording, or one step per sample of the activation.",
        unit="-",
        source=f"{ESKES}, Discussion (each instruction was normalised to 160 time steps)",
        note="'normalised' changes the speed of a movement when a trial is not steps x step long",
    )
    linear_solver: Literal["auto", "pardiso", "superlu"] = parameter(
        "auto",
        "Factorisation: PARDISO where it is installed, else SciPy's SuperLU.",
        unit="-",
        source=OWN,
    )
    sigma_max: float = parameter(
        300e3,
        "Largest active muscle stress at the start.",
        unit="Pa",
        source=f"{ESKES}, Finite element face model",
        gt=0,
    )
    sigma_max_policy: SigmaMaxPolicy = Field(
        default=SigmaMaxPolicy(), description="When a trial cannot be simulated with sigma_max."
    )
    fibre_law: Literal["blemker", "generic"] = parameter(
        "blemker",
        "Stress of the muscle fibres.",
        unit="-",
        source=f"{ESKES} (Blemker); the published model's source (generic)",
        note="'generic' has no dependence of the active stress on length",
    )
    muscle_form: Literal["elements", "lines"] = parameter(
        "elements",
        "Whether the muscles are stresses in elements or tensions along their fibre lines.",
        unit="-",
        source=f"{ESKES} (elements); {STAVNESS}, reference face (cables)",
        note="lines pull with line_force and know no sigma_max",
    )
    line_force: float = parameter(
        1.0,
        "Tension of every fibre line at full activation.",
        unit="N",
        source="the published model's source",
        gt=0,
    )
    stiffening: float = parameter(
        1.0,
        "Factor on the passive moduli of a muscle's elements at full activation; 1 is off.",
        unit="1",
        source=f"{STAVNESS}, Lip stiffness enables protrusion and rounding",
        note="10 in the tongue model of the same collection",
        ge=1,
    )
    support: float = parameter(
        0.0,
        "Stiffness of a frictionless wall behind every free node of the inner sheet; 0 is none.",
        unit="N/m",
        source=f"{STAVNESS}, Teeth support lip protrusion; the form is of {OWN}",
        note="stands for teeth and bone that the inner side of the lips rests on",
        ge=0,
    )
    skin: SkinParameters = Field(default=SkinParameters(), description="The outer layer.")
    tissues: tuple[Tissue, ...] = Field(
        default=(),
        description="Tissues of layers, muscles or single elements, in place of C10, C20, kappa, "
        "density and skin there; a later one takes the place of an earlier one.",
    )
    prestress: Prestress = Field(default=Prestress(), description="Tension of the skin at rest.")
    incompressibility: Literal["pointwise", "element", "nodal", "hard"] = parameter(
        "pointwise",
        "Volume that a pressure belongs to: a Gauss point, an element, or the region of a node; "
        "'hard' keeps the volume of every element.",
        unit="-",
        source=f"{ESKES}, Incompressibility (nodal)",
        note="'nodal' cures locking best and costs most; 'element' and 'nodal' take the quadratic "
        "potential, 'hard' has none",
    )
    bulk_potential: Literal["logarithmic", "quadratic"] = parameter(
        "logarithmic",
        "kappa/2 (ln J)^2 or kappa/2 (J - 1)^2.",
        unit="-",
        source=f"{ESKES}, Eq. 1 (logarithmic); its text says quadratic",
    )
    C10: float = parameter(
        2500.0, "First Mooney-Rivlin coefficient.", unit="Pa", source=f"{ESKES}, Eq. 1", gt=0
    )
    C20: float = parameter(
        1175.0, "Second Mooney-Rivlin coefficient.", unit="Pa", source=f"{ESKES}, Eq. 1", ge=0
    )
    kappa: float = parameter(25e3, "Bulk modulus.", unit="Pa", source=f"{ESKES}, Eq. 1", gt=0)
    lambda_star: float = parameter(
        1.4,
        "Fibre stretch above which the passive stress is linear.",
        unit="1",
        source=f"{ESKES}, Finite element face model",
        gt=1,
    )
    P1: float = parameter(
        0.05,
        "Exponential stress coefficient of the passive fibre.",
        unit="1",
        source=f"{ESKES}; {BLEMKER}",
        note="in pascal for the generic law",
        ge=0,
    )
    P2: float = parameter(
        6.6, "Uncrimping factor of the passive fibre.", unit="1", source=f"{ESKES}; {BLEMKER}", ge=0
    )
    density: float = parameter(
        1040.0, "Tissue density.", unit="kg/m^3", source=f"{ESKES}, Methods", gt=0
    )
    alpha: float = parameter(19.0, "Rayleigh damping by mass.", unit="1/s", source=STAVNESS, ge=0)
    beta: float = parameter(
        0.055, "Rayleigh damping by stiffness.", unit="s", source=STAVNESS, ge=0
    )
    damping_tangent: Literal["current", "passive", "rest"] = parameter(
        "rest",
        "Stiffness that beta multiplies: at the current positions and activation, at the current "
        "positions with silent muscles, or at rest.",
        unit="-",
        source=f"the published simulator uses 'current'; default of {OWN}",
        note="with active muscles the current tangent can damp negatively, and a step then has no "
        "minimum to converge to",
    )
    gravity: bool = parameter(
        True,
        "Whether gravity of 9.8 m/s^2 acts along -z; the face then starts at its equilibrium.",
        unit="-",
        source=f"{ESKES}, Finite element face model",
    )

    @model_validator(mode="before")
    @classmethod
    def _as_accurate(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("accuracy") is not None:
            return accuracy_settings(str(data["accuracy"])) | data
        return data

    @model_validator(mode="after")
    def _startable(self) -> "SimulationParameters":
        if self.error_tolerance is not None and self.solver.startswith("linearly_implicit"):
            raise ValueError(
                f"solver = '{self.solver}' has no error control: choose 'sdirk2', 'trapezoidal' or "
                "'converged', or leave error_tolerance out"
            )
        soft = self.incompressibility in ("element", "nodal")
        if soft and self.bulk_potential != "quadratic":
            raise ValueError(
                f"incompressibility = '{self.incompressibility}' has the quadratic potential "
                "only: set bulk_potential = 'quadratic'"
            )
        linear = any(t.law in ("linear", "co_rotational") for t in self.tissues)
        for name, used, fits in (
            ("skin.kappa", self.skin.kappa is not None, ("pointwise", "element", "nodal")),
            (
                "kappa of a tissue",
                any(t.kappa is not None for t in self.tissues),
                ("pointwise", "element", "nodal"),
            ),
            ("a tissue with law 'linear' or 'co_rotational'", linear, ("pointwise", "element")),
            ("prestress.method = 'stretch'", self.prestress.method == "stretch", ("pointwise",)),
        ):
            if used and self.incompressibility not in fits:
                raise ValueError(
                    f"{name} does not go with incompressibility = '{self.incompressibility}': "
                    f"expected {' or '.join(map(repr, fits))}"
                )
        if self.stiffening > 1.0 and any(t.relaxing for t in self.tissues):
            raise ValueError(
                "a tissue with relaxing stress cannot stiffen with activation: set stiffening = 1 or "
                "make the tissue elastic"
            )
        if self.sigma_max < self.sigma_max_policy.minimum:
            raise ValueError(
                f"sigma_max = {self.sigma_max:g} Pa is below sigma_max_policy.minimum = "
                f"{self.sigma_max_policy.minimum:g} Pa: lower the minimum"
            )
        return self

    def as_accurate(self, accuracy: str) -> "SimulationParameters":
        """The same tissue and loads, solved to a preset or an error wanted.

        Parameters
        ----------
        accuracy : str
            "draft", "study", "reference", or an error such as "0.1 mm".

        Returns
        -------
        SimulationParameters

        Raises
        ------
        ConfigurationError
            It is neither.
        """
        values = self.model_dump(exclude={"solver", "step", "error_tolerance"})
        return configure(SimulationParameters, values | {"accuracy": accuracy}, where="simulation")
