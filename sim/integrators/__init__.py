"""Integrators: each advances a state by one step and says how it went."""

from sim.integrators.contract import Integrator, Workspace
from sim.integrators.converged_euler import ConvergedEuler
from sim.integrators.linearly_implicit_euler import LinearlyImplicitEuler

INTEGRATORS: tuple[type[Integrator], ...] = (LinearlyImplicitEuler, ConvergedEuler)
"""Every integrator; the test of the convergence order walks this tuple."""

__all__ = ["INTEGRATORS", "ConvergedEuler", "Integrator", "LinearlyImplicitEuler", "Workspace"]
