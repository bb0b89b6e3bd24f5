"""Bulk laws: energy U(J) of the volume change J = det F at each Gauss point."""

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from sim._kernels import laws
from sim.laws.parameters import Parametric, quantity
from sim.pattern import Array


class BulkLaw(Protocol):
    """Interface of bulk laws; `evaluate` is the array form of the kernel of the element loop."""

    code: ClassVar[int]

    @property
    def kappa(self) -> float:
        """Bulk modulus at rest [Pa]."""
        ...

    def evaluate(self, J: Array) -> tuple[Array, Array, Array]:
        """Energy U [Pa], the pressure dU/dJ and d2U/dJ2."""
        ...


@dataclass(frozen=True)
class QuadraticBulk(Parametric):
    """U = kappa/2 (J - 1)^2, pressure kappa (J - 1).

    Notes
    -----
    The energy is finite as J -> 0, so that strong muscles can invert an element. Source: Eskes et
    al. 2017, text ("quadratic bulk potential"), kappa = 25 kPa.
    """

    kappa: float = quantity(25e3, "Pa", least=0.0)  #: bulk modulus [Pa], not negative
    code: ClassVar[int] = laws.QUADRATIC

    def evaluate(self, J: Array) -> tuple[Array, Array, Array]:
        """Quadratic energy."""
        x = J - 1.0
        return 0.5 * self.kappa * x**2, self.kappa * x, self.kappa + 0.0 * x


@dataclass(frozen=True)
class LogarithmicBulk(Parametric):
    """U = kappa/2 (ln J)^2, pressure kappa ln(J)/J.

    Notes
    -----
    Softens in extension: U'' < 0 for J > e. Source: Eskes et al. 2017, Eq. 1.
    """

    kappa: float = quantity(25e3, "Pa", least=0.0)  #: bulk modulus at rest [Pa], not negative
    code: ClassVar[int] = laws.LOGARITHMIC

    def evaluate(self, J: Array) -> tuple[Array, Array, Array]:
        """Quadratic energy of ln J."""
        x = np.log(J)
        return 0.5 * self.kappa * x**2, self.kappa * x / J, self.kappa * (1.0 - x) / J**2


BULK_LAWS: tuple[type[BulkLaw], ...] = (QuadraticBulk, LogarithmicBulk)
"""All bulk laws, which the derivative tests include."""
