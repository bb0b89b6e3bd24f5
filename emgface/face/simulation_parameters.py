"""Parameters of the mechanics of a simulation, with default, unit and source."""

from pydantic import Field, model_validator

from emgface.choices import ESKES, STAVNESS, THIS_PACKAGE, choice, configure, parameter
from emgface.face.accuracy import SET_BY_ACCURACY
from emgface.face.contact_parameters import ContactParameters
from emgface.face.muscle_parameters import MuscleParameters, SigmaMaxPolicy
from emgface.face.time_stepping import TimeStepping
from emgface.face.tissue_parameters import Prestress, SkinParameters, TissueParameters
from emgface.reduced.parameters import ReducedParameters

__all__ = [
    "ContactParameters",
    "Prestress",
    "SigmaMaxPolicy",
    "SimulationParameters",
    "SkinParameters",
]


class SimulationParameters(TissueParameters, MuscleParameters, TimeStepping):
    """Tissue, muscles, loads and solver of the face."""

    support: float = parameter(
        0.0,
        "Stiffness of a frictionless wall behind every free node of the inner surface; 0 is no wall.",
        unit="N/m",
        source=f"{STAVNESS}, Teeth support lip protrusion; the form is of {THIS_PACKAGE}",
        note="represents the teeth and bone behind the lips",
        ge=0,
    )
    contact: ContactParameters = Field(
        default=ContactParameters(), description="Contact of lips and teeth."
    )
    check_contact: bool = choice(
        False,
        "Repeat every motion with contact with other time steps, and add twice the largest distance of "
        "a marker between both to its estimated error; otherwise every step estimates its own error of "
        "contact.",
        source=f"{THIS_PACKAGE}: `python -m benchmarks error_coverage --contact`",
        note="takes about twice as long; no effect where nothing touches",
    )
    gravity: bool = choice(
        True,
        "Gravity of 9.8 m/s^2 along -z; the face then starts at its equilibrium.",
        source=f"{ESKES}, Finite element face model",
    )

    reduced: ReducedParameters = Field(
        default=ReducedParameters(), description="Reduced face in place of full order."
    )

    @model_validator(mode="after")
    def _startable(self) -> "SimulationParameters":
        if self.accuracy == "realtime" and self.reduced.file is None:
            raise ValueError(
                "accuracy = 'realtime' requires a reduced face: specify reduced.file (emgface "
                "reduce), or choose another accuracy"
            )
        soft = self.incompressibility in ("element", "nodal")
        if soft and self.bulk_potential != "quadratic":
            raise ValueError(
                f"incompressibility = '{self.incompressibility}' requires the quadratic potential: set"
                " bulk_potential = 'quadratic'"
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
                    f"{name} cannot be combined with incompressibility = '{self.incompressibility}': "
                    f"expected {' or '.join(map(repr, fits))}"
                )
        if self.stiffening > 1.0 and any(t.relaxing for t in self.tissues):
            raise ValueError(
                "a viscoelastic tissue cannot stiffen with activation: set stiffening = 1 "
                "or use an elastic tissue"
            )
        if self.contact.method == "constraint" and self.solver == "trapezoidal":
            raise ValueError(
                f"solver = '{self.solver}' cannot be combined with contact.method = "
                "'constraint', the default: choose 'sdirk2', 'converged' or a linearly implicit "
                "solver, or method = 'none'"
            )
        if self.contact.renewals and self.solver.startswith("linearly_implicit"):
            raise ValueError(
                f"contact.renewals = {self.contact.renewals} has no effect with solver = "
                f"'{self.solver}', which does not iterate: choose 'sdirk2' or 'converged', or leave it "
                "out"
            )
        against = self.contact.between if self.contact.method != "none" else None
        if self.support > 0.0 and "teeth" in (against or ()):
            raise ValueError(
                f"support = {self.support:g} N/m represents the teeth, which contact already "
                "contains: set support = 0, or contact.between = ['lips']"
            )
        if self.sigma_max < self.sigma_max_policy.minimum:
            raise ValueError(
                f"sigma_max = {self.sigma_max:g} Pa is below sigma_max_policy.minimum = "
                f"{self.sigma_max_policy.minimum:g} Pa: specify it in Pa, or lower the minimum"
            )
        return self

    def as_accurate(self, accuracy: str) -> "SimulationParameters":
        """Parameters with the same tissue and loads and another accuracy.

        `accuracy` is "draft", "study", "reference", "published", or an error such as "0.1 mm";
        ConfigurationError is raised otherwise.
        """
        values = self.model_dump(exclude=set(SET_BY_ACCURACY))
        return configure(SimulationParameters, values | {"accuracy": accuracy}, where="simulation")
