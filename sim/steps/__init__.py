"""Step controls: they divide an interval into steps, and repeat rejected ones."""

from sim.steps.contract import Motion, StepControl, StepsThrough, Watch
from sim.steps.error_controlled import ErrorControlledStep
from sim.steps.fixed import FixedStep
from sim.steps.halving import HalvingStep

STEP_CONTROLS: tuple[type[StepControl], ...] = (FixedStep, HalvingStep, ErrorControlledStep)
"""All step controls, the members of the tests."""

__all__ = [
    "STEP_CONTROLS",
    "ErrorControlledStep",
    "FixedStep",
    "HalvingStep",
    "Motion",
    "StepControl",
    "StepsThrough",
    "Watch",
]
