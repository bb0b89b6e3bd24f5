"""Terms: sources of force, one file each."""

from sim.terms.gravity import Gravity
from sim.terms.solid import Material, Muscles, Solid

__all__ = ["Gravity", "Material", "Muscles", "Solid"]
