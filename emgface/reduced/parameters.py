"""Parameters of the training and of the use of a reduced face."""

from pathlib import Path
from typing import Literal

from pydantic import model_validator

from emgface.choices import Parameters, choice, parameter, positive


class ReductionParameters(Parameters):
    """Size and training of a reduced face."""

    modes: int = parameter(120, "Number of modes, a multiple of three.", ge=3, le=240)
    omitted: int = parameter(
        12, "Number of further modes, whose forces estimate the error of leaving them out.", ge=1
    )
    elements: int = parameter(300, "Largest number of elements with a weight.", ge=10)
    sample_tolerance: float = positive(
        1e-5,
        "Displacement that the errors of the sampled forces may cause, root mean square over the "
        "training.",
        unit="m",
    )
    activations: Literal["study", "random"] = choice(
        "study",
        "Sequences of the training and of the calibration: activations that the strategies derive "
        "from the sEMG of simulated volunteers, or random sequences of any muscles.",
    )
    ramps: bool = choice(
        True,
        "Also train with ramps of each muscle, so that combinations of muscles that no sequence "
        "contains are "
        "within the range.",
    )
    sequences: int = parameter(36, "Number of sequences of the training.", ge=1)
    calibration: int = parameter(
        39, "Number of sequences that calibrate the estimated error.", ge=1
    )
    coverage: float = parameter(
        0.95, "Probability with which a trial stays within its estimated error.", gt=0, lt=1
    )
    every: float = positive(0.02, "Time between snapshots.", unit="s")
    seed: int = parameter(0, "Seed of the random sequences.", ge=0)

    @model_validator(mode="after")
    def _thirds(self) -> "ReductionParameters":
        if self.modes % 3:
            raise ValueError(f"modes = {self.modes}, expected a multiple of three")
        return self

    @model_validator(mode="after")
    def _calibrated(self) -> "ReductionParameters":
        """Refuse before the training what the calibration after it cannot do."""
        from sim.reduced.conformal import least_trials  # other commands load no mechanics

        if self.calibration < (least := least_trials(self.coverage)):
            raise ValueError(
                f"calibration = {self.calibration}, expected at least {least} sequences for a "
                f"coverage of {100 * self.coverage:g} %"
            )
        return self


class ReducedParameters(Parameters):
    """Use of a reduced face instead of full order."""

    file: Path | None = choice(
        None,
        "Reduced face as written by `emgface reduce`; steps are then linearly implicit.",
    )
    largest_error: float = positive(
        2e-3,
        "Bound of the error of a marker by the reduction, above which the trial is simulated at full "
        "order instead.",
        unit="m",
    )
    fall_back: bool = choice(
        True,
        "Simulate at full order where the reduced motion is not trusted; otherwise only report this.",
    )
