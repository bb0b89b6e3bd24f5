"""Isochoric laws: energy of the distortional strain, a function of I1bar = J^(-2/3) tr C."""

from dataclasses import dataclass
from typing import ClassVar, Protocol

from sim._kernels import laws
from sim.laws.parameters import require


class IsochoricLaw(Protocol):
    """Interface of isochoric laws for the element loop."""

    code: ClassVar[int]

    def parameters(self) -> tuple[float, ...]:
        """Parameters in the order of the kernel, at most `N_ISOCHORIC` of them."""
        ...


@dataclass(frozen=True)
class MooneyRivlin:
    """Two-term Mooney-Rivlin, w = C10 (I1bar - 3) + C20 (I1bar - 3)^2.

    Attributes
    ----------
    C10, C20 : float
        Stiffnesses [Pa]; the initial shear modulus is 2 C10.

    Notes
    -----
    Source: Eskes et al. 2017, Eq. 1, with C10 = 2.5 kPa, C20 = 1.175 kPa.
    """

    C10: float = 2500.0
    C20: float = 1175.0
    code: ClassVar[int] = laws.MOONEY_RIVLIN

    def __post_init__(self) -> None:
        """Check the ranges."""
        require(self, "C10", self.C10, at_least=0.0, strictly=True)
        require(self, "C20", self.C20, at_least=0.0, strictly=False)

    def parameters(self) -> tuple[float, ...]:
        """C10, C20 [Pa]."""
        return (self.C10, self.C20)


@dataclass(frozen=True)
class NeoHooke:
    """Neo-Hookean law, w = mu/2 (I1bar - 3), with the shear modulus mu [Pa]."""

    mu: float = 5000.0
    code: ClassVar[int] = laws.NEO_HOOKE

    def __post_init__(self) -> None:
        """Check the range."""
        require(self, "mu", self.mu, at_least=0.0, strictly=True)

    def parameters(self) -> tuple[float, ...]:
        """Return mu [Pa]."""
        return (self.mu,)


N_ISOCHORIC = 2
ISOCHORIC_LAWS: tuple[type[IsochoricLaw], ...] = (MooneyRivlin, NeoHooke)
"""All isochoric laws, which the derivative tests include."""
