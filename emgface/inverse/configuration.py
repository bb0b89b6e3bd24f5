"""Strategies of a study whose activations follow the markers, and their parameters."""

from typing import Final, Literal

from emgface.choices import THIS_PACKAGE, Parameters, choice, parameter

VARIANT: Final[dict[str, Literal["motion", "assisted"]]] = {
    "inverse": "motion",
    "assisted": "assisted",
}
"""Strategies by inverse tracking, and their variants."""


class InverseConfiguration(Parameters):
    """Parameters of the strategies inverse and assisted."""

    form: Literal["step", "trajectory"] = choice(
        "step",
        "Activations of every step by itself, or those that are most probable over the trial, which "
        "takes about ten times as long.",
    )
    emg_weight: float = parameter(
        1.0, "Weight of the sEMG in the strategy assisted.", source=THIS_PACKAGE, ge=0
    )
    gain: float = parameter(
        1.0, "Factor on the normalised sEMG in the strategy assisted.", source=THIS_PACKAGE, gt=0
    )
    delay: float = parameter(
        0.04,
        "Time by which the sEMG precedes the activation.",
        unit="s",
        source=THIS_PACKAGE,
        ge=0,
        le=0.2,
    )
