"""Constraints c(q) = 0 enforced by multipliers, one file each."""

from sim.constraints.volume import HardElementVolume
from sim.scene import Constraint

CONSTRAINTS: tuple[type[Constraint], ...] = (HardElementVolume,)
"""All constraints, which the derivative tests include."""

__all__ = ["CONSTRAINTS", "HardElementVolume"]
