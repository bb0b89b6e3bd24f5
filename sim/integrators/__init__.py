"""Integrators, which advance a state by one step and return a report."""

from sim.integrators.contract import Integrator, TimeIntegrator
from sim.integrators.converged_euler import ConvergedEuler
from sim.integrators.explicit import RungeKutta4, SymplecticEuler
from sim.integrators.sdirk2 import Sdirk2
from sim.integrators.static import Static
from sim.integrators.theta import LinearlyImplicitEuler, LinearlyImplicitTrapezoidal
from sim.integrators.trapezoidal import Trapezoidal
from sim.integrators.workspace import Workspace

INTEGRATORS: tuple[type[TimeIntegrator], ...] = (
    LinearlyImplicitEuler,
    ConvergedEuler,
    LinearlyImplicitTrapezoidal,
    Trapezoidal,
    Sdirk2,
    SymplecticEuler,
    RungeKutta4,
)
"""All integrators in time, the members of the tests of order, free fall and momentum."""

__all__ = [
    "INTEGRATORS",
    "ConvergedEuler",
    "Integrator",
    "LinearlyImplicitEuler",
    "LinearlyImplicitTrapezoidal",
    "RungeKutta4",
    "Sdirk2",
    "Static",
    "SymplecticEuler",
    "TimeIntegrator",
    "Trapezoidal",
    "Workspace",
]
