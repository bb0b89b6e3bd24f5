"""Integrator and step control of the parameters of a simulation."""

from dataclasses import replace
from typing import Final, TypeVar

import numpy as np
import xarray as xr

import sim
from emgface.face.simulation_parameters import SimulationParameters
from sim.integrators import Integrator
from sim.integrators.stage import Converged
from sim.steps import StepControl

ConvergedT = TypeVar("ConvergedT", bound=Converged)

INTEGRATORS: dict[str, Integrator] = {
    "converged": sim.ConvergedEuler(),
    "trapezoidal": sim.Trapezoidal(),
    "sdirk2": sim.Sdirk2(),
    "linearly_implicit": sim.LinearlyImplicitEuler(),
    "linearly_implicit_trapezoidal": sim.LinearlyImplicitTrapezoidal(),
}
"""Integrator by the name of the parameter `solver`."""

RESIDUAL_PER_TOLERANCE: Final = 100.0
"""Residual force per tolerance of the positions [N/m], a tenth of the stiffness of a wall.

Tissue is softer, so that the estimated error of the positions ends its iteration.
"""


def iterated_to(integrator: ConvergedT, tolerance: float) -> ConvergedT:
    """Return the integrator iterated to this error of a nodal position [m] and its residual."""
    return replace(
        integrator, tolerance=tolerance, residual_tolerance=RESIDUAL_PER_TOLERANCE * tolerance
    )


def integrator_of(parameters: SimulationParameters) -> Integrator:
    """Integrator of the parameter `solver`, iterated to `iteration_tolerance`."""
    made = INTEGRATORS[parameters.solver]
    if not isinstance(made, Converged):
        return made
    return iterated_to(made, parameters.iteration_tolerance)


def steps_of(face: xr.Dataset, parameters: SimulationParameters) -> StepControl:
    """Step control: by the estimated error of the markers, halved after failures, or fixed."""
    if parameters.error_tolerance is not None:
        nodes = face["marker_node"].values.astype(np.int64)
        horizon = parameters.beta or sim.ErrorControlledStep.horizon
        return sim.ErrorControlledStep(parameters.error_tolerance, parameters.step, nodes, horizon)
    if parameters.solver.startswith("linearly_implicit"):
        return sim.FixedStep(parameters.step)
    return sim.HalvingStep(parameters.step)
