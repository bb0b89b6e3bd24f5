"""Measured integrators by the names used in tables and figures."""

from typing import Final

import sim
from sim.integrators import Integrator

LINEARLY_IMPLICIT: Final[dict[str, Integrator]] = {
    "linearly implicit Euler": sim.LinearlyImplicitEuler(),
    "linearly implicit trapezoidal": sim.LinearlyImplicitTrapezoidal(),
}
"""Integrators with one linear solution per step."""
CONVERGED: Final[dict[str, Integrator]] = {
    "Euler": sim.ConvergedEuler(),
    "trapezoidal": sim.Trapezoidal(),
    "SDIRK2": sim.Sdirk2(),
}
"""Integrators that iterate to a tolerance."""
IMPLICIT: Final = LINEARLY_IMPLICIT | CONVERGED
STATIC: Final[dict[str, Integrator]] = {"static": sim.Static()}
EXPLICIT: Final[dict[str, Integrator]] = {
    "symplectic Euler": sim.SymplecticEuler(),
    "RK4": sim.RungeKutta4(),
}
