"""Step control: it alone divides an interval and rejects; a rejected step leaves no trace."""

from sim.steps.contract import StepControl, Watch, united
from sim.steps.error_controlled import ErrorControlledStep
from sim.steps.fixed import FixedStep
from sim.steps.halving import HalvingStep

STEP_CONTROLS: tuple[type[StepControl], ...] = (FixedStep, HalvingStep, ErrorControlledStep)
"""Every step control; the tests walk this tuple."""

__all__ = [
    "STEP_CONTROLS",
    "ErrorControlledStep",
    "FixedStep",
    "HalvingStep",
    "StepControl",
    "Watch",
    "united",
]
