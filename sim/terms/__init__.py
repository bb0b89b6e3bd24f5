"""Terms: sources of force, one file each."""

from sim.scene import Term
from sim.terms.gravity import Gravity
from sim.terms.solid import Material, Muscles, Solid

TERMS: tuple[type[Term], ...] = (Solid, Gravity)
"""Every term; the derivative tests walk this tuple."""

__all__ = ["TERMS", "Gravity", "Material", "Muscles", "Solid"]
