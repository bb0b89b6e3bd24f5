"""Isochoric laws: energy of the distortional strain, a function of I1bar = J^(-2/3) tr C."""

from dataclasses import dataclass
from typing import ClassVar, Protocol

from sim._kernels import laws
from sim.laws.parameters import Parametric, quantity
from sim.pattern import Array


class IsochoricLaw(Protocol):
    """Interface of isochoric laws; `evaluate` is the array form of the kernel of the element loop."""

    code: ClassVar[int]

    def parameters(self) -> tuple[float, ...]:
        """Parameters in the order of the kernel, at most `N_ISOCHORIC` of them."""
        ...

    def evaluate(self, I1bar: Array) -> tuple[Array, Array, Array]:
        """Energy w [Pa], dw/dI1bar and d2w/dI1bar2."""
        ...


@dataclass(frozen=True)
class MooneyRivlin(Parametric):
    """Two-term Mooney-Rivlin, w = C10 (I1bar - 3) + C20 (I1bar - 3)^2.

    Notes
    -----
    Source: Eskes et al. 2017, Eq. 1, with C10 = 2.5 kPa, C20 = 1.175 kPa.
    """

    #: stiffnesses [Pa]; the initial shear modulus is 2 C10
    C10: float = quantity(2500.0, "Pa", above=0.0)
    C20: float = quantity(1175.0, "Pa", least=0.0)
    code: ClassVar[int] = laws.MOONEY_RIVLIN

    def evaluate(self, I1bar: Array) -> tuple[Array, Array, Array]:
        """Polynomial of second degree."""
        x = I1bar - 3.0
        return (
            self.C10 * x + self.C20 * x**2,
            self.C10 + 2.0 * self.C20 * x,
            2.0 * self.C20 + 0.0 * x,
        )


@dataclass(frozen=True)
class NeoHooke(Parametric):
    """Neo-Hookean law, w = mu/2 (I1bar - 3), with the shear modulus mu [Pa]."""

    mu: float = quantity(5000.0, "Pa", above=0.0)
    code: ClassVar[int] = laws.NEO_HOOKE

    def evaluate(self, I1bar: Array) -> tuple[Array, Array, Array]:
        """Linear energy."""
        return 0.5 * self.mu * (I1bar - 3.0), 0.5 * self.mu + 0.0 * I1bar, 0.0 * I1bar


N_ISOCHORIC = 2
ISOCHORIC_LAWS: tuple[type[IsochoricLaw], ...] = (MooneyRivlin, NeoHooke)
"""All isochoric laws, which the derivative tests include."""
