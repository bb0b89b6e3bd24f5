"""Estimated error of the time steps of a jaw, and steps that reach a desired error."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr

import sim
from emgface.anatomy.jaw.model import Floats
from sim.probes import Variable
from sim.state import Control, Outputs, State, StepReport

MOST_STEP_HALVINGS = 6
"""Largest number of times that steps are halved to reach a desired error."""


@dataclass(frozen=True)
class Jumps:
    """Largest ``jump`` of a step since the output before [m], as of `sim.state.StepReport`."""

    def variables(self) -> tuple[Variable, ...]:
        """Describe the variable."""
        return (Variable("jump", "m"),)

    def record(
        self, system: sim.System, state: State, control: Control, report: StepReport | None
    ) -> tuple[float]:
        """Copy it from the report; 0 at the start and with integrators that do not estimate it."""
        return (0.0 if report is None else float(np.nan_to_num(report.jump)),)

    def record_all(self, system: sim.System, outputs: Outputs, activation: Floats) -> tuple[Floats]:
        """Copy them from the reports."""
        return (np.nan_to_num([report.jump for report in outputs.reports]),)


def estimated_error(motion: xr.Dataset, finer: xr.Dataset, order: int) -> Floats:
    """Estimated error (time,) of the points of a motion until every instant [m].

    It is the sum of two parts. For steps h and a method of order p (`order`) the error is that of
    the series in h, 2^p/(2^p - 1) of the distance from a motion with steps h/2 (`finer`). Where an
    impact or a burst within a step decides the further motion, both motions may err alike: a
    velocity that changes by dv (``jump``) at an unknown instant of a step displaces a point by up
    to h dv.
    """
    away = motion["position"].values - finer["position"].values
    dims = motion["position"].dims
    apart = np.sqrt((away**2).sum(axis=dims.index("axis"), keepdims=True))
    apart = np.moveaxis(apart, dims.index("time"), 0).reshape(motion.sizes["time"], -1).max(axis=1)
    doubled = 2.0**order
    error = doubled / (doubled - 1.0) * np.maximum.accumulate(apart)
    return np.asarray(error + np.maximum.accumulate(motion["jump"].values), dtype=np.float64)


def with_step_error(
    run: Callable[[float, bool], xr.Dataset], step: float, order: int, tolerance: float | None
) -> xr.Dataset:
    """Motion with ``numerical_error``; `run` makes one, or its positions alone, with a step [s].

    Steps are halved until the error is at most a tolerance [m], at most `MOST_STEP_HALVINGS` times;
    without a tolerance they are those given.
    """
    whole, halved, motion = tolerance is not None, 0, run(step, True)
    finer = run(0.5 * step, whole)
    error = estimated_error(motion, finer, order)
    while tolerance is not None and error[-1] > tolerance and halved < MOST_STEP_HALVINGS:
        step, halved, motion = 0.5 * step, halved + 1, finer
        finer = run(0.5 * step, whole)
        error = estimated_error(motion, finer, order)
    motion = motion.assign(numerical_error=("time", error, {"units": "m"}))
    motion.attrs["numerical_error"] = float(error[-1])
    return motion
