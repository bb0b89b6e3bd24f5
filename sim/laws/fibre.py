"""Fibre laws: energy w(stretch, activation) along the unit rest direction a0 of a muscle.

With stretch = J^(-1/3) |F a0| and a = F a0/|F a0| the Cauchy stress is
sigma = (stretch dw/dstretch / J)(a a' - I/3); the stresses of bundles in one element are summed.
"""

from dataclasses import dataclass
from typing import ClassVar, Protocol

from sim._kernels import laws
from sim.laws.parameters import require


class FibreLaw(Protocol):
    """Interface of fibre laws for the element loop."""

    code: ClassVar[int]

    def parameters(self) -> tuple[float, ...]:
        """Parameters in the order of the kernel, at most `N_FIBRE` of them."""
        ...


@dataclass(frozen=True)
class Blemker:
    """Length-dependent active and passive muscle, both scaled by sigma_max.

    dw/dstretch = (sigma_max/stretch_opt) (f_pas(r) + activation f_act(r)), r = stretch/stretch_opt:

    * f_act = 9 (r - 0.4)^2 up to 0.6, 1 - 4 (1 - r)^2 up to 1.4, 9 (r - 1.6)^2 up to 1.6, else 0;
    * f_pas = 0 up to r = 1, P1 (exp(P2 (r - 1)) - 1) up to stretch_star, then its tangent line.

    Attributes
    ----------
    sigma_max : float
        Largest active stress [Pa].
    stretch_opt : float
        Stretch of the largest active stress [1].
    stretch_star : float
        Stretch at which the passive curve becomes linear [1].
    P1, P2 : float
        Passive stress coefficient and uncrimping factor [1].

    Notes
    -----
    Source: Blemker et al. 2005; values of Eskes et al. 2017, Methods.
    """

    sigma_max: float = 300e3
    stretch_opt: float = 1.0
    stretch_star: float = 1.4
    P1: float = 0.05
    P2: float = 6.6
    code: ClassVar[int] = laws.BLEMKER

    def __post_init__(self) -> None:
        """Check the ranges."""
        require(self, "sigma_max", self.sigma_max, at_least=0.0, strictly=False)
        require(self, "stretch_opt", self.stretch_opt, at_least=0.0, strictly=True)
        require(self, "stretch_star", self.stretch_star, at_least=self.stretch_opt, strictly=True)
        require(self, "P1", self.P1, at_least=0.0, strictly=False)
        require(self, "P2", self.P2, at_least=0.0, strictly=True)

    def parameters(self) -> tuple[float, ...]:
        """Return sigma_max [Pa], stretch_opt, stretch_star, P1, P2."""
        return (self.sigma_max, self.stretch_opt, self.stretch_star, self.P1, self.P2)


@dataclass(frozen=True)
class Generic:
    """Active stress without length dependence, passive curve in pascals.

    dw/dstretch = f_pas(stretch)/stretch + activation sigma_max, with f_pas = P1 (exp(P2 (stretch -
    1)) - 1) up to stretch_star (negative below 1), then its tangent line. With the default P1 the
    passive part is negligible.

    Attributes
    ----------
    sigma_max : float
        Active stress at full activation [Pa].
    stretch_star : float
        Stretch at which the passive curve becomes linear [1].
    P1, P2 : float
        Passive stress [Pa] and uncrimping factor [1].
    """

    sigma_max: float = 30e3
    stretch_star: float = 1.4
    P1: float = 0.05
    P2: float = 6.6
    code: ClassVar[int] = laws.GENERIC

    def __post_init__(self) -> None:
        """Check the ranges."""
        require(self, "sigma_max", self.sigma_max, at_least=0.0, strictly=False)
        require(self, "stretch_star", self.stretch_star, at_least=1.0, strictly=True)
        require(self, "P1", self.P1, at_least=0.0, strictly=False)
        require(self, "P2", self.P2, at_least=0.0, strictly=True)

    def parameters(self) -> tuple[float, ...]:
        """Return sigma_max [Pa], 1, stretch_star, P1 [Pa], P2."""
        return (self.sigma_max, 1.0, self.stretch_star, self.P1, self.P2)


@dataclass(frozen=True)
class Constant:
    """Active stress only, dw/dstretch = activation sigma_max, with sigma_max [Pa] not negative."""

    sigma_max: float = 30e3
    code: ClassVar[int] = laws.CONSTANT

    def __post_init__(self) -> None:
        """Check the range."""
        require(self, "sigma_max", self.sigma_max, at_least=0.0, strictly=False)

    def parameters(self) -> tuple[float, ...]:
        """Return sigma_max [Pa]."""
        return (self.sigma_max,)


N_FIBRE = 5
FIBRE_LAWS: tuple[type[FibreLaw], ...] = (Blemker, Generic, Constant)
"""All fibre laws, which the derivative tests include."""
