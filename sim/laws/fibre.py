"""Fibre laws: energy w(stretch, activation) along the unit rest direction a0 of a muscle.

With stretch = J^(-1/3) |F a0| and a = F a0/|F a0| the Cauchy stress is
sigma = (stretch dw/dstretch / J)(a a' - I/3); the stresses of bundles in one element are summed.
"""

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from scipy.special import expi

from sim._kernels import laws
from sim.checks import require
from sim.laws.parameters import Parametric, quantity
from sim.pattern import Array

Derivatives = tuple[Array, Array, Array]  #: an energy, and its first and second derivative


class FibreLaw(Protocol):
    """Interface of fibre laws; `evaluate` is the array form of the kernel of the element loop."""

    code: ClassVar[int]

    def parameters(self) -> tuple[float, ...]:
        """Parameters in the order of the kernel, at most `N_FIBRE` of them."""
        ...

    def evaluate(self, stretch: Array, activation: Array) -> Derivatives:
        """Energy w [Pa], dw/dstretch and d2w/dstretch2 at stretches and activations."""
        ...


@dataclass(frozen=True)
class Blemker(Parametric):
    """Length-dependent active and passive muscle, both scaled by sigma_max.

    dw/dstretch = (sigma_max/stretch_opt) (f_pas(r) + activation f_act(r)), r = stretch/stretch_opt:

    * f_act = 9 (r - 0.4)^2 up to 0.6, 1 - 4 (1 - r)^2 up to 1.4, 9 (r - 1.6)^2 up to 1.6, else 0;
    * f_pas = 0 up to r = 1, P1 (exp(P2 (r - 1)) - 1) up to stretch_star, then its tangent line.

    Notes
    -----
    Source: Blemker et al. 2005; values of Eskes et al. 2017, Methods.
    """

    sigma_max: float = quantity(300e3, "Pa", least=0.0)  #: largest active stress [Pa]
    stretch_opt: float = quantity(1.0, "1", above=0.0)  #: stretch of the largest active stress [1]
    #: stretch at which the passive curve becomes linear [1]
    stretch_star: float = quantity(1.4, "1")
    #: passive stress coefficient and uncrimping factor [1]
    P1: float = quantity(0.05, "1", least=0.0)
    P2: float = quantity(6.6, "1", above=0.0)
    code: ClassVar[int] = laws.BLEMKER

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self, "stretch_star", self.stretch_star, above=self.stretch_opt)

    def evaluate(self, stretch: Array, activation: Array) -> Derivatives:
        """Polynomials of each interval, and the passive curve above r = 1 alone."""
        r, opt = stretch / self.stretch_opt, self.stretch_opt
        where = [r <= 0.4, r <= 0.6, r < 1.4, r < 1.6]
        x, y, z, end = r - 0.4, r - 1.0, r - 1.6, 508.0 / 750.0
        middle = 0.024 + y + 0.4 - 4.0 / 3.0 * (y**3 + 0.064)
        w = np.select(where, [0.0 * r, 3.0 * x**3, middle, end + 3.0 * z**3], end)
        f = np.select(where, [0.0 * r, 9.0 * x**2, 1.0 - 4.0 * y**2, 9.0 * z**2], 0.0)
        k = np.select(where, [0.0 * r, 18.0 * x, -8.0 * y, 18.0 * z], 0.0)
        passive = _toe(self.P1, self.P2, self.stretch_star / opt, r)
        pull = (np.where(r > 1.0 + laws.KINK, p, 0.0) for p in passive)
        both = (p + activation * a for p, a in zip(pull, (w, f, k), strict=True))
        w, f, k = (self.sigma_max * part for part in both)
        return w, f / opt, k / opt**2


@dataclass(frozen=True)
class Generic(Parametric):
    """Active stress without length dependence, passive curve in pascals.

    dw/dstretch = f_pas(stretch)/stretch + activation sigma_max, with f_pas = P1 (exp(P2 (stretch -
    1)) - 1) up to stretch_star (negative below 1), then its tangent line. With the default P1 the
    passive part is negligible.
    """

    sigma_max: float = quantity(30e3, "Pa", least=0.0)  #: active stress at full activation [Pa]
    #: stretch at which the passive curve becomes linear [1]
    stretch_star: float = quantity(1.4, "1", above=1.0)
    #: passive stress [Pa] and uncrimping factor [1]
    P1: float = quantity(0.05, "Pa", least=0.0)
    P2: float = quantity(6.6, "1", above=0.0)
    code: ClassVar[int] = laws.GENERIC

    def parameters(self) -> tuple[float, ...]:
        """Return sigma_max [Pa], 1, stretch_star, P1 [Pa], P2."""
        return (self.sigma_max, 1.0, self.stretch_star, self.P1, self.P2)

    def evaluate(self, stretch: Array, activation: Array) -> Derivatives:
        """Energy by the exponential integral, Ei."""
        x, star, P2 = stretch, self.stretch_star, self.P2
        _, f, k = _toe(self.P1, P2, star, x)
        low = np.minimum(x, star)
        w = self.P1 * (np.exp(-P2) * (expi(P2 * low) - expi(P2)) - np.log(low))
        _, at_star, slope = (float(v) for v in _toe(self.P1, P2, star, np.array(star)))
        w += np.where(x > star, slope * (x - low) + (at_star - slope * star) * np.log(x / low), 0)
        active = self.sigma_max * activation
        return w + active * (x - 1.0), f / x + active, (k - f / x) / x


@dataclass(frozen=True)
class Constant(Parametric):
    """Active stress only, dw/dstretch = activation sigma_max, with sigma_max [Pa] not negative."""

    sigma_max: float = quantity(30e3, "Pa", least=0.0)
    code: ClassVar[int] = laws.CONSTANT_FIBRE

    def evaluate(self, stretch: Array, activation: Array) -> Derivatives:
        """Linear energy."""
        active = self.sigma_max * activation
        return active * (stretch - 1.0), active + 0.0 * stretch, 0.0 * stretch


def _toe(P1: float, P2: float, star: float, r: Array) -> Derivatives:
    """P1 (exp(P2 (r - 1)) - 1) up to star, then its tangent line; integral from 1, value and slope."""
    low = np.minimum(r, star)
    e, more = np.exp(P2 * (low - 1.0)), r - low
    f, k = P1 * (e - 1.0), P1 * P2 * e
    return (f / P2 - P1 * (low - 1.0)) + f * more + 0.5 * k * more**2, f + k * more, k


N_FIBRE = 5
FIBRE_LAWS: tuple[type[FibreLaw], ...] = (Blemker, Generic, Constant)
"""All fibre laws, which the derivative tests include."""


def slopes(law: FibreLaw, stretch: Array, activation: Array) -> Array:
    """Slopes dw/dstretch [Pa] alone, of any shape, by the kernel of the element loop."""
    p = np.zeros(N_FIBRE)
    p[: len(law.parameters())] = law.parameters()
    slope = np.empty(stretch.shape)
    given = (np.ascontiguousarray(x).reshape(-1) for x in (stretch, activation))
    laws.fibre_slopes(law.code, p, *given, slope.reshape(-1))
    return slope
