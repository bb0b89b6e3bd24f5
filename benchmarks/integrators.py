"""Measured integrators by the names used in tables and figures."""

from typing import Final

from sim import (
    ConvergedEuler,
    LinearlyImplicitEuler,
    LinearlyImplicitTrapezoidal,
    RungeKutta4,
    Sdirk2,
    Static,
    SymplecticEuler,
    Trapezoidal,
)
from sim.integrators import Integrator

LINEARLY_IMPLICIT: Final[dict[str, Integrator]] = {
    "linearly implicit Euler": LinearlyImplicitEuler(),
    "linearly implicit trapezoidal": LinearlyImplicitTrapezoidal(),
}
"""Integrators with one linear solution per step."""
CONVERGED: Final[dict[str, Integrator]] = {
    "Euler": ConvergedEuler(),
    "trapezoidal": Trapezoidal(),
    "SDIRK2": Sdirk2(),
}
"""Integrators that iterate to a tolerance."""
IMPLICIT: Final = LINEARLY_IMPLICIT | CONVERGED
STATIC: Final[dict[str, Integrator]] = {"static": Static()}
EXPLICIT: Final[dict[str, Integrator]] = {
    "symplectic Euler": SymplecticEuler(),
    "RK4": RungeKutta4(),
}
