"""Bulk laws: energy U(J) of the volume change J = det F at each Gauss point."""

from dataclasses import dataclass
from typing import ClassVar, Protocol

from sim._kernels import laws
from sim.laws.parameters import require


class BulkLaw(Protocol):
    """Interface of bulk laws for the element loop."""

    code: ClassVar[int]

    @property
    def kappa(self) -> float:
        """Bulk modulus at rest [Pa]."""
        ...


@dataclass(frozen=True)
class QuadraticBulk:
    """U = kappa/2 (J - 1)^2, pressure kappa (J - 1).

    Attributes
    ----------
    kappa : float
        Bulk modulus [Pa], not negative.

    Notes
    -----
    The energy is finite as J -> 0, so that strong muscles can invert an element. Source: Eskes et
    al. 2017, text ("quadratic bulk potential"), kappa = 25 kPa.
    """

    kappa: float = 25e3
    code: ClassVar[int] = laws.QUADRATIC

    def __post_init__(self) -> None:
        """Check the range."""
        require(self, "kappa", self.kappa, at_least=0.0, strictly=False)


@dataclass(frozen=True)
class LogarithmicBulk:
    """U = kappa/2 (ln J)^2, pressure kappa ln(J)/J.

    Attributes
    ----------
    kappa : float
        Bulk modulus at rest [Pa], not negative.

    Notes
    -----
    Softens in extension: U'' < 0 for J > e. Source: Eskes et al. 2017, Eq. 1.
    """

    kappa: float = 25e3
    code: ClassVar[int] = laws.LOGARITHMIC

    def __post_init__(self) -> None:
        """Check the range."""
        require(self, "kappa", self.kappa, at_least=0.0, strictly=False)


BULK_LAWS: tuple[type[BulkLaw], ...] = (QuadraticBulk, LogarithmicBulk)
"""All bulk laws, which the derivative tests include."""
