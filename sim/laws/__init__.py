"""Constitutive laws, one class per law; the closed forms are in `sim._kernels.laws`."""

from sim.laws.bulk import BULK_LAWS, BulkLaw, LogarithmicBulk, QuadraticBulk
from sim.laws.fibre import FIBRE_LAWS, Blemker, Constant, FibreLaw, Generic, slopes
from sim.laws.hill import Hill
from sim.laws.isochoric import ISOCHORIC_LAWS, IsochoricLaw, MooneyRivlin, NeoHooke
from sim.laws.line import LINE_LAWS, ConstantForce, LinearSpring, LineLaw, Peck
from sim.laws.rate import ForceVelocity
from sim.laws.relaxation import Prony
from sim.laws.tensor import (
    TENSOR_LAWS,
    CoRotational,
    FiveTermMooneyRivlin,
    Fung,
    LinearElastic,
    Ogden,
    TensorLaw,
)

__all__ = [
    "BULK_LAWS",
    "FIBRE_LAWS",
    "ISOCHORIC_LAWS",
    "Hill",
    "LINE_LAWS",
    "LinearSpring",
    "TENSOR_LAWS",
    "Blemker",
    "BulkLaw",
    "CoRotational",
    "Constant",
    "ConstantForce",
    "FibreLaw",
    "FiveTermMooneyRivlin",
    "ForceVelocity",
    "Fung",
    "Generic",
    "IsochoricLaw",
    "LineLaw",
    "LinearElastic",
    "LogarithmicBulk",
    "MooneyRivlin",
    "NeoHooke",
    "Ogden",
    "Peck",
    "Prony",
    "QuadraticBulk",
    "slopes",
    "TensorLaw",
]
