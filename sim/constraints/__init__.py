"""Constraints c(q) = 0 enforced by multipliers, one file each."""

from sim.constraints.volume import HardElementVolume
from sim.scene import Constraint

CONSTRAINTS: tuple[type[Constraint], ...] = (HardElementVolume,)
"""All constraints, the members of the derivative tests."""

__all__ = ["CONSTRAINTS", "HardElementVolume"]
