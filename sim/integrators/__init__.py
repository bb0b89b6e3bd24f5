"""Integrators: each advances a state by one step and says how it went."""

from sim.integrators.contract import Integrator, TimeIntegrator, Workspace
from sim.integrators.converged_euler import ConvergedEuler
from sim.integrators.linearly_implicit_euler import LinearlyImplicitEuler
from sim.integrators.static import Static

INTEGRATORS: tuple[type[TimeIntegrator], ...] = (LinearlyImplicitEuler, ConvergedEuler)
"""Every integrator in time; the test of the convergence order walks this tuple."""

__all__ = [
    "INTEGRATORS",
    "ConvergedEuler",
    "Integrator",
    "LinearlyImplicitEuler",
    "Static",
    "TimeIntegrator",
    "Workspace",
]
