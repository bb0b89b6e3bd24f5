"""Constitutive laws, one class per law; the closed forms live in `sim._kernels.laws`."""

from sim.laws.bulk import BULK_LAWS, BulkLaw, LogarithmicBulk, QuadraticBulk
from sim.laws.fibre import FIBRE_LAWS, Blemker, Constant, FibreLaw, Generic
from sim.laws.isochoric import ISOCHORIC_LAWS, IsochoricLaw, MooneyRivlin, NeoHooke

__all__ = [
    "BULK_LAWS",
    "FIBRE_LAWS",
    "ISOCHORIC_LAWS",
    "Blemker",
    "BulkLaw",
    "Constant",
    "FibreLaw",
    "Generic",
    "IsochoricLaw",
    "LogarithmicBulk",
    "MooneyRivlin",
    "NeoHooke",
    "QuadraticBulk",
]
