"""Constraints: conditions c(q) = 0 that multipliers hold, one file each."""

from sim.constraints.volume import HardElementVolume
from sim.scene import Constraint

CONSTRAINTS: tuple[type[Constraint], ...] = (HardElementVolume,)
"""Every constraint; the derivative tests walk this tuple."""

__all__ = ["CONSTRAINTS", "HardElementVolume"]
