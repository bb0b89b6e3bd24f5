"""Parameters of an inversion."""

from dataclasses import dataclass, field
from typing import Final, Literal, get_args

from analysis.arguments import count, magnitude, number
from emgface.errors import ConfigurationError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.assumptions import Assumptions
from emgface.inverse.variants import Variant

LONGEST_DELAY: Final = 10.0
"""Largest delay of the sEMG, or of the clock of the markers, that is not a wrong unit [s]."""
Form = Literal["trajectory", "step", "quasi_static"]


@dataclass(frozen=True)
class InverseParameters:
    """Parameters of an inversion.

    Attributes
    ----------
    variant : "driven", "hybrid", "assisted" or "motion"
    form : "trajectory", "step" or "quasi_static"
        Most probable activations over the whole recording, with intervals; or those of every step
        by itself; or those whose equilibria have the positions of the markers, for faces that move
        slowly or are held. The last two have no intervals.
    emg_weight : float
        Weight w_e of the sEMG of a muscle with electrodes, in the assisted variant [1]. In the
        trajectory form, a factor on the inverse variance of its error.
    marker_error : float
        Unit of the residuals of the markers [m].
    chase : float
        Time in which a deviation is to vanish [s]; it averages the noise of the markers.
    size, change : float
        Weights of the size and of the change of the activations [1].
    jump : float
        Largest change of an activation in one step.
    gain : float
        Factor on the normalised sEMG, whose scale is unknown [1].
    delay : float
        Electromechanical delay by which the sEMG precedes the activation [s].
    emg_error : float
        Standard deviation of the sEMG times the gain from the activation [1].
    left_out : tuple of str
        Lip markers that are not tracked, for validation.
    assumed : Assumptions
        Errors that determine the intervals.
    iterations : int
        Largest number of Gauss-Newton iterations of the trajectory form.
    """

    variant: Variant = "assisted"
    form: Form = "trajectory"
    emg_weight: float = 1.0
    marker_error: float = 1e-3
    chase: float = 0.05
    size: float = 0.01
    change: float = 0.1
    jump: float = 0.2
    gain: float = 1.0
    delay: float = 0.04
    emg_error: float = 0.25
    left_out: tuple[str, ...] = ()
    assumed: Assumptions = field(default_factory=Assumptions)
    iterations: int = 12

    def __post_init__(self) -> None:
        """Raise ConfigurationError for numbers that are not finite or too small."""
        for name in ("marker_error", "jump", "gain", "emg_error"):
            magnitude(name, getattr(self, name), error=ConfigurationError)
        for name in ("chase", "size", "change"):
            magnitude(name, getattr(self, name), zero=True, error=ConfigurationError)
        count("iterations", self.iterations, least=1, error=ConfigurationError)
        number("emg_weight", self.emg_weight, error=ConfigurationError)
        if not abs(number("delay", self.delay, error=ConfigurationError)) <= LONGEST_DELAY:
            raise ConfigurationError(
                f"the delay of the sEMG is {self.delay:g} s, expected at most {LONGEST_DELAY:g} s "
                "before or after: check its unit, s"
            )


def form_of(form: str, contact: bool) -> None:
    """Raise ConfigurationError if a form is unknown or does not exist with contact."""
    if form not in get_args(Form):
        raise ConfigurationError(
            f"form {form!r} is unknown, expected one of {', '.join(get_args(Form))}"
        )
    if contact and form == "trajectory":
        raise ConfigurationError(
            "the trajectory form has no derivatives with contact: use --form step, which has no "
            "intervals, or leave contact out"
        )


def without_contact(simulation: SimulationParameters) -> SimulationParameters:
    """Parameters of the same mechanics without contact."""
    none = simulation.contact.model_copy(update={"method": "none"})
    return simulation.model_copy(update={"contact": none})
