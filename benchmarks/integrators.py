"""The integrators that are measured, by the names that tables and figures give them."""

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
"""One linear solution a step."""
CONVERGED: Final[dict[str, Integrator]] = {
    "Euler": ConvergedEuler(),
    "trapezoidal": Trapezoidal(),
    "SDIRK2": Sdirk2(),
}
"""Iterated to a tolerance."""
IMPLICIT: Final = LINEARLY_IMPLICIT | CONVERGED
STATIC: Final[dict[str, Integrator]] = {"static": Static()}
EXPLICIT: Final[dict[str, Integrator]] = {
    "symplectic Euler": SymplecticEuler(),
    "RK4": RungeKutta4(),
}
